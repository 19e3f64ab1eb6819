"""What the whirl report shows, independent of where it comes from: plain frozen values, units in the names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bench.present.report._content import RunSummary
from drivers.base.arrays import Array


@dataclass(frozen=True)
class WhirlLine:
    """A fitted line m: its amplitude about x and y in body axes, sd an axis, |a|^2 / (2 sd^2)."""

    line: float
    x_arcsec: float
    y_arcsec: float
    sd_arcsec: float
    statistic: float


@dataclass(frozen=True, eq=False)
class WhirlJudgement:
    """A run before and after: carrier tilt about x and y minus its two-turn mean, (n,) arcsec; rms an axis."""

    run_id: str
    time_s: Array
    before_x: Array
    before_y: Array
    after_x: Array
    after_y: Array
    locked_before_arcsec: float
    locked_after_arcsec: float
    locked_patent_arcsec: float | None
    total_before_arcsec: float
    total_after_arcsec: float


@dataclass(frozen=True, eq=False)
class WhirlContent:
    """Everything a whirl report shows; arrays of one length within each group.

    `residual_*`: integrated body tilt of the run fitted and its fit. `orbit_*`: theta_x against theta_y over a
    turn, in rotating axes. `spectrum_*`: amplitude against line. `free` names what no run can give,
    `gauge` how it was set. `facts` are labelled figures of the fit.
    """

    unit_id: str
    created_utc: str
    runs: Sequence[RunSummary]
    lines: Sequence[WhirlLine]
    judgements: Sequence[WhirlJudgement]
    residual_time_s: Array
    residual_x: Array
    residual_y: Array
    residual_fit_x: Array
    residual_fit_y: Array
    orbit_x: Array
    orbit_y: Array
    spectrum_lines: Array
    spectrum_before: Array
    spectrum_after: Array
    free: str
    gauge: str
    declared: Sequence[str] = ()
    findings: Sequence[str] = ()
    facts: Sequence[tuple[str, str]] = ()
    judged_on_fitted: bool = False
    file_name: str = ""
    file_sha256: str = ""
    software: Mapping[str, str] = field(default_factory=dict)
