"""The queue of a bench: its file, its orders, and that each is started once, whoever looks after it."""

import json
import select
import subprocess
import threading
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import pytest

from bench.campaign.queue import BenchQueue, CampaignOrder, HuntOrder, Preset, Presets, ResumeOrder, RunOrder
from bench.campaign.queue import _work as work
from bench.control.lease import take_lease
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_text
from drivers.base.errors import BenchInUse, ConfigurationError, RecordError

NOON = datetime(2026, 11, 23, 12, tzinfo=UTC)
TURN = RunOrder(procedure="constant-rotation", parameters={"turns": 1, "rest_s": 10, "rate_dps": 12.0})
HOME = RunOrder(procedure="known-state")


class Time:
    """The time of day, as a test sets it."""

    def __init__(self):
        self.now = NOON

    def __call__(self):
        return self.now


class Processes:
    """Stands in for `subprocess.Popen`: every start is listed, and its process lives until it is ended here."""

    def __init__(self, monkeypatch):
        self.commands, self._numbers, self.alive = [], count(1_000_000), {}
        monkeypatch.setattr(work.subprocess, "Popen", self)
        monkeypatch.setattr(work, "process_start", lambda pid: self.alive.get(pid, 0))

    def __call__(self, command, stdout, **options):
        assert options["start_new_session"] and options["stdin"] == subprocess.DEVNULL
        self.commands.append(command[command.index("gyrobench") + 1 :])
        self.pid, self.said = next(self._numbers), stdout.name
        self.alive[self.pid] = 7
        return self

    def poll(self):
        return None

    def wait(self, timeout):
        assert self.pid not in self.alive
        return 0

    def end(self, **result):
        """End the process that was started last, with its last line."""
        del self.alive[self.pid]
        with Path(self.said).open("a") as file:
            file.write(
                json.dumps({"kind": "progress"}) + "\n" + json.dumps({"kind": "result"} | result) + "\n"
            )


def work_with(queue, together):
    together.wait()
    queue.work()


@pytest.fixture
def time():
    return Time()


@pytest.fixture
def queue(tmp_path, bench_path, time):
    return BenchQueue(tmp_path / "runs", bench_path, time)


@pytest.fixture
def processes(monkeypatch):
    return Processes(monkeypatch)


def again(queue, time):
    """Another process that looks after the same queue, or the same after it was killed."""
    return BenchQueue(queue.runs, queue.bench_file, time)


def test_a_new_queue_starts_nothing_until_somebody_lets_it_go(queue, processes):
    queue.add(TURN, "Ada")
    assert queue.state().held.why == "new" and not queue.work() and processes.commands == []
    queue.let_go("Ada")
    assert queue.work()
    assert processes.commands[0][:2] == ["run", "constant-rotation"]
    words = " ".join(processes.commands[0][-9:])
    assert words == "--set turns=1 --set rest_s=10 --set rate_dps=12.0 --by Ada --json"
    assert not queue.work() and len(processes.commands) == 1


def test_the_order_is_the_operators(queue, time):
    first, second, third = (queue.add(order, "Ada") for order in (TURN, HOME, TURN))
    queue.move(third.id, 0)
    queue.remove(first.id)
    queue.edit(second.id, TURN.model_copy(update={"parameters": {"turns": 3}}), "Bob", NOON)
    state = again(queue, time).state()
    assert [item.id for item in state.waiting] == [third.id, second.id]
    assert (state.waiting[1].by, state.waiting[1].order.parameters) == ("Bob", {"turns": 3})
    with pytest.raises(ConfigurationError, match="not in the queue any more"):
        queue.remove(first.id)
    with pytest.raises(ConfigurationError, match="no name"):
        queue.add(TURN, " ")


def test_a_command_says_who_and_as_what_they_were_signed_in(queue, processes):
    queue.start(queue.add(HOME, "Ada", role="run").id, "Cyd", "configure")
    assert processes.commands[0][-5:] == ["--by", "Cyd", "--signed-in-as", "configure", "--json"]


def test_one_after_the_other_and_held_after_a_bad_end(queue, processes):
    for _ in range(4):
        queue.add(TURN, "Ada")
    queue.let_go("Ada")
    for outcome in ("completed", "invalid", "aborted"):
        queue.work()
        processes.end(outcome=outcome, reason="a reason", folder="/runs/x")
    queue.work()
    state = queue.state()
    assert [item.ended.outcome for item in state.ended] == ["aborted", "invalid", "completed"]
    assert state.ended[0].ended.detail == "a reason"
    assert (state.held.why, state.current, len(state.waiting)) == ("ended_badly", None, 1)
    assert len(processes.commands) == 3


