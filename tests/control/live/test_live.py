"""The live files: what others see of a session, and what they may ask of it."""

import json
import os
import threading

import pytest

from bench.control.live import Live, drop_answer, drop_request, read_lines, read_now
from bench.control.live._files import read_answer, take_requests
from bench.control.progress import GyroProgress, Progress
from bench.control.questions import Console, Prepared, Question, Reply
from bench.record.events.run import Note
from drivers.base.clock import Interrupt
from drivers.base.errors import ConfigurationError, RecordError, RunAborted

pytestmark = pytest.mark.concurrent

NAN = float("nan")


def progress(time_s, **changes):
    gyro = GyroProgress(1.0, 1.5, 24.0, frames=100, lost=2, rejected={"checksum": 1}, age_s=0.2)
    fields = {"time_s": time_s, "step": "S1 Warm up", "doing": "waiting", "phase": "warm_up"}
    fields |= {"air_temp_c": 25.0, "set_point_c": 25.0, "air_rate_k_per_min": NAN, "auxiliary_c": {"1": 24.0}}
    fields |= {
        "angle_deg": 90.0,
        "rate_dps": 0.0,
        "demands": {"table": {"angle_deg": 90.0}},
        "gyros": {"fog_1": gyro},
    }
    return Progress(**(fields | changes))


@pytest.fixture
def session(tmp_path):
    """A session with its folders and no thread: the test does what the thread does, when it wants."""
    live = Live(tmp_path)
    for name in ("answers", "requests"):
        (tmp_path / "live" / name).mkdir(parents=True)
    return live


def step(live):
    live._take_requests()
    live._write()


def test_what_is_written_is_what_is_read(session, tmp_path):
    assert read_now(tmp_path) is None
    step(session)
    now = read_now(tmp_path)
    assert now["state"] == "starting" and now["alive"] and now["chamber"] is None
    session._run_folder = tmp_path / "runs" / "a"
    session._run_folder.mkdir(parents=True)
    session._run = {"expected_s": 100.0}
    session(progress(30.0))
    step(session)
    now = read_now(tmp_path)
    assert now["state"] == "running" and now["left_s"] == 70.0
    assert now["chamber"]["rate_k_per_min"] is None and now["chamber"]["auxiliary_c"] == {"1": 24.0}
    assert now["gyros"]["fog_1"]["lost"] == 2 and now["gyros"]["fog_1"]["rejected"] == {"checksum": 1}


def test_waiting_for_a_human_is_no_progress_and_old_values_are_none_in_the_history(session, tmp_path):
    session._run_folder, session._run = tmp_path, {"expected_s": 100.0, "run_id": "a"}
    for time_s, standing_s in ((30.0, 0.0), (300.0, 270.0)):
        session(progress(time_s, standing_s=standing_s, air_age_s=270.0, table_age_s=0.5))
        step(session)
        now = read_now(tmp_path)
        assert now["left_s"] == 70.0
    assert now["chamber"]["stale"] and now["chamber"]["age_s"] == 270.0 and not now["table"]["stale"]
    rows, _ = read_lines(tmp_path / "live" / "history.jsonl")
    assert rows[-1]["air_temp_c"] is None and rows[-1]["angle_deg"] == 90.0 and rows[-1]["auxiliary_c"] == {}


def test_alarms_of_a_campaigns_earlier_runs_stay(session, tmp_path):
    session.begin_run(tmp_path / "a", run_id="a")
    session._stop.set()
    session(progress(1.0, alarms=({"time_s": 1.0, "kind": "alarm", "device": "table", "text": "x"},)))
    session.begin_run(tmp_path / "b", run_id="b")
    step(session)
    assert [row["run"] for row in read_now(tmp_path)["alarms"]] == ["a"]
    session(progress(2.0, alarms=({"time_s": 2.0, "kind": "alarm", "device": "table", "text": "y"},)))
    step(session)
    assert [row["run"] for row in read_now(tmp_path)["alarms"]] == ["a", "b"]


def test_history_has_a_row_a_second_at_most_and_is_read_piece_by_piece(session, tmp_path):
    session._run_folder = tmp_path
    for time_s in (0.0, 0.4, 0.9, 1.0, 1.5, 2.5):
        session(progress(time_s))
        step(session)
    rows, offset = read_lines(tmp_path / "live" / "history.jsonl")
    assert [row["time_s"] for row in rows] == [0.0, 1.0, 2.5]
    assert rows[0]["gyros"] == {"fog_1": [1.5, 24.0, None]}
    session(progress(9.0))
    step(session)
    with (tmp_path / "live" / "history.jsonl").open("a") as file:
        file.write('{"time_s": 1')  # a line that is being written
    rows, offset = read_lines(tmp_path / "live" / "history.jsonl", offset)
    assert [row["time_s"] for row in rows] == [9.0]
    assert read_lines(tmp_path / "live" / "history.jsonl", offset) == ([], offset)


