"""The parts of the panel without a browser: curves, tails, folders, access, what it tells the operator."""

import asyncio
import json
import math
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bench.control.live import read_now
from bench.control.process import process_start
from bench.present.panel import PanelSettings
from bench.present.panel._access import COOKIE, Access
from bench.present.panel._advice import Situation, banner, nothing_yet
from bench.present.panel._benches import Benches
from bench.present.panel._folders import RunsFolder
from bench.present.panel._series import MinMax
from bench.present.panel._tails import EventTail, HistoryTail
from bench.present.panel._texts import count, duration, number, texts
from bench.present.panel._watch import Watch
from bench.present.sentences import event_of, sentence
from bench.record.events.run import (
    AirDemand,
    Alarm,
    AngleDemand,
    Answer,
    Invalid,
    Measured,
    Outcome,
    RateDemand,
    Requested,
)
from bench.record.events.safe import LastSeen, SafeState, Takeover, TakeoverEnded
from drivers.base.clock import host_seconds
from drivers.base.errors import ConfigurationError

# Curves


@given(
    st.lists(
        st.tuples(st.floats(0.0, 50.0), st.one_of(st.none(), st.floats(-1e6, 1e6))), min_size=1, max_size=300
    ),
    st.integers(4, 40),
)
def test_a_growing_curve_keeps_the_extremes_of_everything_in_bounded_memory(steps, capacity) -> None:
    curve = MinMax(1, 1.0, capacity, growing=True)
    time_s = 0.0
    for step_s, value in steps:
        time_s += step_s
        curve.add(time_s, [value])
    rows = curve.rows()
    assert 0 < len(rows) <= capacity
    assert [row[0] for row in rows] == sorted({row[0] for row in rows})
    values = [value for _, value in steps if value is not None]
    lows, highs = (
        [row[1] for row in rows if row[1] is not None],
        [row[2] for row in rows if row[2] is not None],
    )
    if values:
        assert min(lows) == pytest.approx(min(values), rel=1e-7)
        assert max(highs) == pytest.approx(max(values), rel=1e-7)
    assert abs(rows[-1][0] - time_s) <= curve.width_s


def test_one_spike_in_a_day_at_ten_hertz_is_in_the_curve() -> None:
    curve = MinMax(1, 1.0, 480, growing=True)
    for tick in range(0, 864_000):
        curve.add(0.1 * tick, [1000.0 if tick == 400_000 else 0.0])
    assert (
        len(curve) <= 480 and curve.width_s == 256.0
    )  # the least power of two with 86,400 s in 480 stretches
    assert [row[2] for row in curve.rows()].count(1000.0) == 1


def test_a_window_forgets_the_oldest_and_leaves_out_what_is_no_number() -> None:
    curve = MinMax(2, 1.0, 3, growing=False)
    for second in range(5):
        curve.add(second, [second, math.nan if second < 4 else 7.0])
    curve.add(1.0, [99.0, 99.0])  # time that goes back
    assert curve.rows() == [[2.5, 2, 2, None, None], [3.5, 3, 3, None, None], [4.5, 4, 4, 7, 7]]
    assert curve.rows(len(curve) - 1) == [[4.5, 4, 4, 7, 7]]


# Tails


