"""What an operator reads after a run that ended early: what happened, what the bench did, what comes next."""

import io
import re
import signal

import pytest

from bench.control.runner import RunResult
from bench.control.watchdog._process import _words
from bench.lab.emulated import Plant
from bench.present.cli._console import Terminal
from bench.present.cli._shown_run import say_result
from bench.record.events.safe import Takeover, TakeoverEnded
from simulators.faults import Fault


def said(result):
    stream = io.StringIO()
    say_result(Terminal(file=stream, width=1000), result, kind="result")
    return stream.getvalue()


def test_after_ctrl_c_the_terminal_says_what_rests_what_is_kept_and_what_comes_next(
    bench, fog_file, tmp_path
):
    def press(progress):
        if progress.phase == "spin" and progress.time_s > 20.0:
            signal.raise_signal(signal.SIGINT)

    with bench.lab(fog_file, Plant(seed=5)) as lab:
        text = said(bench.drive(lab.file, tmp_path, display=press, hold_s=1e5))
    assert "stopped by Ctrl-C." in text
    assert "bench: table at rest: 0.0000 deg/s; chamber at rest: stopped, set point 25 degC" in text
    assert f"`gyrobench report {tmp_path / 'run'}`" in text and "next: " in text


def test_what_is_not_confirmed_is_said_and_what_is_too(bench, fog_file, tmp_path):
    gone = Fault(port="chamber", kind="vanish", at_s=(25.5,), duration_s=1e6)
    with bench.lab(fog_file, Plant(seed=5, fault=(gone,))) as lab:
        text = said(bench.drive(lab.file, tmp_path, hold_s=1e5))
    assert "NOT CONFIRMED SAFE, go and look: chamber" in text
    assert re.search(r"bench: table at rest: 0\.00\d\d deg/s; the rest NOT CONFIRMED", text)


def test_a_run_that_never_opened_anything_does_not_claim_to_have_stopped_it(tmp_path):
    assert "bench: nothing was told to move" in said(RunResult(tmp_path, "aborted", "no such port", 0.0))


@pytest.mark.parametrize(("confirmed", "wanted"), [(True, "made safe. What"), (False, "go and look")])
def test_the_watchdog_speaks_in_words_and_names_the_command_for_the_run(tmp_path, confirmed, wanted):
    text = _words(TakeoverEnded(confirmed), tmp_path)
    assert wanted in text and f"`gyrobench runs recover {tmp_path}`" in text
    takeover = Takeover("runner_ended", "2026-11-22T10:00:00+00:00", 1)
    assert _words(takeover, tmp_path).startswith("the runner's process has ended: ")