def test_the_first_answer_stays_and_the_second_is_told_whose_it_was(session, tmp_path):
    answered = session.ask(Question("Ready?"))
    step(session)
    (prompt,) = read_now(tmp_path)["prompts"]
    assert prompt["question"] == "Ready?" and read_now(tmp_path)["state"] == "asking"
    assert answered() is None
    assert drop_answer(tmp_path, prompt["id"], "yes", "Ann").by == "Ann"
    assert drop_answer(tmp_path, prompt["id"], "no", "Bob").by == "Ann"
    assert answered() == Reply("yes", "Ann")
    step(session)
    assert read_now(tmp_path)["prompts"] == []


def test_many_answers_at_once_leave_one(session, tmp_path):
    answered = session.ask(Question("Ready?"))
    (number,) = session._prompts
    start = threading.Barrier(8)
    told = []

    def hurry(name):
        start.wait()
        told.append(drop_answer(tmp_path, number, "yes", name).by)

    threads = [threading.Thread(target=hurry, args=(f"operator {n}",)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    text, by, _ = answered()
    assert text == "yes" and set(told) == {by}
    assert [path.name for path in (tmp_path / "live" / "answers").iterdir()] == [f"{number}.json"]


def test_console_and_files_both_may_answer(session, tmp_path):
    lines = {"Mount?": threading.Event(), "Close?": threading.Event()}
    shown = []

    def prompt(text):
        lines[text].wait(10.0)
        return "yes"

    console = Console(prompt, shown.append)
    either = session.beside(console)
    answered = either.ask(Question("Mount?"))
    (number,) = session._prompts
    drop_answer(tmp_path, number, "done", "Ann on the panel")
    assert answered() == Reply("done", "Ann on the panel")
    answered = either.ask(Question("Close?"))  # the console's thread still waits for the first line
    assert shown == ["Close?"] and answered() is None
    (number,) = session._prompts
    lines["Mount?"].set()
    while (given := answered()) is None:
        continue
    assert given == Reply("yes", console.name) and "at the console" in console.name
    assert read_answer(tmp_path, number).by == console.name  # the panel is told who was first


def test_prepared_answers_match_patterns_and_pass_on_the_rest():
    class Human:
        def ask(self, question):
            return lambda: Reply(f"heard {question.text}", "Ann")

    operator = Prepared([("Mount *", "yes")], "campaign.toml", Human())
    assert operator.ask(Question("Mount the unit"))() == Reply("yes", "campaign.toml")
    assert operator.ask(Question("Door closed?"))() == Reply("heard Door closed?", "Ann")


def test_requests_are_taken_in_order_once_and_an_abort_interrupts(session, tmp_path):
    interrupt = Interrupt()
    drop_request(tmp_path, "pause", "Ann")
    with session.steering(interrupt, paced=False):
        step(session)
        assert session.pause_wanted == "Ann"
        interrupt.check()
        drop_request(tmp_path, "resume", "Bob")
        drop_request(tmp_path, "abort", "Cem")
        step(session)
        assert not session.pause_wanted
        with pytest.raises(RunAborted, match="stopped by Cem"):
            interrupt.check()
        interrupt.clear()  # the bench is being made safe
        drop_request(tmp_path, "abort", "Dee")
        step(session)
        interrupt.check()
    assert [(request.action, request.by) for request in session.take()] == [
        ("pause", "Ann"),
        ("resume", "Bob"),
        ("abort", "Cem"),
        ("abort", "Dee"),
    ]
    assert session.take() == [] and list(take_requests(tmp_path)) == []
    interrupt.close()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[1]",
        b'{"action": "rm -rf", "by": "x", "utc": ""}',
        b"[" * 4000,
        b'"' + b"x" * 9000 + b'"',
    ],
)
def test_a_file_that_is_no_request_is_told_and_removed(session, tmp_path, content):
    path = tmp_path / "live" / "requests" / "0.json"
    path.write_bytes(content)
    step(session)
    (found,) = session.take()
    assert isinstance(found, Note) and str(path) in found.text
    assert not path.exists() and not session.pause_wanted and session.abort is None