def test_events_are_read_as_they_grow_and_half_a_line_waits_for_its_other_half(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    tail = EventTail(path)
    assert not tail.update()
    line = json.dumps({"time_s": 1, "kind": "note", "text": "a"})
    path.write_text(f"{line}\n{line[:10]}")
    assert tail.update() and len(tail.lines) == 1
    with path.open("a") as file:
        file.write(f"{line[10:]}\nnot json\n")
    assert tail.update() and [row["text"] for row in tail.lines] == ["a", "a"]
    assert not tail.update()


def test_a_long_event_log_is_read_from_its_end(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    with path.open("w") as file:
        for number_ in range(200_000):
            file.write(json.dumps({"time_s": number_, "kind": "note", "text": "x" * 20}) + "\n")
    tail = EventTail(path)
    assert tail.update()
    assert tail.lines[-1]["time_s"] == 199_999 and len(tail.lines) == 200


def test_a_day_of_history_is_thinned_and_what_comes_is_read_in_full(tmp_path: Path) -> None:
    (tmp_path / "live").mkdir()
    path = tmp_path / "live" / "history.jsonl"
    with path.open("w") as file:
        file.writelines(
            json.dumps({"time_s": s, "air_temp_c": 20.0, "pad": "p" * 80}) + "\n" for s in range(86_400)
        )
    tail = HistoryTail(tmp_path)
    rows = tail.update()
    times = [row["time_s"] for row in rows]
    assert times == sorted(set(times)) and times[0] == 0 and times[-1] == 86_399
    assert len(rows) < 5000 and max(b - a for a, b in pairwise(times)) < 120
    with path.open("a") as file:
        file.write('{"time_s": 86400}\n{"time_s"')
    assert [row["time_s"] for row in tail.update()] == [86_400]
    assert tail.update() == []


# Folders


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    root = tmp_path / "runs"
    for day, name in enumerate(("campaign/runs/two", "one"), start=1):
        folder = root / name
        folder.mkdir(parents=True)
        (folder / "manifest.json").write_text(
            json.dumps({"run_id": folder.name, "procedure": "p", "started_utc": f"2026-01-0{day}"})
        )
    (root / "one" / "report.html").write_text("<p>one</p>")
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "report.html").write_text("secret")
    (tmp_path / "secret" / "manifest.json").write_text("{}")
    return root


def test_the_runs_of_a_rehearsal_are_sessions_and_those_of_a_campaign_are_not(tmp_path: Path) -> None:
    for name in ("rehearsal/runs/a", "rehearsal/runs/b", "campaign", "single"):
        (tmp_path / name / "live").mkdir(parents=True)
        (tmp_path / name / "live" / "now.json").write_text('{"format": 1}')
    (tmp_path / "campaign/runs/a/live").mkdir(parents=True)  # holds its history only
    found = {str(path.relative_to(tmp_path)) for path in RunsFolder(tmp_path).sessions()}
    assert found == {"rehearsal/runs/a", "rehearsal/runs/b", "campaign", "single"}
    own = RunsFolder(tmp_path / "rehearsal")
    assert len(own.sessions()) == 2 and own.session("runs/a") is not None


@pytest.mark.parametrize(
    "name",
    [
        "../secret",
        "one/../../secret",
        "/etc",
        "",
        ".",
        "one/..",
        "link",
        "one/linked",
        "\0",
        "none",
        "~",
        "....//secret",
    ],
)
def test_no_name_leads_out_of_the_runs_folder(runs: Path, name: str) -> None:
    (runs / "link").symlink_to(runs.parent / "secret")
    (runs / "one" / "linked").symlink_to(runs.parent / "secret" / "report.html")
    folder = RunsFolder(runs)
    assert folder.inside(name) is None and folder.page_in(name, "report.html") is None


def test_a_report_that_is_a_link_out_is_not_served(runs: Path) -> None:
    (runs / "one" / "report.html").unlink()
    (runs / "one" / "report.html").symlink_to(runs.parent / "secret" / "report.html")
    assert RunsFolder(runs).page_in("one", "report.html") is None


def test_a_session_cannot_point_the_panel_elsewhere(runs: Path) -> None:
    folder = RunsFolder(runs)
    assert folder.within(runs.parent / "secret") is None
    assert folder.within(runs / "one") == (runs / "one").resolve()


def test_history_has_runs_and_the_runs_of_campaigns(runs: Path) -> None:
    assert [entry.name for entry in RunsFolder(runs).history()] == ["one", "campaign/runs/two"]
    assert RunsFolder(runs).page_in("one", "report.html") is not None
    (runs / "one" / "manifest.json").write_text("{")
    entry = next(entry for entry in RunsFolder(runs).history() if entry.name == "one")
    assert entry.manifest is None and "cannot be read" in entry.problem


# Access


def ask(
    access: Access, *, kind: str = "http", query: str = "", **headers: str
) -> tuple[int, dict[str, str], bool]:
    """Send one request; return status (or close code), headers, and whether it was let through."""
    sent: list[dict] = []
    scope = {
        "type": kind,
        "path": "/",
        "query_string": query.encode(),
        "scheme": "http",
        "headers": [(name.lower().encode(), text.encode("latin-1")) for name, text in headers.items()],
    }

    async def send(message) -> None:
        sent.append(message)

    async def receive():
        return {}

    asyncio.run(access(scope, receive, send))
    first = sent[0]
    found = {name.decode(): text.decode() for name, text in first.get("headers", [])}
    return first.get("status", first.get("code", 0)), found, first["type"] == "through"


async def inner(scope, receive, send) -> None:
    await send({"type": "through", "status": 200})


TOKEN = "0123456789abcdef-good"


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_the_token_nothing_is_served(kind: str) -> None:
    access = Access(inner, TOKEN)
    refused = 401 if kind == "http" else 4401
    for headers in ({}, {"cookie": f"{COOKIE}=wrong"}, {"authorization": "Bearer "}, {"cookie": "\xff=;;"}):
        status, _, through = ask(access, kind=kind, host="bench:1", **headers)
        assert (status, through) == (refused, False)
    assert ask(access, kind=kind, host="bench:1", authorization=f"Bearer {TOKEN}")[2]
    assert ask(access, kind=kind, host="bench:1", cookie=f"a=b; {COOKIE}={TOKEN}")[2]


def test_the_token_in_the_address_becomes_a_cookie_and_leaves_the_address() -> None:
    access = Access(inner, TOKEN)
    status, headers, through = ask(access, host="bench:1", query=f"token={TOKEN}&a=1")
    assert (status, through) == (303, False) and headers["location"] == "/?a=1"
    assert "HttpOnly" in headers["set-cookie"] and "SameSite=Strict" in headers["set-cookie"]
    assert ask(access, host="bench:1", query="token=wrong")[0] == 401
    assert not ask(access, kind="websocket", host="bench:1", query=f"token={TOKEN}")[2]


def test_another_sites_page_cannot_reach_a_panel_on_this_machine() -> None:
    access = Access(inner, None)
    assert ask(access, host="127.0.0.1:8765")[2] and ask(access, host="[::1]:8765")[2]
    assert ask(access, host="localhost:8765", origin="http://localhost:8765")[2]
    assert ask(access, host="evil.example:8765")[0] == 403  # a name of theirs that resolves to 127.0.0.1
    for kind in ("http", "websocket"):
        assert not ask(access, kind=kind, host="127.0.0.1:8765", origin="https://evil.example")[2]
    assert not ask(access)[2]
    for host in ("[", "[::1", "127.0.0.1@evil.example", "127.0.0.1.evil.example", ":80"):
        assert ask(access, host=host)[0] == 403
    for origin in ("null", "http://[", "http://localhost:8765.evil.example", "http://localhost"):
        assert ask(access, host="localhost:8765", origin=origin)[0] == 403


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"host": "0.0.0.0"}, "needs a token"),
        ({"host": "::"}, "needs a token"),
        ({"host": "bench-3"}, "needs a token"),
        ({"token": "short"}, "easy to guess"),
        ({"host": "203.0.113.7", "token": TOKEN}, "cannot listen"),
        ({"runs": Path("/etc/hostname")}, "no runs folder"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(tmp_path: Path, settings: dict, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        PanelSettings(**({"runs": tmp_path, "port": 0} | settings)).check()


# What it says


def say(now, events, silent_s=0.0, **more):
    return banner(Situation(now, events, silent_s=silent_s, **more))


def test_idle_running_gone_silent() -> None:
    assert nothing_yet("/runs", False, False).word == "Idle"
    assert say({"state": "running", "alive": True}, [], 0.0).tone == "good"
    gone = say({"state": "running", "alive": False}, [], 0.0)
    assert gone.tone == "bad" and "Go and look" in gone.press
    silent = say({"state": "running", "alive": True}, [], 31.0)
    assert silent.tone == "bad" and "31 s" in silent.happened and "emergency stop" in silent.press


WHY = "the table reports a fault: interlock open."
TABLE = SafeState("table", "confirmed", "trouble", WHY, rates_dps={"table": 0.0})
CHAMBER = SafeState("chamber", "confirmed", "trouble", WHY, running=False, set_point_c=25.0)
SAFE = [Alarm("table", "interlock open"), TABLE, CHAMBER]
GONE = SafeState(
    "table", "not_confirmed", "trouble", WHY, code="port_gone", last_seen=LastSeen(21.0, {"table": 7.0})
)


def test_an_abort_says_why_what_was_done_and_that_nothing_is_urgent() -> None:
    now = {"state": "ended", "alive": False, "outcome": "aborted", "reason": "interlock open"}
    told = say(now, [*SAFE, Outcome("aborted", "interlock open")], 0.0)
    assert (told.word, told.happened) == ("Aborted", "interlock open")
    assert told.done == (
        "bench made safe; table at rest: 0.0000 deg/s; chamber at rest: stopped, set point 25 degC"
    )
    assert told.press.startswith("Nothing is urgent")
    closing = say({"state": "running", "alive": True}, SAFE, 0.0)
    assert (closing.word, closing.tone) == ("Closing", "bad") and "fault" in closing.happened
    end = [replace(state, cause="end_of_run", why="end of the run") for state in (TABLE, CHAMBER)]
    assert say({"state": "running", "alive": True}, end, 0.0).tone == "good"


def test_what_is_not_confirmed_safe_sends_the_operator_there() -> None:
    silent = SafeState("chamber", "not_confirmed", "trouble", "x", code="silent", error="it is silent.")
    for now in (
        {"state": "running", "alive": True},
        {"state": "ended", "alive": False, "outcome": "aborted", "reason": "x"},
    ):
        told = say(now, [SAFE[0], TABLE, silent], 0.0)
        assert told.tone == "bad" and told.press.startswith("GO AND LOOK")
        assert told.done == "not confirmed safe: chamber: it is silent; table at rest: 0.0000 deg/s"
    lost = {"state": "ended", "outcome": "aborted", "reason": "disk full", "safe": [silent.fields()]}
    assert "chamber: it is silent" in say(lost, [], 0.0).done  # the record could not be written


def test_a_port_that_is_gone_is_told_while_it_is_looked_for_and_forgotten_when_it_came_back() -> None:
    gone = replace(GONE, state="pending", why="the port is gone.")
    told = say({"state": "running", "alive": True, "alarms": [gone.row(1.0)]}, [gone], 0.0)
    assert (told.word, told.press[:11], told.happened) == (
        "Not confirmed safe",
        "GO AND LOOK",
        "The port is gone.",
    )
    assert "turned at 7.000 deg/s" in told.done and told.done.endswith("STOP IT BY HAND")
    back = say({"state": "ended", "outcome": "aborted", "reason": "x"}, [gone, *SAFE[1:]], 0.0)
    assert back.press.startswith("Nothing is urgent") and "gone" not in back.done
    moved = say({"state": "running", "alive": True}, [gone, AngleDemand("table", "table", 1.0)], 0.0)
    assert moved.word == "Running"  # it was told to go on since


def test_an_alarm_while_the_run_goes_on_says_that_nothing_was_stopped() -> None:
    now = {"state": "running", "alive": True, "alarms": [Alarm("chamber", "door open").row(1.0)]}
    told = say(now, [Alarm("chamber", "door open")], 0.0)
    assert told.word == "Alarm" and told.happened == "chamber: door open" and "goes on" in told.done


def test_a_run_already_invalid_does_not_look_well() -> None:
    alarms = [Invalid("unit_silent", "fog_1 fell silent at 1499.9 s", {"device": "fog_1"}).row(1.0)]
    told = say({"state": "running", "alive": True, "alarms": alarms}, [], 0.0)
    assert (told.tone, told.word) == ("doubt", "Running, invalid")
    assert told.happened == "fog_1 fell silent at 1499.9 s" and told.press.startswith("Nothing is urgent")
    air = Alarm("chamber", "the air stands at 25 degC: look at the chamber's panel", "air_stalled").row(2.0)
    running = say({"state": "running", "alive": True, "alarms": [*alarms, air]}, [], 0.0)
    assert running.word == "Alarm"
    ended = {"state": "ended", "outcome": "invalid", "reason": "too slow", "alarms": [air, *alarms]}
    assert say(ended, [], 0.0).press.endswith(
        "chamber: the air stands at 25 degC: look at the chamber's panel"
    )


def test_a_completed_run_shows_what_its_record_warns_of() -> None:
    now = {
        "state": "ended",
        "outcome": "completed",
        "warnings": ["fog_1: the measured sample rate is 10.1 Hz"],
    }
    told = say(now, SAFE[1:], 0.0)
    assert (told.tone, told.happened) == ("good", "fog_1: the measured sample rate is 10.1 Hz")
    assert say(now | {"warnings": []}, SAFE[1:], 0.0).happened == ""


def test_an_unplugged_table_is_said_once_and_before_what_is_safe() -> None:
    error = {
        "what": "the port is gone",
        "where": "table (/dev/ttyUSB0)",
        "found": "end of stream",
        "expected": "an open port",
        "remedy": "check cable, adapter and the device's power",
    }
    now = {"state": "ended", "outcome": "aborted", "reason": "all of it", "error": error}
    told = say(now, [CHAMBER, GONE], 0.0)
    assert (told.word, told.happened) == (
        "Not confirmed safe",
        "table (/dev/ttyUSB0): the port is gone. Found: end of stream. Expected: an open port.",
    )
    assert told.done == (
        "not confirmed safe: table: its port is gone and has not come back (21 s ago it turned at 7.000 deg/s); "
        "chamber at rest: stopped, set point 25 degC"
    )
    assert told.press.startswith("GO AND LOOK NOW: emergency stop")
    assert told.press.endswith("Check cable, adapter and the device's power.")


def test_every_kind_of_event_has_a_sentence_and_unknown_ones_too() -> None:
    assert sentence(Answer("Ready?", "yes", "Ada")) == "Ada answered yes"
    assert sentence(Measured("a_b", 2.0, "K", None, 1.0, False)) == "a b = 2 K, OUTSIDE"
    assert (
        sentence(AngleDemand("table", "outer", 89.12345678)) == "table, outer axis: point to 89.12345678 deg"
    )
    assert sentence(RateDemand("table", "table", 10.0000049)) == "table: spin at 10.0000049 deg/s"
    assert sentence(AirDemand("chamber", -45.0)) == "chamber: go to -45 degC as fast as possible"
    assert sentence(event_of({"kind": "novel", "time_s": 1, "a": 2})) == "a 2"
    assert sentence(event_of({"kind": "step", "code": 7})) == "code 7"


def test_numbers_keep_their_width_and_say_when_they_are_not_known() -> None:
    assert number(-1.25, 1) == "−1.2" and number(None, 2) == number(math.nan, 2) == "–"
    assert (
        duration(86_399.6) == "24:00:00" and duration(None) == "–" and count(1234567) == "1\u2009234\u2009567"
    )
    found = texts(
        {"gyros": {"g": {"rate_dps": 0.003, "latest_dps": 5.0, "rejected": {"checksum": 2}, "age_s": 9}}}, 0
    )
    for gone in ({"state": "ended"}, {"state": "running", "alive": False}):
        assert texts(gone | {"table": {"rate_dps": 7.0}}, 200)["table.age"] == "last read 3 min ago"
    going = {"state": "running", "alive": True}
    for age_s, stale, said in (
        (0.4, False, "now"),
        (7.0, False, "7 s ago"),
        (23.0, True, "last read 23 s ago"),
    ):
        table = {"rate_dps": 7.0, "age_s": age_s, "stale": stale}
        assert texts(going | {"table": table}, 0)["table.age"] == said
    assert found["gyro.g.mean"] == "+10.800" and found["gyro.g.rate_unit"] == "°/h"
    assert found["gyro.g.rejected"] == "2" and found["gyro.g.age"] == "9 s ago"


# The watch


def watch_of(runs: Path, name: str = "") -> Watch:
    folder = RunsFolder(runs)
    return Watch(folder, Benches(folder), name)


def write_now(session: Path, folder: Path, time_s: float, **fields) -> None:
    (session / "live").mkdir(parents=True, exist_ok=True)
    now = {
        "format": 1,
        "utc": f"2026-01-01T00:00:{time_s:06.3f}+00:00",
        "pid": os.getpid(),
        "state": "running",
        "run": {"folder": str(folder), "run_id": folder.name, "units": {"g": "U-1"}},
        "time_s": time_s,
        "chamber": {"air_temp_c": 20.0 + time_s, "set_point_c": 20.0},
        "table": {"rate_dps": 1.0},
        "gyros": {"g": {"latest_dps": 1.0, "temp_c": 30.0}},
    } | fields
    (session / "live" / "now.json").write_text(json.dumps(now))


def test_the_watch_follows_a_campaign_from_run_to_run(runs: Path) -> None:
    session = runs / "campaign"
    write_now(session, runs / "one", 1.0)
    watch = watch_of(runs)
    watch.update()
    assert watch.session.path == session.resolve() and watch.steerable
    first = watch.epoch
    write_now(session, runs / "one", 2.0)
    watch.update()
    assert watch.epoch == first and watch.values()["air"] == "22.00"
    assert [row[1] for row in watch.snapshot()["levels"]["run"]["rows"]] == [21.0, 22.0]
    write_now(session, runs / "campaign" / "runs" / "two", 0.5)
    watch.update()
    assert watch.epoch == first + 1 and len(watch.snapshot()["levels"]["run"]["rows"]) == 1


def test_the_watch_stays_with_a_living_session_and_reads_nothing_outside(runs: Path) -> None:
    write_now(runs / "one", runs.parent / "secret", 1.0)
    (runs.parent / "secret" / "events.jsonl").write_text('{"time_s": 1, "kind": "note", "text": "secret"}\n')
    watch = watch_of(runs)
    watch.update()
    assert "secret" not in json.dumps(watch.news())
    write_now(runs / "campaign", runs / "one", 5.0)
    watch._look_at = 0.0
    watch.update()
    assert watch.session.path == (runs / "one").resolve()
    assert read_now(runs / "campaign") is not None


def test_a_damaged_live_file_is_told_and_the_last_state_stays(runs: Path) -> None:
    write_now(runs / "one", runs / "one", 1.0)
    watch = watch_of(runs)
    watch.update()
    (runs / "one" / "live" / "now.json").write_text("{")
    watch.update()
    assert "cannot be read" in watch.news()["banner"]["happened"] and watch.values()["air"] == "21.00"


VALID = {
    "format": 1, "utc": "2026-01-01T00:00:00+00:00", "pid": 1, "process_start": 0, "state": "running",
    "outcome": "", "reason": "", "warnings": ["w"], "error": {"what": "x", "where": None}, "safe": [],
    "pause_wanted": False,
    "campaign": {"title": "t", "number": 1, "count": 2, "run": "a", "left_s": 1.0,
                 "bench": "b", "emulated": True},
    "run": {"folder": "x", "run_id": "a", "procedure": "p", "units": {"g": "U"}, "auxiliary": {"1": "case"}},
    "time_s": 1.0, "left_s": 2.0, "speed": 1.0, "step": "1", "doing": "d", "phase": "p",
    "chamber": {"air_temp_c": 1.0, "set_point_c": 2.0, "auxiliary_c": {"1": 3.0}, "age_s": 0.1, "stale": False},
    "table": {"angle_deg": 1.0, "rate_dps": 2.0, "demands": {"table": {"rate_dps": 1.0}}, "age_s": 0.1},
    "gyros": {"g": {"rate_dps": 1.0, "latest_dps": 1.0, "temp_c": 2.0,
              "frames": 3, "lost": 0, "rejected": {"crc": 1}}},
    "alarms": [{"time_s": 1.0, "kind": "alarm", "device": "table", "text": "x"}],
    "prompts": [{"id": 1, "question": "q", "utc": "u"}], "log": [{"time_s": 1.0, "kind": "note", "text": "x"}],
}  # fmt: skip
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(st.sampled_from(["kind", "time_s", "a"]), inner, max_size=2)
    ),
    max_leaves=4,
)  # fmt: skip


