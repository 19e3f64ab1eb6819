"""Limits of the figures of a certificate, as a campaign file or a file of their own gives them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

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
    "scale-factor hysteresis, rising and falling": "ppm",
    "scale-factor repeatability between runs": "ppm",
    "quantisation": "deg",
    "rate random walk": "deg/h/sqrt(h)",
    "rate ramp": "deg/h/h",
}
OVER_RUNS = ("bias repeatability", "scale-factor repeatability between runs")
"""Figures that two or more runs of a test give together."""


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


@dataclass(frozen=True)
class Limits:
    """Limits by figure, and the file that they come from."""

    rows: Mapping[str, Limit] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""


NO_LIMITS = Limits()


def wrong_limits(limits: Mapping[str, Limit]) -> list[str]:
    """Return what is wrong with the names and units of limits: no such figure, another unit than its own."""
    known = {**FIGURES, **FURTHER}
    wrong = []
    for figure, limit in limits.items():
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
    return Limits(parse_limits(content["limits"], str(path)), path.name, checksum(path).sha256)


def _unusable(where: str, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the limits cannot be used",
        where=where,
        found=found,
        expected='tables like [limits."bias"] with unit, low and/or high; figures: '
        + ", ".join([*FIGURES, *FURTHER]),
    )
