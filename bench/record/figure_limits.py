"""Limits of the figures of a certificate, as a campaign file or a file of their own gives them."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic import Field as PydanticField

from bench.record.recording import checksum
from drivers.base.errors import ConfigurationError
from drivers.base.files import SETTINGS_BYTES, parse_toml, read_bounded

FIGURES: Mapping[str, str] = {
    "bias": "deg/h",
    "bias stability, 10 s averages": "deg/h",
    "bias stability, 100 s averages": "deg/h",
    "bias repeatability": "deg/h",
    "scale factor": "",
    "scale-factor nonlinearity": "ppm",
    "scale-factor asymmetry": "ppm",
    "scale-factor repeatability": "ppm",
    "angle random walk": "deg/sqrt(h)",
    "bias instability": "deg/h",
    "bias temperature sensitivity": "deg/h/degC",
    "scale-factor temperature sensitivity": "ppm/degC",
}
"""The figures of every certificate with their units, in its order; what a run gives beyond them follows."""
FURTHER: Mapping[str, str] = {
    "threshold": "deg/h",
    "resolution": "deg/h",
    "warm-up time to 3 s_100": "s",
    "input-axis misalignment, component along the table": "deg",
    "input-axis misalignment, component across the table": "deg",
    "input-axis elevation, unit in its fixture": "deg",
    "scale-factor hysteresis, rising and falling": "ppm",
    "scale-factor repeatability between runs": "ppm",
    "quantisation": "deg",
    "rate random walk": "deg/h/sqrt(h)",
    "rate ramp": "deg/h/h",
    "Allan deviation, minimum": "deg/h",
}
OVER_RUNS = ("bias repeatability", "scale-factor repeatability between runs")
"""Figures that two or more runs of a test give together."""
_TWO_SIDED = 1.959964
"""Standard errors to either side that hold 95 % of a normal distribution."""
_FLAT = 0.95 * math.sqrt(3.0)
"""Likewise of a flat one."""


class Limit(BaseModel):
    """Limits of a figure, in the figure's own unit, the limits themselves included."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    unit: str = ""
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _usable(self) -> Limit:
        if self.low is None and self.high is None:
            raise ValueError("neither low nor high")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low:g} is above high {self.high:g}")
        return self


Judged = Literal["pass", "fail", "undecided"]