def places(value, path=()):
    yield path
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from places(value[key], (*path, key))


@example(("table", "demands", "table", "rate_dps"), 10**400)
@given(st.sampled_from([place for place in places(VALID) if place]), ANYTHING)
def test_whatever_stands_in_a_live_file_the_page_is_told_or_the_file_is_refused(place, value) -> None:
    now = json.loads(json.dumps(VALID))
    inner = now
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with TemporaryDirectory() as runs:
        session = Path(runs) / "one"
        (session / "live").mkdir(parents=True)
        (session / "live" / "now.json").write_text(json.dumps(now), encoding="utf-8", errors="surrogatepass")
        watch = watch_of(Path(runs))
        watch.update()
        shown = [watch.values(), watch.news(), watch.snapshot(), watch.prompts, watch.benches.strip()]
        json.dumps(shown, ensure_ascii=False, allow_nan=False).encode()


def test_a_value_that_no_longer_comes_leaves_a_gap_in_its_curve(runs: Path) -> None:
    watch = watch_of(runs)
    gyro = {"latest_dps": 1.0, "temp_c": 30.0, "age_s": 0.1, "stale": False}
    run = {"folder": str(runs / "one"), "run_id": "one", "units": {"g": "U-1"}, "auxiliary": {"1": "mirror"}}
    for second in range(40):
        gone = 10 <= second < 30
        air = {
            "air_temp_c": 20.0,
            "set_point_c": 20.0,
            "auxiliary_c": {"1": 3.0},
            "age_s": 0.0,
            "stale": gone,
        }
        write_now(
            runs / "one", runs / "one", second, run=run, chamber=air, gyros={"g": gyro | {"stale": gone}}
        )
        watch.update()
    names = [column.name for column in watch.columns]
    assert names == ["air", "set point", "table rate", "g", "g inside", "mirror"]
    rows = watch.snapshot()["levels"]["run"]["rows"]
    for column, name in enumerate(names):
        nothing = [row[0] for row in rows if row[1 + 2 * column] is None]
        assert nothing == ([] if name == "table rate" else [second + 0.5 for second in range(10, 30)])


