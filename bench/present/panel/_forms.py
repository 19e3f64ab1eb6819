"""A procedure as a form: its parameters with units, limits and what the bench allows; what was typed, checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from bench.campaign.queue import RunOrder
from bench.control.parameter_facts import ParameterFact, parameter_facts
from bench.control.procedure import Procedure, beyond_limits
from bench.record.benchfile import BenchFile
from drivers.base.errors import ConfigurationError

_HALVINGS = 40
_INSIDE = 1e-9


@dataclass(frozen=True)
class Field:
    """A parameter as the form shows it; `value`: what is typed in it, `bench`: what the bench allows of it."""

    name: str
    label: str
    kind: str
    unit: str
    meaning: str
    value: str
    default: str
    limits: str
    bench: str
    optional: bool
    choices: tuple[str, ...]


@dataclass(frozen=True)
class Mistakes:
    """What is wrong with a form: by the name of its field, and with the whole."""

    fields: Mapping[str, str]
    whole: tuple[str, ...] = ()


def fields(procedure: Procedure, file: BenchFile, values: Mapping[str, Any]) -> list[Field]:
    """Return the fields of a procedure's form, filled with its defaults and `values`."""
    found = []
    for fact in parameter_facts(procedure.parameters):
        value = values.get(fact.name, fact.default)
        found.append(
            Field(
                fact.name,
                _label(fact),
                fact.kind,
                _unit(fact),
                fact.meaning,
                _usual(fact) if value == fact.default else _typed(value),
                _usual(fact) or "by the procedure",
                _limits(fact),
                _allowed_text(procedure, fact, file),
                fact.optional,
                fact.choices,
            )
        )
    return found


def in_words(procedure: Procedure, values: Mapping[str, Any]) -> str:
    """Return parameters as one says them: name, value, unit."""
    facts = {fact.name: fact for fact in parameter_facts(procedure.parameters)}
    return ", ".join(
        f"{_label(facts[name])} {_typed(value)} {_unit(facts[name])}".strip()
        for name, value in values.items()
        if name in facts
    )


def order_of(procedure: Procedure, typed: Mapping[str, str]) -> RunOrder | Mistakes:
    """Return the order that a filled form is, with the values that are not the defaults, or what is wrong."""
    facts = {fact.name: fact for fact in parameter_facts(procedure.parameters)}
    given, empty = {}, {}
    for name, text in typed.items():
        if name in facts and text.strip() == _usual(facts[name]):
            continue
        if text.strip():
            given[name] = text.strip()
        elif name not in facts or not facts[name].optional:
            empty[name] = "a value is needed"
    try:
        chosen = procedure.parameters.model_validate(given)
    except ValidationError as error:
        wrong = {
            str(item["loc"][0]): _plain(item["type"], item["msg"]) for item in error.errors() if item["loc"]
        }
        whole = tuple(_plain(item["type"], item["msg"]) for item in error.errors() if not item["loc"])
        return Mistakes(empty | wrong, whole)
    if empty:
        return Mistakes(empty)
    values = chosen.model_dump(mode="json")
    usual = {name: fact.default for name, fact in facts.items()}
    return RunOrder(
        procedure=procedure.name,
        parameters={name: value for name, value in values.items() if value != usual[name]},
    )


def allowed(procedure: Procedure, fact: ParameterFact, file: BenchFile) -> tuple[float | None, float | None]:
    """Return how far a parameter may go down and up before the bench's limits forbid the run.

    The others have their defaults. None: the bench does not limit it within the parameter's own limits.
    """
    if fact.kind not in ("number", "whole") or not isinstance(fact.default, int | float):
        return None, None

    def fits(value: float) -> bool | None:
        try:
            number = round(value) if fact.kind == "whole" else value
            return not list(beyond_limits(procedure.demands(procedure.parse({fact.name: number})), file))
        except ConfigurationError:
            return None

    inside = float(fact.default)
    if not fits(inside):
        return None, None
    low, high = _reach(fact)
    return _edge(fits, inside, low), _edge(fits, inside, high)


def _reach(fact: ParameterFact) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value that a parameter's own limits let be; None: it has no limit."""
    low = fact.at_least if fact.above is None else fact.above + _INSIDE * max(1.0, abs(fact.above))
    high = fact.at_most if fact.below is None else fact.below - _INSIDE * max(1.0, abs(fact.below))
    return low, high


def _edge(fits: Callable[[float], bool | None], inside: float, outside: float | None) -> float | None:
    """Return the last value that fits on the way from one that does to one that does not."""
    if outside is None or fits(outside) is not False:
        return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        if fits(middle):
            inside = middle
        else:
            outside = middle
    return float(f"{inside:.6g}")


def _allowed_text(procedure: Procedure, fact: ParameterFact, file: BenchFile) -> str:
    low, high = allowed(procedure, fact, file)
    if low is not None and high is not None:
        return f"{low:g} to {high:g}"
    return f"≥ {low:g}" if low is not None else f"≤ {high:g}" if high is not None else ""


def _limits(fact: ParameterFact) -> str:
    """Return a parameter's own limits as one says them."""
    if fact.at_least is not None and fact.at_most is not None:
        return f"{fact.at_least:.10g} to {fact.at_most:.10g}"
    return fact.limits.replace(">=", "≥").replace("<=", "≤")


def _unit(fact: ParameterFact) -> str:
    return fact.unit.replace("degC", "°C").replace("deg", "°")


def _label(fact: ParameterFact) -> str:
    """Return a parameter's name for people: without its unit, which stands behind the value."""
    words = fact.name.split("_")
    units = {"deg", "dps", "c", "s", "min", "h", "k", "per", "10min", "percent", "dph", "hz"}
    while fact.unit and len(words) > 1 and words[-1] in units:
        words.pop()
    return " ".join(words)


def _typed(value: object) -> str:
    """Return a value as one types it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value).removesuffix(".0")


def _usual(fact: ParameterFact) -> str:
    """Return the default as the form shows it: a third has six digits, and means a third as long as it stands."""
    return f"{fact.default:.6g}" if isinstance(fact.default, float) else _typed(fact.default)


def _plain(kind: str, message: str) -> str:
    if kind in _NUMBERS:
        return _NUMBERS[kind]
    return message.removeprefix("Value error, ").replace("Input should be", "should be")


_NUMBERS = {
    "float_parsing": "should be a number",
    "finite_number": "should be a number",
    "int_parsing": "should be a whole number",
    "int_from_float": "should be a whole number",
}
"""Kind of a validation error -> what the form says."""
