"""What a procedure is: a function that drives the bench, with parameters that know their units and limits."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.control.parameter_facts import parameter_facts
from drivers.base.errors import ConfigurationError, LimitExceeded
from drivers.base.plugins import entry_points_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from bench.control.session import Bench
    from bench.record.benchfile import BenchFile
    from bench.record.events.run import Interval

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
    intervals: Callable[[Any, ArrayLike], Sequence[Interval]] | None = None
    """Which intervals of measurement a run with these parameters has, of a unit with this output at rest (1 s
    means, deg/h, (n,)); the four dwells of a search for east as `axis_east`. `gyrobench foretell` then says what
    the run will be able to resolve."""
    upright: bool = True
    """Whether it turns the units about the vertical: their axis then points up with the outer axes at 0."""
    text: str = field(default="", repr=False)
    """Source of a procedure from a file of the user's own; a run keeps it as `procedure.py`."""
    file: str = ""
    """That file as it was named, `./my_test.py`."""

    def __repr__(self) -> str:
        return f"<Procedure: {self.name}: {self.title}, parameters {', '.join(self.parameters.model_fields)}>"

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


def beyond_limits(demands: Demands, file: BenchFile) -> Iterator[str]:
    """Yield what of a run's demands the bench file forbids, as text with units."""
    limits = file.limits
    if demands.min_temp_c < limits.min_temp_c or demands.max_temp_c > limits.max_temp_c:
        yield f"{demands.min_temp_c:g} .. {demands.max_temp_c:g} degC"
    if demands.max_ramp_k_per_min > limits.max_ramp_k_per_min:
        yield f"{demands.max_ramp_k_per_min:g} K/min"
    if demands.max_rate_dps > limits.max_rate_dps:
        yield f"{demands.max_rate_dps:g} deg/s"


def require_none_beyond(found: Sequence[str], file: BenchFile, what: str, where: str) -> None:
    """Raise LimitExceeded if anything was found beyond the bench file's limits: nothing has been made yet."""
    if not found:
        return
    limits = file.limits
    raise LimitExceeded(
        f"{what} demands what the bench file forbids",
        where=where,
        found="; ".join(found),
        expected=f"{limits.min_temp_c:g} .. {limits.max_temp_c:g} degC, "
        f"at most {limits.max_ramp_k_per_min:g} K/min and at most {limits.max_rate_dps:g} deg/s ([limits])",
        remedy=f"change the parameters of {what}, or [limits] if bench and units really allow it",
    )


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
    remedy = f"did you mean {near[0]!r}?" if near else "`gyrobench procedures` lists them"
    if name.endswith(".py"):
        remedy = "install the package that has it (docs/own_procedure.md): only run and rehearse take a file"
    raise ConfigurationError(
        f"there is no procedure {name!r}", expected="one of " + ", ".join(procedures), remedy=remedy
    )


def read_procedure(name: str) -> Procedure:
    """Return an installed procedure, or the one in a Python file of the user's own (`./mine.py`), which is run.

    The file finds modules beside it, after all that is installed. ConfigurationError if it cannot be loaded, or
    has no procedure, or more than one.
    """
    if not name.endswith(".py"):
        return find_procedure(name)
    path = Path(name).resolve()
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            "the procedure's file cannot be read",
            where=name,
            found=getattr(error, "strerror", None) or str(error),
            expected="a Python file",
            remedy="`gyrobench new procedure NAME` writes one",
        ) from error
    module = _module_of(path, name)
    found = {id(value): value for value in vars(module).values() if isinstance(value, Procedure)}
    if len(found) != 1:
        names = ", ".join(key for key, value in vars(module).items() if isinstance(value, Procedure))
        raise ConfigurationError(
            "a file with more than one procedure" if found else "a file without a procedure",
            where=name,
            found=names or "no object made by `Procedure(...)`",
            expected="one, as in PROCEDURE = Procedure(...)",
            remedy="keep each in a file of its own, and import functions, not procedures"
            if found
            else "`gyrobench new procedure NAME` writes a file that has one",
        )
    return replace(next(iter(found.values())), text=text, file=name)


def _module_of(path: Path, name: str) -> ModuleType:
    """Run a Python file as a module; ConfigurationError with the line for whatever it raises."""
    spec = spec_from_file_location(f"_procedure_file_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # pydantic looks up there what annotations name
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
        raise ConfigurationError(
            "the procedure's file cannot be loaded",
            where=name if line is None else f"{name}, line {line}",
            found=f"{type(error).__name__}: {error}",
            expected=f"a file that `python {name}` runs without an error",
        ) from error
    return module


def parameter_rows(procedure: Procedure) -> list[tuple[str, str, str, str, str]]:
    """Return (name, default, unit, limits, help) of every parameter, as text."""
    facts = parameter_facts(procedure.parameters)
    return [(fact.name, str(fact.default), fact.unit, fact.limits, fact.meaning) for fact in facts]


def _parameter_error(procedure: Procedure, error: ValidationError) -> ConfigurationError:
    wrong = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"])
        if item["type"] == "extra_forbidden":
            near = difflib.get_close_matches(name, procedure.parameters.model_fields, n=1)
            hint = f"; did you mean {near[0]!r}" if near else ""
            wrong.append(f"{name} is not a parameter{hint}")
        elif name:
            wrong.append(f"{name} = {item['input']!r}: {item['msg'].lower()}")
        else:  # of several parameters together
            wrong.append(item["msg"].removeprefix("Value error, "))
    return ConfigurationError(
        "parameters that cannot be used",
        where=procedure.name,
        found="; ".join(wrong),
        expected="parameters: " + ", ".join(procedure.parameters.model_fields),
        remedy=f"`gyrobench procedures {procedure.file or procedure.name}` shows units, defaults and limits",
    )