def test_what_came_while_nobody_looked_is_in_the_curve_when_somebody_looks_again(
    runs: Path, monkeypatch
) -> None:
    """A panel reads no session that no page shows; a table that turned meanwhile did not rest."""
    watch = watch_of(runs)
    write_now(runs / "one", runs / "one", 1.0, table={"rate_dps": 0.0})
    watch.update()
    with (runs / "one" / "live" / "history.jsonl").open("w") as file:
        for second in range(1, 60):
            rate_dps = 7.0 if 20 <= second < 40 else 0.0
            row = {
                "time_s": second,
                "rate_dps": rate_dps,
                "air_temp_c": 21.0,
                "gyros": {"g": [rate_dps, 30.0]},
            }
            file.write(json.dumps(row) + "\n")
    later_s = host_seconds() + 60.0
    monkeypatch.setattr("bench.present.panel._watch.host_seconds", lambda: later_s)
    write_now(runs / "one", runs / "one", 59.5, table={"rate_dps": 0.0})
    watch.update()
    turned = [row[0] for row in watch.snapshot()["levels"]["run"]["rows"] if row[6] == 7.0]
    assert turned == [second + 0.5 for second in range(20, 40)]


def test_a_bench_is_followed_from_session_to_session(runs: Path) -> None:
    """Asked for a bench, the watch shows its newest session, never another bench's."""
    folder = RunsFolder(runs)
    watch = Watch(folder, Benches(folder), bench="east")
    watch.update()
    assert watch.session is None and "at east" in watch.news()["banner"]["happened"]
    for name, bench, shown in (("a", "east", "a"), ("b", "west", "a"), ("c", "east", "c")):
        run = {"folder": str(runs / "one"), "run_id": name, "units": {}, "bench": bench}
        ended = {"state": "ended", "outcome": "completed"} if name == "a" else {}
        write_now(runs / name, runs / "one", 1.0, run=run, **ended)
        watch._look_at = watch.benches._next_at = watch.benches._look_at = 0.0
        watch.update()
        assert watch.session is not None and watch.session.path.name == shown