def test_a_start_at_a_time_waits_for_it_and_so_do_those_behind(queue, processes, time):
    queue.add(TURN, "Ada", NOON + timedelta(minutes=5))
    queue.add(HOME, "Ada")
    queue.let_go("Ada")
    for minute in range(5):
        time.now = NOON + timedelta(minutes=minute)
        queue.work()
    assert processes.commands == []
    time.now = NOON + timedelta(minutes=5)
    queue.work()
    assert [command[1] for command in processes.commands] == ["constant-rotation"]


def test_an_item_is_started_by_hand_also_of_a_queue_that_is_held(queue, processes, bench_file):
    first, second = queue.add(TURN, "Ada"), queue.add(HOME, "Ada")
    with take_lease(bench_file, "something else"), pytest.raises(BenchInUse, match="something else"):
        queue.start(second.id, "Bob")
    queue.start(second.id, "Bob")
    assert queue.state().current.started.by == "Bob" and processes.commands[0][1] == "known-state"
    with pytest.raises(BenchInUse, match="a run of this queue goes on"):
        queue.start(first.id, "Bob")
    processes.end(outcome="completed")
    queue.work()
    queue.work()
    assert len(processes.commands) == 1 and queue.state().held.why == "new"


def test_a_bench_that_somebody_else_has_is_waited_for(queue, processes, bench_file):
    queue.add(TURN, "Ada")
    queue.let_go("Ada")
    with take_lease(bench_file, "by hand"):
        assert not queue.work()
    assert queue.work() and len(processes.commands) == 1


def test_of_many_that_look_after_a_queue_one_starts_an_item(queue, processes, time):
    for round_ in range(10):
        queue.add(TURN, "Ada")
        queue.let_go("Ada")
        panels = [again(queue, time) for _ in range(8)]
        together = threading.Barrier(len(panels))
        threads = [threading.Thread(target=work_with, args=(one, together)) for one in panels]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(processes.commands) == round_ + 1
        processes.end(outcome="completed")
        queue.work()


def test_who_is_killed_while_starting_leaves_it_unclear_and_nothing_is_started_twice(
    queue, time, monkeypatch
):
    class Killed(BaseException):
        pass

    def killed(*_, **__):
        raise Killed

    queue.add(TURN, "Ada")
    queue.add(HOME, "Ada")
    queue.let_go("Ada")
    monkeypatch.setattr(work.subprocess, "Popen", killed)
    with pytest.raises(Killed):
        queue.work()
    processes, next_one = Processes(monkeypatch), again(queue, time)
    next_one.work()
    next_one.work()
    state = next_one.state()
    assert state.ended[0].ended.outcome == "unclear" and state.held.why == "ended_badly"
    assert processes.commands == [] and len(state.waiting) == 1


def test_another_panel_finds_what_goes_on_and_goes_on_behind_it(queue, processes, time):
    for _ in range(2):
        queue.add(TURN, "Ada")
    queue.let_go("Ada")
    queue.work()
    other = again(queue, time)
    time.now += timedelta(minutes=5)
    assert not other.state().waiting[1:]
    other.work()
    assert len(processes.commands) == 1
    processes.end(outcome="completed")
    time.now += timedelta(minutes=5)
    other.work()
    assert len(processes.commands) == 2


def test_a_queue_that_nobody_attended_to_is_held(queue, processes, time):
    for _ in range(2):
        queue.add(TURN, "Ada")
    queue.let_go("Ada")
    queue.work()
    processes.end(outcome="completed")
    time.now += timedelta(hours=3)
    again(queue, time).work()
    assert queue.state().held.why == "left_alone" and len(processes.commands) == 1
    queue.let_go("Ada")
    queue.work()
    assert len(processes.commands) == 2
    processes.end(outcome="completed")
    queue.work()
    time.now += timedelta(hours=3)  # an empty queue is not left alone
    queue.add(TURN, "Ada")
    queue.work()
    assert len(processes.commands) == 3


def test_campaigns_are_begun_and_resumed(queue, processes, campaign_path):
    queue.add(CampaignOrder(file=campaign_path, title="Short turns", out="lot-12"), "Ada")
    queue.add(ResumeOrder(folder=queue.runs / "lot-12", title="Short turns"), "Ada")
    queue.let_go("Ada")
    queue.work()
    processes.end(outcome="completed")
    queue.work()
    bench, out = str(queue.bench_file), str(queue.runs / "lot-12")
    assert processes.commands == [
        ["campaign", "run", str(campaign_path), "--bench", bench, "--out", out, "--by", "Ada", "--json"],
        ["campaign", "resume", out, "--by", "Ada", "--json"],
    ]


