"""Who answers an operator's questions."""

import os
import subprocess
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.control.questions import (
    Assisted,
    AssumeYes,
    Console,
    EmulatedOperator,
    Question,
    Reply,
    agreed,
    consents,
)
from drivers.base.errors import BenchError, RunAborted
from tests.ptys import read_exactly

pytestmark = pytest.mark.concurrent

DONE = Reply("done", "emulated operator")


def test_beforehand_is_yes():
    assert AssumeYes().ask(Question("Ready?"))() == Reply("yes", "answered beforehand")


def test_the_emulated_operator_does_the_act_and_answers_done():
    acts = []
    operator = EmulatedOperator(lambda act: acts.append(act) or {"ok": True})
    assert operator.ask(Question("Mount", {"act": "mount", "mounting": "axis_up"}))() == DONE
    assert operator.ask(Question("Just look"))() == DONE
    assert acts == [{"act": "mount", "mounting": "axis_up"}]


def test_what_an_emulated_lab_does_by_itself_is_not_answered_beforehand():
    """`--yes` on an emulated lab: the act is done, so somebody did it; a mere question nobody has looked at."""
    operator = Assisted(AssumeYes(), lambda act: {})
    assert operator.ask(Question("Mount", {"act": "mount"}))() == Reply("yes", "emulated operator")
    assert operator.ask(Question("Just look"))() == Reply("yes", "answered beforehand")


def test_an_emulated_operator_that_fails_says_so():
    def refuse(act):
        raise BenchError("no such unit")

    with pytest.raises(BenchError, match="no such unit"):
        EmulatedOperator(refuse).ask(Question("Mount", {"act": "mount"}))()


def test_the_console_has_no_answer_until_a_line_is_entered():
    entered = threading.Event()

    def prompt(text):
        assert text == "Ready?"
        entered.wait(10.0)
        return "no"

    answered = Console(prompt).ask(Question("Ready?"))
    assert answered() is None
    entered.set()
    while (answer := answered()) is None:
        continue
    assert answer.answer == "no" and "at the console" in answer.by


@pytest.mark.parametrize(
    ("answer", "meant"),
    [("yes", True), ("Y", True), (" Done, torque 5 Nm", True), ("OK.", True), ("Ready", True),
     ("no.", False), ("N", False),
     ("STOP!", False), ("abort now", False), ("", None), ("nein", None), ("yess", None), ("1", None),
     ("not yet", None), ("  ", None), ("\ud800", None)],
)  # fmt: skip
def test_the_first_word_says_whether_somebody_agrees(answer, meant):
    assert consents(answer) is meant


@given(st.text(max_size=20))
def test_nothing_that_does_not_begin_with_a_yes_is_one(answer):
    said = answer.casefold().lstrip("0123456789_ \t\r\n.,;:!?-'\"()[]{}<>/\\|@#$%^&*+=~`")
    if consents(answer):
        assert any(word in answer.casefold() for word in ("y", "done", "ok", "ready"))
    if said.startswith(("yes ", "done,", "ok")) and said in ("yes ", "done,", "ok"):
        assert consents(answer) is True


def test_what_is_neither_yes_nor_no_is_asked_again():
    answers, notes = iter(["", "j\u00e4", "stopp", "done"]), []
    reply = agreed(Question("Ready?"), lambda question: Reply(next(answers), "Ada"), notes.append)
    assert reply.answer == "done" and len(notes) == 3
    assert notes[0] == "'' by Ada is neither yes nor no, asked again: Ready?"
    with pytest.raises(RunAborted, match="the operator answered 'stop' to: Ready"):
        agreed(Question("Ready?"), lambda question: Reply("stop", "Ada"), notes.append)
    with pytest.raises(RunAborted, match="nobody said yes or no"):
        agreed(Question("Ready?"), lambda question: Reply("", "Ada"), notes.append)


def test_an_act_follows_a_yes_only():
    acts = []
    operator = Assisted(AssumeYes("not yet"), lambda act: acts.append(act) or {})
    assert operator.ask(Question("Mount", {"act": "mount"}))() == Reply("not yet", "answered beforehand")
    assert not acts


def test_bytes_of_another_encoding_are_an_answer_that_can_be_kept():
    lines = iter([UnicodeDecodeError("utf-8", b"j\xe4", 1, 2, "invalid"), "j\udce4", "yes"])

    def prompt(text):
        line = next(lines)
        if isinstance(line, Exception):
            raise line
        return line

    console, given = Console(prompt), []
    for _ in range(3):
        answered = console.ask(Question("Ready?"))
        while (reply := answered()) is None:
            continue
        given.append(reply.answer)
    assert given == ["b'j\\xe4'", "j?", "yes"]


ASKS = """
import sys
from bench.control.questions import Console, Question
sys.stdout.write("begun\\n"); sys.stdout.flush()
sys.stdin.buffer.raw  # the terminal
import select
select.select([sys.stdin], [], [])  # until something was typed, before any question
answered = Console(lambda text: input(text)).ask(Question("Ready? "))
while (reply := answered()) is None:
    pass
sys.stdout.write(f"answer {reply.answer!r}\\n"); sys.stdout.flush()
"""


@pytest.mark.slow
def test_what_was_typed_before_a_question_does_not_answer_it():
    near, far = os.openpty()
    try:
        process = subprocess.Popen([sys.executable, "-c", ASKS], stdin=far, stdout=far, stderr=far)
        assert read_exactly(near, len(b"begun\r\n")) == b"begun\r\n"
        os.write(near, b"yes\n")
        seen = b""
        while b"Ready? " not in seen:
            seen += read_exactly(near, 1)
        os.write(near, b"no\n")
        while b"answer" not in seen or not seen.endswith(b"\n"):
            seen += read_exactly(near, 1)
        assert process.wait(10.0) == 0
        assert b"answer 'no'" in seen, seen
    finally:
        os.close(near)
        os.close(far)