def test_another_process_with_the_number_of_one_that_was_killed_is_not_it(runs: Path) -> None:
    write_now(runs / "one", runs / "one", 1.0, process_start=process_start(os.getpid()))
    assert read_now(runs / "one")["alive"]
    write_now(runs / "one", runs / "one", 1.0, process_start=process_start(os.getpid()) + 1)
    assert not read_now(runs / "one")["alive"]


def test_a_run_of_a_killed_process_and_one_set_aside_are_not_running(runs: Path) -> None:
    watch = watch_of(runs)
    watch.update()
    assert {row["outcome"] for row in watch.runs()} == {"✕ not closed"}
    aside = {"kind": "set_aside", "time_s": 1.0, "run": "two", "folder": "runs/two", "reason": "not closed"}
    (runs / "campaign" / "events.jsonl").write_text(json.dumps(aside) + "\n")
    (runs / "campaign" / "certificate.html").write_text("<p>certificate</p>")
    watch = watch_of(runs)
    watch.update()
    two = next(row for row in watch.runs() if row["run"] == "campaign/runs/two")
    assert two["outcome"] == "✕ set aside" and two["papers"][-1] == ("certificate", "/certificate/campaign")
    write_now(runs / "one", runs / "one", 1.0)
    watch = watch_of(runs)
    watch.update()
    assert next(row for row in watch.runs() if row["run"] == "one")["outcome"] == "● running"