class Decision(BaseModel):
    """The rule that decides between pass and fail where a value is not known exactly (JCGM 106).

    "simple acceptance": the value lies inside the limits. "guard band": the limits are drawn in by the expanded
    uncertainty U, so the whole 95 % interval must lie inside; outside as a whole it fails. "false acceptance":
    it passes if the unit is beyond the limits with a probability of at most `risk`, and fails if it is inside
    with no more; errors are normal to either side, 1.96 standard errors to the ends of the interval, or as much
    flat as the standard uncertainty says where it is known (of a flat one 1.65 reach there). What neither
    passes nor fails is undecided, as is a value without an interval under the latter two.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    rule: Literal["simple acceptance", "guard band", "false acceptance"] = "simple acceptance"
    risk: float | None = PydanticField(None, gt=0.0, lt=0.5)

    @model_validator(mode="after")
    def _risk_where_it_counts(self) -> Decision:
        if (self.rule == "false acceptance") != (self.risk is not None):
            raise ValueError('risk goes with rule "false acceptance", and with no other')
        return self

    def judge(
        self,
        value: float,
        interval: tuple[float, float] | None,
        low: float | None,
        high: float | None,
        standard: float | None = None,
    ) -> Judged:
        """Return what the rule says of a value, its 95 % interval and limits; a value that is no number fails.

        `standard`: its standard uncertainty.
        """
        least, most = -math.inf if low is None else low, math.inf if high is None else high
        if not math.isfinite(value):
            return "fail"
        if self.rule == "simple acceptance":
            return "pass" if least <= value <= most else "fail"
        if interval is None or math.isnan(sum(interval)):
            return "undecided"
        if self.risk is None:
            if least <= interval[0] and interval[1] <= most:
                return "pass"
            return "fail" if interval[1] < least or interval[0] > most else "undecided"
        reach = _TWO_SIDED if not standard else 0.5 * (interval[1] - interval[0]) / standard
        flat = min(1.0, max(0.0, (_TWO_SIDED - reach) / (_TWO_SIDED - _FLAT)))
        beyond = _above(most, value, interval, flat) + 1.0 - _above(least, value, interval, flat)
        if beyond <= self.risk and least <= value <= most:
            return "pass"
        return "fail" if 1.0 - beyond <= self.risk else "undecided"


def _above(limit: float, value: float, interval: tuple[float, float], flat: float) -> float:
    """Return the probability that the true value is above a limit; errors are `flat` in part, else normal."""
    if math.isinf(limit):
        return 0.0 if limit > 0.0 else 1.0
    half = interval[1] - value if limit >= value else value - interval[0]
    if half <= 0.0:
        return 1.0 if value > limit else 0.0
    away = (limit - value) / half
    even = min(1.0, max(0.0, 0.5 * (1.0 - 0.95 * away)))
    return flat * even + (1.0 - flat) * 0.5 * math.erfc(_TWO_SIDED * away / math.sqrt(2.0))


SIMPLE = Decision()


@dataclass(frozen=True)
class Limits:
    """Limits by figure, the rule they decide by, and the file that they come from."""

    rows: Mapping[str, Limit] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""
    decision: Decision = SIMPLE


NO_LIMITS = Limits()


def own_figure(figure: str) -> tuple[str, str] | None:
    """Return procedure and name of a measurement that a limit is for, `my-test.scale_factor_error`, else None."""
    procedure, dot, name = figure.partition(".")
    return (procedure, name) if dot and name and re.fullmatch(r"[\w-]+", procedure) else None


def wrong_limits(limits: Mapping[str, Limit]) -> list[str]:
    """Return what is wrong with the names and units of limits: no such figure, another unit than its own."""
    known = {**FIGURES, **FURTHER}
    wrong = []
    for figure, limit in limits.items():
        if own_figure(figure) is not None:
            continue
        if figure not in known:
            near = difflib.get_close_matches(figure, known, n=1)
            wrong.append(f"limits: no figure {figure!r}" + (f"; did you mean {near[0]!r}" if near else ""))
        elif limit.unit != known[figure]:
            wrong.append(f"limits: {figure} is in {known[figure] or 'no unit'}, not {limit.unit!r}")
    return wrong


def parse_limits(table: object, where: str) -> dict[str, Limit]:
    """Return limits from the `limits` table of a file; ConfigurationError names every mistake."""
    if not isinstance(table, Mapping):
        raise _unusable(where, "limits is not a table")
    limits: dict[str, Limit] = {}
    wrong = []
    for figure, row in table.items():
        try:
            limits[figure] = Limit.model_validate(row)
        except ValidationError as error:
            for item in error.errors():
                text = f"{'.'.join(map(str, item['loc']))} {item['msg'].removeprefix('Value error, ')}"
                wrong.append(f"{figure}: {text.strip()}")
    wrong += wrong_limits(limits)
    if wrong:
        raise _unusable(where, "; ".join(wrong))
    return limits


def load_limits(path: Path) -> Limits:
    """Read the `limits` table of a TOML file (a campaign file has one): per figure unit, low and/or high."""
    try:
        content: dict[str, Any] = parse_toml(read_bounded(path, SETTINGS_BYTES))
    except (OSError, ValueError) as error:
        raise _unusable(str(path), str(error)) from error
    if "limits" not in content:
        raise _unusable(str(path), "no limits table")
    try:
        decision = Decision.model_validate(content.get("decision", {}))
    except ValidationError as error:
        wrong = "; ".join(item["msg"].removeprefix("Value error, ") for item in error.errors())
        raise _unusable(str(path), f"decision: {wrong}") from error
    return Limits(parse_limits(content["limits"], str(path)), path.name, checksum(path).sha256, decision)


def _unusable(where: str, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the limits cannot be used",
        where=where,
        found=found,
        expected='tables like [limits."bias"] with unit, low and/or high; figures: '
        + ", ".join([*FIGURES, *FURTHER])
        + "; or procedure.measurement, as my-test.scale_factor_error",
    )
