"""What a procedure is: a function that drives the bench, with parameters that know their units and limits."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of

if TYPE_CHECKING:
    from bench.control.session import Bench
    from bench.record.benchfile import BenchFile

ENTRY_POINT_GROUP = "gyrobench.procedures"


class Parameters(BaseModel):
    """Base of a procedure's parameters; fields are made with `parameter`, unknown names are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


def parameter(default: Any, help_text: str, unit: str = "", **limits: Any) -> Any:
    """Declare a parameter: default, one line of help, unit, and pydantic limits (ge, gt, le, lt, min_length)."""
    return Field(default, description=help_text, json_schema_extra={"unit": unit}, **limits)


@dataclass(frozen=True)
class Procedure:
    """A test an operator can run.

    `source` names the standard or document it follows. `expected_duration_s` estimates bench time from the
    parameters. `demands` returns what the run will ask of the devices, so that limits are checked before
    anything moves.
    """

    name: str
    title: str
    source: str
    parameters: type[Parameters]
    run: Callable[[Bench, Any], None]
    expected_duration_s: Callable[[Any], float]
    demands: Callable[[Any], Demands]
    tests: Literal["gyro", "platform"] = "gyro"
    """What kind of unit it tests; the bench must have at least one."""
    figures: Callable[[Any], Collection[str]] = lambda parameters: ()
    """Which figures of a certificate (`bench.record.figure_limits`) a run with these parameters measures."""
    upright: bool = True
    """Whether it turns the units about the vertical: their axis then points up with the outer axes at 0."""

    def check_bench(self, file: BenchFile) -> None:
        """Raise ConfigurationError if the bench has no unit that it tests or no axis to turn it about."""
        if not getattr(file, self.tests):
            raise ConfigurationError(
                f"{self.name} tests a {self.tests}, and the bench has none",
                where=file.bench.name,
                found=", ".join(file.units) or "no units",
                expected=f"at least one [[{self.tests}]]",
                remedy="name the bench file that describes it",
            )
        carrier = file.table.all_axes[-1]
        if self.upright and carrier.direction != "up":
            raise ConfigurationError(
                f"{self.name} turns the units about the vertical, and this table does not",
                where="table.axes, the last one",
                found=f"{carrier.name} points {carrier.direction} with all axes at 0",
                expected="an axis that points up with all axes at 0",
                remedy="count the outer axes' angles from where it points up, or take another table",
            )

    def parse(self, values: Mapping[str, Any]) -> Parameters:
        """Return the parameters for `values`; ConfigurationError names every wrong one."""
        try:
            return self.parameters.model_validate(dict(values))
        except ValidationError as error:
            raise _parameter_error(self, error) from error


@dataclass(frozen=True)
class Demands:
    """The extremes a run will ask for."""

    max_rate_dps: float = 0.0
    min_temp_c: float = 23.0
    max_temp_c: float = 23.0
    max_ramp_k_per_min: float = 0.0


def load_procedures() -> dict[str, Procedure]:
    """Return all installed procedures by name, third-party ones included."""
    points = sorted(entry_points_of(ENTRY_POINT_GROUP), key=lambda point: point.name)
    return {point.name: cast(Procedure, point.load()) for point in points}


def find_procedure(name: str) -> Procedure:
    """Return the procedure `name`; ConfigurationError with the nearest names if there is none."""
    procedures = load_procedures()
    if name in procedures:
        return procedures[name]
    near = difflib.get_close_matches(name, procedures, n=1)
    raise ConfigurationError(
        f"there is no procedure {name!r}",
        expected="one of " + ", ".join(procedures),
        remedy=f"did you mean {near[0]!r}" if near else "`gyrobench procedures` lists them",
    )


def parameter_rows(procedure: Procedure) -> list[tuple[str, str, str, str, str]]:
    """Return (name, default, unit, limits, help) of every parameter, as text."""
    rows = []
    for name, info in procedure.parameters.model_fields.items():
        extra = info.json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        rows.append((name, str(info.default), unit, _limits_text(info.metadata), info.description or ""))
    return rows


def _limits_text(metadata: list[Any]) -> str:
    signs = (("ge", ">="), ("gt", ">"), ("le", "<="), ("lt", "<"))
    return ", ".join(
        f"{sign} {getattr(item, key):g}" for item in metadata for key, sign in signs if hasattr(item, key)
    )


def _parameter_error(procedure: Procedure, error: ValidationError) -> ConfigurationError:
    wrong = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"])
        if item["type"] == "extra_forbidden":
            near = difflib.get_close_matches(name, procedure.parameters.model_fields, n=1)
            hint = f"; did you mean {near[0]!r}" if near else ""
            wrong.append(f"{name} is not a parameter{hint}")
        else:
            wrong.append(f"{name} = {item['input']!r}: {item['msg'].lower()}")
    return ConfigurationError(
        "parameters that cannot be used",
        where=procedure.name,
        found="; ".join(wrong),
        expected="parameters: " + ", ".join(procedure.parameters.model_fields),
        remedy=f"`gyrobench procedures {procedure.name}` shows units, defaults and limits",
    )