def test_what_is_left_of_a_finished_campaign_is_nothing() -> None:
    campaign = {"title": "t", "number": 5, "count": 5, "left_s": 26.0}
    going = {"state": "running", "alive": True, "campaign": campaign, "left_s": 10.0}
    assert texts(going, 0)["campaign_left"] == "campaign: 0:00:36 left"
    ended = texts(going | {"state": "ended", "outcome": "completed"}, 0)
    assert (ended["campaign_left"], ended["left"]) == ("", "0:00:00")


def test_an_abort_says_who_pressed_it() -> None:
    now = {"state": "ended", "alive": False, "outcome": "aborted", "reason": "stopped by Ada"}
    assert say(now, [Requested("abort", "Ada", "2026"), *SAFE[1:]]).happened == "Ada pressed abort."


def test_after_a_kill_the_watchdogs_word_counts() -> None:
    gone = {"state": "running", "alive": False}
    took = Takeover("runner_ended", "2026-11-23T11:21:31+00:00", 7)
    at_work = say(gone, [], watchdog=[took])
    assert at_work.word == "Watchdog at work" and "Nobody" not in at_work.done
    rest = say(gone, [], watchdog=[took, TABLE, CHAMBER, TakeoverEnded(True)])
    assert rest.word == "Stopped by the watchdog" and "table at rest" in rest.done and "11:21:31" in rest.done
    failed = say(gone, [], watchdog=[took, GONE, CHAMBER, TakeoverEnded(False)])
    assert failed.word == "Not confirmed safe" and failed.press.startswith("GO AND LOOK NOW")
    assert "nobody has confirmed" in say(gone, []).done
