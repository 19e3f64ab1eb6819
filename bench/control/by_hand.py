"""Orders to a bench by hand: what people type or press, one at a time, and what the bench makes of them.

No order waits for the one before: table and chamber are told, and the polls see to it that they get there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from bench.control.questions import Question, Reply
from bench.control.session import Bench
from bench.record.events.run import Prompt
from drivers.base.errors import ConfigurationError, LimitExceeded, RunAborted

_LOOK_S = 0.2
_REST_DPS = 0.01
_USAGE = "point DEG, spin DPS, stop, air DEGC, chamber off, done"
QUESTION = f"By hand. Next: {_USAGE}?"
_OVER = ("done", "end", "yes")


@dataclass(frozen=True)
class Bounds:
    """How far orders may go, within the limits of the bench."""

    max_rate_dps: float
    low_c: float
    high_c: float
    ramp_k_per_min: float


@dataclass(frozen=True)
class Order:
    """An order and its number, if it has one."""

    verb: str
    value: float = math.nan


_NUMBERED, _PLAIN = ("point", "spin", "air"), ("stop", "chamber off", "done")


def parse_order(text: str) -> Order:
    """Return the order that a text is; ConfigurationError for one that is none."""
    words = text.strip().lower().split()
    plain = " ".join(words)
    if plain in _OVER:
        return Order("done")
    if plain in _PLAIN:
        return Order(plain)
    if len(words) == 2 and words[0] in _NUMBERED:
        try:
            value = float(words[1])
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return Order(words[0], value)
    raise ConfigurationError(
        "an order that the bench does not know", found=text.strip()[:60], expected=_USAGE
    )


def next_order(bench: Bench, idle_min: float) -> Order:
    """Return the next order; what is none is told and asked anew. RunAborted for "no" and "abort".

    When nobody has ordered anything for `idle_min`, the order is "done".
    """
    end_s = bench.now_s + 60.0 * idle_min
    while (reply := _reply(bench, end_s)) is not None:
        bench.event(Question(QUESTION).answered(reply))
        if reply.answer.strip().lower() in ("no", "n", "abort"):
            raise RunAborted(f"{reply.by} answered {reply.answer!r}")
        try:
            return parse_order(reply.answer)
        except ConfigurationError as error:
            bench.note(f"not done: {error}")
            bench.wait(_LOOK_S, "by hand")
    bench.note(f"nobody ordered anything for {idle_min:g} min: the run ends")
    return Order("done")


def _reply(bench: Bench, end_s: float) -> Reply | None:
    """Return what somebody orders, None when nobody has until `end_s`."""
    bench.event(Prompt(QUESTION))
    answered: Callable[[], Reply | None] = bench.operator.ask(Question(QUESTION))
    while (reply := answered()) is None and bench.now_s < end_s:
        bench.wait(_LOOK_S, "by hand: waits for an order")
    return reply


def obey(bench: Bench, order: Order, bounds: Bounds) -> LimitExceeded | None:
    """Carry out an order; return why it was not sent if the limits forbid it. The bench then stays as it was."""
    before = dict(bench.table.demands), bench.chamber.set_point_c
    try:
        _send(bench, order, bounds)
    except LimitExceeded as refused:
        if (dict(bench.table.demands), bench.chamber.set_point_c) != before:
            raise
        bench.note(f"not done: {refused}")
        return refused
    return None


def _send(bench: Bench, order: Order, bounds: Bounds) -> None:
    table, chamber = bench.table, bench.chamber
    if order.verb == "stop":
        table.spin(0.0, settle=False)
    elif order.verb == "spin":
        _within(abs(order.value), 0.0, bounds.max_rate_dps, "deg/s")
        table.spin(order.value, across=True, settle=False)  # nothing is evaluated
    elif order.verb == "point":
        if any(abs(rate_dps) > _REST_DPS for rate_dps in table.rates_dps):
            raise LimitExceeded(
                "the table turns", found=f"point {order.value:g}", expected="a table at rest: stop"
            )
        table.point(order.value, settle=False)
    elif order.verb == "air":
        _within(order.value, bounds.low_c, bounds.high_c, "degC")
        chamber.go_to(order.value, bounds.ramp_k_per_min)
        chamber.start()
    else:
        chamber.stop()


def _within(value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise LimitExceeded(
            "more than this run may order",
            found=f"{value:g} {unit}",
            expected=f"{low:g} .. {high:g} {unit}",
            remedy="begin a run by hand with other parameters, if the bench allows it",
        )
