"""The session: waiting with telemetry, limits watched, questions, alarms, and the way to a safe state."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.control.displays import Displays
from bench.control.questions import AssumeYes, Reply
from bench.control.session import Bench
from bench.record.benchfile import LimitsSection, SafeSection
from bench.record.events.run import Basis, Invalid, Requested
from drivers.base.clock import Interrupt
from drivers.base.errors import (
    ConfigurationError,
    DeviceSilent,
    LimitExceeded,
    LinkLost,
    ProtocolError,
    RunAborted,
)
from drivers.kit.config import TableConfig
from drivers.kit.instruments import ChamberState, Rest, TableState


class Clock:
    """Time passes by sleeping only, in whole ns; an interrupt at `stop_at_s`."""

    def __init__(self, stop_at_s=1e9):
        self.ns, self.stop_at_s, self.interrupt = 0, stop_at_s, Interrupt()

    def now(self):
        return self.ns / 1e9

    def sleep(self, duration_s):
        if self.now() >= self.stop_at_s:
            self.interrupt.request("stopped by Ctrl-C")
        self.interrupt.check()
        self.ns += max(0, round(duration_s * 1e9))

    idle = sleep


class Device:
    """Either instrument: answers `state`, keeps what it was told."""

    def __init__(self, clock, log, name, state):
        self.clock, self.log, self.name, self.state = clock, log, name, state
        self.faults, self.silent = [], False
        self.link = SimpleNamespace(reopen=self._reopen, on_retry=None)
        self.rests = [
            Rest(True, {"table": 0.0}) if name == "table" else Rest(True, running=False, set_point_c=25.0)
        ]

    def _reopen(self):
        self.log.append(f"{self.name} looked for")
        raise ConfigurationError("the port cannot be opened")

    def request_state(self):
        self.log.append(f"{self.name} asked")

    def read_state(self):
        self.log.append(f"{self.name} read")
        self.clock.ns += 20_000_000
        return self.state

    def alarms(self):
        return self.faults

    def halt(self):
        self.log.append(f"{self.name} halt")
        if self.silent:
            raise DeviceSilent(f"{self.name} is silent")

    def make_safe(self):
        self.log.append(f"{self.name} safe")
        if self.silent:
            raise DeviceSilent(f"{self.name} is silent")

    def read_rest(self):
        self.log.append(f"{self.name} rest")
        return self.rests.pop(0) if len(self.rests) > 1 else self.rests[0]


class Record:
    def __init__(self):
        self.rows, self.kept = [], []
        self.holes = []  # what each check finds missing of the raw files

    def keep_picture(self, path, say):
        return None

    def event(self, time_s, event):
        self.rows.append((round(time_s, 6), event.kind, event.fields()))

    def check(self):
        self.kept.append(True)
        return self.holes.pop(0) if self.holes else []

    def of(self, kind):
        return [fields for _, found, fields in self.rows if found == kind]


TABLE = TableConfig(driver="acutrol3000", port="/dev/ttyUSB0")
LIMITS = LimitsSection()


TOLD = ["table halt", "chamber halt", "table safe", "chamber safe"]


@pytest.fixture
def made():
    clock, log, record = Clock(), [], Record()
    chamber = SimpleNamespace(door_message=None)
    file = SimpleNamespace(limits=LIMITS, table=TABLE, chamber=chamber, safe=SafeSection(), gyro=())
    bench = Bench(file, clock, record, AssumeYes())
    table = Device(clock, log, "table", TableState(10.0, 0.0))
    chamber = Device(clock, log, "chamber", ChamberState(25.0, 25.0, {1: 24.5}))
    bench.install(table, chamber, (1,))
    yield SimpleNamespace(bench=bench, clock=clock, log=log, record=record, table=table, chamber=chamber)
    clock.interrupt.close()


def test_telemetry_is_polled_every_second_while_waiting(made):
    made.bench.wait(10.0)
    assert made.clock.now() == pytest.approx(10.0, abs=0.041)
    rows = made.bench.chamber.history.since(0.0)
    assert np.floor(rows["time_s"]).tolist() == list(range(11))
    assert np.all(rows["time_s"] % 1.0 < 0.041)
    assert rows["aux_1_temp_c"].tolist() == [24.5] * 11
    assert len(made.record.kept) == 11
    # Both are asked before either answer is awaited.
    assert [line.split()[1] for line in made.log[:4]] == ["asked", "asked", "read", "read"]


def test_a_hole_in_the_record_is_an_alarm_and_makes_the_run_invalid_while_it_goes_on(made):
    hole = Invalid("record_hole", "bytes are lost", {"file": "fog.bin", "from_s": 1.0})
    made.record.holes = [[], [hole]]
    made.bench.wait(5.0)
    assert made.bench.invalid_reasons == [hole]
    assert [time_s for time_s, kind, _ in made.record.rows if kind == "invalid"] == [
        pytest.approx(1.0, abs=0.041)
    ]
    assert len(made.record.kept) == 6


def test_time_that_passes_over_the_bench_is_an_alarm_then_the_end(made):
    made.bench.wait(3.0)
    made.clock.ns += 6_000_000_000  # the machine stood still
    made.bench.wait(3.0)
    ((code, facts),) = [(row["code"], row["facts"]) for row in made.record.of("alarm")]
    assert code == "poll_gap" and facts["late_s"] == pytest.approx(5.0, abs=0.1)
    made.clock.ns += 12_000_000_000
    with pytest.raises(RunAborted, match="nobody watched"):
        made.bench.wait(3.0)
    assert [reason.code for reason in made.bench.invalid_reasons] == ["unwatched"]


def test_an_instrument_that_answers_one_question_late_makes_the_run_invalid_from_when_it_was_well(made):
    answers = iter([True, False, True])
    made.chamber.in_step = lambda: next(answers)
    made.chamber.link = SimpleNamespace(clock=made.clock, retries=2, retrying=False)
    made.bench.wait(200.0)
    (reason,) = made.record.of("invalid")
    assert reason["code"] == "stale_telemetry"
    assert reason["facts"] == {"device": "chamber", "from_s": pytest.approx(60.0, abs=0.1)}
    assert not list(answers)


def test_an_instrument_that_only_answers_earlier_questions_ends_the_run(made):
    def late():
        raise ProtocolError("answers to earlier questions come")

    made.table.in_step = late
    quiet = {"drain": lambda: b"", "fence": late, "on_retry": lambda error: None}
    made.table.link = SimpleNamespace(clock=made.clock, retries=2, retrying=False, **quiet)
    with pytest.raises(ProtocolError):
        made.bench.wait(100.0)
    assert [row["code"] for row in made.record.of("invalid")] == ["stale_telemetry"]


def test_wait_until_sees_every_poll_and_says_whether_it_came(made):
    seen = []

    def condition():
        seen.append(made.clock.now())
        return len(seen) == 5

    assert made.bench.wait_until(condition, timeout_s=100.0, what="") is True
    assert made.clock.now() < 6.0
    assert made.bench.wait_until(lambda: False, timeout_s=5.0, what="") is False


@pytest.mark.parametrize(
    ("table", "air_c", "words"),
    [
        (TableState(0.0, 21.5), 25.0, "turns faster"),
        (TableState(0.0, -21.5), 25.0, "turns faster"),
        (TableState(0.0, 0.0), -70.5, "outside the allowed range"),
        (TableState(0.0, 0.0), 95.5, "outside the allowed range"),
    ],
)
def test_telemetry_beyond_the_limits_ends_the_wait(made, table, air_c, words):
    made.table.state, made.chamber.state = table, ChamberState(air_c, 25.0, {1: 25.0})
    with pytest.raises(LimitExceeded, match=words):
        made.bench.wait(5.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("share", "refused"), [(1.195, False), (1.205, True)])
def test_the_ramp_is_the_change_within_a_minute_and_a_fifth_more_is_allowed(
    made, monkeypatch, sign, share, refused
):
    """A step is a minute's whole change, whenever it is looked at: at 59 s the one would be too fast,
    at 61 s the other would not."""
    step_k = sign * share * LIMITS.max_ramp_k_per_min

    def state(device):
        device.clock.ns += 20_000_000
        return ChamberState(25.0 + (step_k if device.clock.now() > 200.0 else 0.0), 25.0, {1: 25.0})

    monkeypatch.setattr(made.chamber, "read_state", lambda: state(made.chamber))
    if not refused:
        made.bench.wait(400.0)
        return
    with pytest.raises(LimitExceeded, match="changes faster"):
        made.bench.wait(400.0)
    assert 200.0 < made.clock.now() < 202.0


def test_alarms_are_asked_once_a_minute_recorded_and_end_the_run(made):
    made.bench.wait(59.0)
    made.chamber.faults = ["alarm: door open", "alarm: fan"]
    with pytest.raises(RunAborted, match="the chamber reports a fault") as fault:
        made.bench.wait(60.0)
    assert fault.value.found == "alarm: door open; alarm: fan"
    assert made.clock.now() < 62.0
    assert made.record.of("alarm") == [
        {"device": "chamber", "text": "alarm: door open", "code": "device"},
        {"device": "chamber", "text": "alarm: fan", "code": "device"},
    ]


def test_an_interrupt_ends_a_wait_and_does_not_stop_the_making_safe(made):
    made.clock.stop_at_s = 3.0
    with pytest.raises(RunAborted, match="Ctrl-C"):
        made.bench.wait(100.0)
    assert made.clock.now() < 4.1
    made.log.clear()
    assert made.bench.make_safe("stopped by Ctrl-C") is True
    assert made.log == [*TOLD, "table rest", "chamber rest"]
    made.clock.interrupt.check()
    why = {"state": "confirmed", "cause": "trouble", "why": "stopped by Ctrl-C"}
    assert made.record.of("safe_state") == [
        {"device": "table", **why, "rates_dps": {"table": 0.0}},
        {"device": "chamber", **why, "running": False, "set_point_c": 25.0},
    ]


def test_safe_is_what_is_read_back_not_what_was_confirmed(made):
    made.table.rests = [Rest(rate == 0.0, {"table": rate}) for rate in (9.0, 4.0, 0.0)]
    assert made.bench.make_safe("a test") is True
    assert made.log.count("table rest") == 3
    made.chamber.rests = [Rest(False, running=True, set_point_c=25.0)]
    assert made.bench.make_safe("a test") is False
    table, chamber = made.bench.safe
    assert table.confirmed and (chamber.state, chamber.code) == ("not_confirmed", "not_at_rest")
    assert (chamber.running, chamber.set_point_c) == (True, 25.0)
    assert str(chamber) == "chamber: it took the command and is not at rest: running, set point 25 degC"
    assert made.record.of("safe_state")[-2:] == [table.fields(), chamber.fields()]


@pytest.mark.parametrize("call", ["make_safe", "read_rest", "sleep"])
def test_a_port_lost_meanwhile_does_not_keep_the_instruments_from_being_stopped(made, monkeypatch, call):
    """Whoever waits is told of any port that goes away: a gyro's loss must not be taken for the table's."""
    target = made.clock if call == "sleep" else made.table
    real, losses = getattr(target, call), [LinkLost("the port is gone", where="fog_1")]

    def losing(*arguments):
        if losses:
            raise losses.pop()
        return real(*arguments)

    monkeypatch.setattr(target, call, losing)
    assert made.bench.make_safe("a test") is True
    assert losses == [] and all(state.confirmed for state in made.bench.safe)
    assert list(map(str, made.bench.safe)) == [
        "table at rest: 0.0000 deg/s",
        "chamber at rest: stopped, set point 25 degC",
    ]


def test_an_instrument_whose_own_port_is_gone_is_looked_for_when_the_others_rest(made, monkeypatch):
    def gone():
        raise LinkLost("the port is gone", where="table")

    made.table.state = TableState(10.0, 7.0)
    made.bench.wait(1.5)
    made.log.clear()
    shown = []
    made.bench._displays = Displays([lambda progress: shown.append((progress, tuple(made.log)))], print)
    for call in ("halt", "make_safe", "read_rest"):
        monkeypatch.setattr(made.table, call, gone)
    assert made.bench.make_safe("a test") is False
    first, told = shown[0]
    assert "chamber safe" in told  # a terminal that is slow keeps nobody from being told
    assert "chamber rest" not in told
    assert "table: its port is gone" in first.doing and len(shown) > 20
    pending, chamber, table = made.record.of("safe_state")
    assert (pending["device"], pending["state"], pending["code"]) == ("table", "pending", "port_gone")
    assert pending["why"] == "a test" and pending["last_seen"]["rates_dps"] == {"table": 7.0}
    assert pending["last_seen"]["ago_s"] == pytest.approx(0.5, abs=0.1)
    assert {"time_s": first.alarms[-1]["time_s"], "kind": "safe_state"} | pending == first.alarms[-1]
    assert (table["device"], table["state"], table["code"]) == ("table", "not_confirmed", "port_gone")
    assert table["last_seen"]["ago_s"] == pytest.approx(20.5, abs=0.5)
    assert str(made.bench.safe[1]) == (
        "table: its port is gone and has not come back (21 s ago it turned at 7.000 deg/s)"
    )
    assert (chamber["device"], chamber["state"]) == ("chamber", "confirmed")
    assert made.log.index("chamber rest") < made.log.index("table looked for")
    assert made.clock.now() < 27.0


def test_a_way_to_the_safe_state_that_is_cut_off_is_not_confirmed(made, monkeypatch):
    monkeypatch.setattr(made.chamber, "make_safe", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        made.bench.make_safe("a test")
    assert [state.code for state in made.bench.safe] == ["cut_off", "cut_off"]
    assert not any(state.confirmed for state in made.bench.safe)


@pytest.mark.parametrize("silent", ["table", "chamber"])
def test_a_device_that_does_not_answer_does_not_keep_the_other_from_being_told(made, silent):
    getattr(made, silent).silent = True
    assert made.bench.make_safe("a test") is False
    again = [f"{silent} safe"] * 2
    other = "chamber" if silent == "table" else "table"
    first = [*TOLD, *again, f"{other} rest"]
    assert made.log[: len(first)] == first
    assert set(made.log[len(first) :]) == {f"{silent} safe"} and 60.0 <= made.clock.now() < 65.0  # told on
    pending, _, last = made.record.of("safe_state")
    assert (pending["device"], pending["state"], pending["code"]) == (silent, "pending", "not_confirming")
    assert (last["device"], last["state"], last["code"]) == (silent, "not_confirmed", "silent")
    assert last["error"] == f"{silent} is silent."


def test_a_question_is_recorded_with_its_answer_and_act_and_no_ends_the_run(made):
    assert made.bench.ask("Mounted?", act="mount", mounting="axis_up") == "yes"
    assert made.record.of("prompt") == [{"question": "Mounted?"}]
    assert made.record.of("answer") == [
        {
            "question": "Mounted?",
            "answer": "yes",
            "by": "answered beforehand",
            "act": "mount",
            "mounting": "axis_up",
        }
    ]
    answers = iter([None, None, None, Reply(" No ", "n")])
    made.bench.operator = SimpleNamespace(ask=lambda question: lambda: next(answers))
    before = made.clock.now()
    with pytest.raises(RunAborted, match="answered ' No '"):
        made.bench.ask("Ready?")
    assert made.clock.now() > before  # telemetry went on while nobody had answered


class Human:
    """Asks for a pause at once and for its end after some breaths."""

    def __init__(self, breaths):
        self.pause_wanted, self.breaths = "Ann", breaths
        self.asked = [Requested("pause", "Ann", "t1")]

    def take(self):
        asked, self.asked = self.asked, []
        return asked

    def wait(self):
        self.breaths -= 1
        if not self.breaths:
            self.pause_wanted = ""
            self.asked.append(Requested("resume", "Bob", "t2"))


def test_a_pause_comes_before_the_next_step_and_telemetry_goes_on(made):
    made.bench._steering = Human(breaths=26)
    made.bench.wait(3.0)  # within a step nothing stands still
    assert made.record.of("paused") == []
    with made.bench.step("S2", "Shock"):
        assert made.clock.now() == pytest.approx(3.0 + 5.2, abs=0.1)
    kinds = [kind for _, kind, _ in made.record.rows]
    assert kinds == ["request", "paused", "request", "resumed", "step"]
    assert made.record.of("resumed") == [{"by": "Bob"}]
    assert len(made.bench.chamber.history) >= 8
    assert not made.bench.progress("").paused
    assert [row["kind"] for row in made.bench.progress("").log] == kinds


def test_measurements_are_judged_against_their_limits(made):
    assert made.bench.measure("a", 1.0, "K", low=1.0, high=2.0) is True
    assert made.bench.measure("b", 2.1, "K", high=2.0) is False
    assert made.bench.measure("c", 0.9, "K", low=1.0) is False
    assert made.bench.measure("d", float("nan"), "K", low=1.0) is False
    made.bench.measure("e", 1.0, "K")
    assert [measured.passed for measured in made.bench.measurements] == [True, False, False, False, None]
    with pytest.raises(ConfigurationError, match="no such quantity of a bench") as refused:
        made.bench.measure("f", 1.0, "K", basis=Basis(inputs={"time_base_ppm": 1.0, "time_base": 1.0}))
    assert (refused.value.where, refused.value.found) == ("f", "time_base")
    made.bench.measure("g", 1.0, "K", basis=Basis("air_temperature", since_s=2.0))
    assert made.record.of("measurement")[-1]["basis"] == {
        "of": "air_temperature",
        "since_s": 2.0,
        "inputs": {},
    }
    made.bench.invalidate("too slow", "shock_too_slow", rate_k_per_min=8.25)
    assert made.bench.invalid_reasons == [Invalid("shock_too_slow", "too slow", {"rate_k_per_min": 8.25})]
    assert made.record.of("invalid")[-1] == made.bench.invalid_reasons[-1].fields()