def test_searches_are_begun_and_gone_on_with(queue, processes, tmp_path):
    model = tmp_path / "nominal.toml"
    order = HuntOrder(model=model, title="search", out="search-1", budget_h=20.0, until=0.95)
    queue.start(queue.add(order, "Ada").id, "Ada")
    words = ["gap", "hunt", "--bench", str(queue.bench_file), "--out", str(queue.runs / "search-1")]
    asked = ["--model", str(model), "--budget-h", "20", "--until", "0.95"]
    assert processes.commands[0] == [*words, *asked, "--by", "Ada", "--json"]
    processes.end(outcome="aborted", reason="Ada pressed abort", folder=str(queue.runs / "search-1"))
    queue.work()
    queue.start(queue.add(order.model_copy(update={"model": None}), "Bob").id, "Bob")
    assert processes.commands[1] == [*words, "--by", "Bob", "--json"]


def test_a_process_that_says_nothing(queue, processes):
    for _ in range(2):
        queue.add(TURN, "Ada")
    queue.let_go("Ada")
    queue.work()
    del processes.alive[processes.pid]
    queue.work()
    assert queue.state().ended[0].ended.outcome == "lost"
    queue.let_go("Ada")
    queue.work()
    del processes.alive[processes.pid]
    Path(processes.said).with_suffix(".txt").write_text("error: the bench is in use\n")
    queue.work()
    ended = queue.state().ended[0].ended
    assert (ended.outcome, ended.detail) == ("refused", "error: the bench is in use")


@pytest.mark.parametrize(
    "content", ["", "{", "[]", '{"format": 2}', '{"bench": "x", "waiting": [1]}', "\x00" * 99]
)
def test_a_file_that_is_no_queue_starts_nothing(queue, processes, content):
    queue.add(TURN, "Ada")
    (path,) = (queue.runs / ".queue").glob("*.json")
    path.write_text(content)
    with pytest.raises(RecordError, match="the queue cannot be read"):
        queue.work()
    assert processes.commands == []


def test_presets_have_a_name_within_their_procedure(tmp_path):
    presets = Presets(tmp_path)
    presets.save(Preset(name="lot 12", procedure="known-state", parameters={"air_c": 30.0}, by="Ada"))
    presets.save(Preset(name="lot 12", procedure="thermal-ramp", by="Ada"))
    presets.save(Preset(name="lot 12", procedure="known-state", parameters={"air_c": 31.0}, by="Bob"))
    found = {preset.procedure: preset.parameters for preset in Presets(tmp_path).all()}
    assert found == {"known-state": {"air_c": 31.0}, "thermal-ramp": {}}
    presets.remove("known-state", "lot 12")
    with pytest.raises(ConfigurationError, match="no such preset"):
        presets.remove("known-state", "lot 12")


@pytest.mark.concurrent
@pytest.mark.slow
def same_bytes(*folders):
    """Check that the one run of each folder received and noted the same."""
    recorded = []
    for runs in folders:
        (run,) = runs.glob("*/manifest.json")
        raw = {path.name: path.read_bytes() for path in (run.parent / "raw").iterdir()}
        events = [json.loads(line) for line in (run.parent / "events.jsonl").read_text().splitlines()]
        recorded.append((raw, events))
    (one, one_events), (other, other_events) = recorded
    assert one.keys() == other.keys() and any(len(content) > 10_000 for content in one.values())
    assert [name for name in one if one[name] != other[name]] == []
    assert one_events == other_events


def test_a_run_from_the_queue_is_byte_for_byte_the_one_from_the_command_line(bench_file, tmp_path, gyrobench):
    """The same seed, two fresh labs: one run is typed, the other comes from the queue."""
    recorded = []
    for name in ("typed", "queued"):
        runs, path = tmp_path / name, tmp_path / f"{name}.toml"
        with EmulatedLab(bench_file, Plant(seed=11), clock="virtual", apart=True) as lab:
            path.write_text(bench_file_text(lab.file))
            queue = BenchQueue(runs, path)
            item = queue.add(RunOrder(procedure="known-state", parameters={"angle_deg": 30.0}), "Ada")
            if name == "typed":
                words = [
                    "run",
                    "known-state",
                    "--bench",
                    path,
                    "--runs",
                    runs,
                    "--set",
                    "angle_deg=30.0",
                    "--by",
                    "Ada",
                ]
                assert gyrobench(*words, "--json").wait() == 0
            else:
                queue.start(item.id, "Ada")
                while (state := queue.state()).current is not None:
                    queue.work()
                    select.select([], [], [], 0.05)
                assert state.ended[0].ended.outcome == "completed", state.ended[0].ended
        recorded.append(runs)
    same_bytes(*recorded)
