"""What is known of a procedure's parameters: kind, default, unit, limits. For tables and forms alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel


@dataclass(frozen=True)
class ParameterFact:
    """One parameter. `optional`: None, the default then, leaves it to the procedure."""

    name: str
    kind: Literal["number", "whole", "switch", "choice", "text"]
    default: Any
    unit: str
    meaning: str
    optional: bool = False
    choices: tuple[str, ...] = ()
    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    below: float | None = None

    @property
    def limits(self) -> str:
        """Its own limits as text, empty without."""
        signs = ((">=", self.at_least), (">", self.above), ("<=", self.at_most), ("<", self.below))
        return ", ".join(f"{sign} {value:g}" for sign, value in signs if value is not None)


def parameter_facts(parameters: type[BaseModel]) -> tuple[ParameterFact, ...]:
    """Return the facts of every parameter, in the order in which they are declared."""
    found = []
    for name, info in parameters.model_fields.items():
        extra = info.json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        types = [one for one in (get_args(info.annotation) or (info.annotation,)) if one is not type(None)]
        optional = len(get_args(info.annotation)) > len(types)
        choices: tuple[str, ...] = ()
        kind: Literal["number", "whole", "switch", "choice", "text"] = "text"
        if get_origin(info.annotation) is Literal:
            kind, choices = "choice", tuple(str(one) for one in get_args(info.annotation))
        elif types[0] in _KINDS:
            kind = _KINDS[types[0]]
        bounds = {
            field: float(getattr(item, key))
            for item in info.metadata
            for key, field in _BOUNDS.items()
            if hasattr(item, key)
        }
        about = info.description or ""
        found.append(ParameterFact(name, kind, info.default, unit, about, optional, choices, **bounds))
    return tuple(found)


_KINDS: dict[Any, Literal["number", "whole", "switch"]] = {float: "number", int: "whole", bool: "switch"}
_BOUNDS = {"ge": "at_least", "gt": "above", "le": "at_most", "lt": "below"}
