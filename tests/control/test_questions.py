"""Who answers an operator's questions."""

import threading

import pytest

from bench.control.questions import Assisted, AssumeYes, Console, EmulatedOperator, Question, Reply
from drivers.base.errors import BenchError

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