def test_a_link_is_not_followed_and_a_pipe_does_not_hang(session, tmp_path):
    secret = tmp_path / "secret.json"
    secret.write_text('{"action": "abort", "by": "x", "utc": ""}')
    (tmp_path / "live" / "requests" / "0.json").symlink_to(secret)
    os.mkfifo(tmp_path / "live" / "requests" / "1.json")
    step(session)
    assert all(isinstance(taken, Note) for taken in session.take())
    assert session.abort is None and secret.exists()


def test_a_folder_that_vanishes_stops_the_picture_and_nothing_else(session, tmp_path):
    (tmp_path / "live").rename(tmp_path / "gone")
    session(progress(1.0))
    step(session)
    assert session.problem
    (tmp_path / "gone").rename(tmp_path / "live")
    step(session)
    assert not session.problem and read_now(tmp_path)["state"] == "running"


def test_refused_answers_and_requests(tmp_path, session):
    with pytest.raises(ConfigurationError):
        drop_answer(tmp_path, 1, "  ", "Ann")
    with pytest.raises(ConfigurationError):
        drop_answer(tmp_path, 1, "x" * 5000, "Ann")
    with pytest.raises(ConfigurationError):
        drop_request(tmp_path, "explode", "Ann")
    with pytest.raises(ValueError):
        drop_answer(tmp_path, "../../x", "yes", "Ann")
    with pytest.raises(RecordError, match="cannot be reached"):
        drop_request(tmp_path / "nowhere", "abort", "Ann")


def test_a_dead_session_and_a_damaged_file_are_told(session, tmp_path):
    step(session)
    path = tmp_path / "live" / "now.json"
    now = json.loads(path.read_text())
    now["pid"] = 2**22 + 1  # beyond the kernel's largest
    path.write_text(json.dumps(now))
    assert read_now(tmp_path)["alive"] is False
    path.write_text("{")
    with pytest.raises(RecordError):
        read_now(tmp_path)


def test_the_thread_does_both_and_ends_with_the_session(tmp_path):
    with Live(tmp_path) as live:
        drop_request(tmp_path, "pause", "Ann")
        while not live.pause_wanted:
            live.wait_host()
        live.end("completed", "")
    now = read_now(tmp_path)
    assert now["state"] == "ended" and now["outcome"] == "completed" and not now["alive"]
    assert not any(thread.name == "live files" for thread in threading.enumerate())


def test_a_row_of_the_history_has_the_mean_of_all_samples_since_the_row_before(session, tmp_path):
    (tmp_path / "run").mkdir()
    session._run_folder = tmp_path / "run"
    sums = {1.0: (100, 50.0), 1.5: (150, 51.0), 2.0: (200, 80.0), 3.0: (200, 80.0), 4.0: (300, 80.0)}
    for time_s, (samples, sum_dps) in sums.items():
        gyro = GyroProgress(1.0, 9.0, 24.0, age_s=0.1, samples=samples, sum_dps=sum_dps)
        session(progress(time_s, gyros={"fog_1": gyro}))
        session._write()
    rows, _ = read_lines(tmp_path / "run" / "live" / "history.jsonl")
    found = [(row["time_s"], row["gyros"]["fog_1"][2]) for row in rows]
    assert found == [(1.0, 0.5), (2.0, 0.3), (3.0, None), (4.0, 0.0)]


def test_text_of_another_encoding_stops_neither_answer_nor_request(session, tmp_path):
    session.ask(Question("Ready?"))
    (number,) = session._prompts
    assert drop_answer(tmp_path, number, "j\udce4", "Jos\udce9") == read_answer(tmp_path, number)
    assert read_answer(tmp_path, number).by == "Jos?"
    requests = tmp_path / "live" / "requests"
    requests.mkdir(exist_ok=True)
    (requests / "1.json").write_text('{"action": "pause", "by": "\\ud800", "utc": ""}')
    assert drop_request(tmp_path, "abort", "Jos\udce9").by == "Jos?"
    assert [(one.action, one.by) for one in take_requests(tmp_path)] == [("pause", "?"), ("abort", "Jos?")]


def test_what_cannot_be_written_does_not_end_the_thread_that_takes_an_abort(session, monkeypatch):
    monkeypatch.setattr(session, "_now", lambda: {"doing": "\ud800"})
    session._write()
    assert "surrogates" in session.problem
