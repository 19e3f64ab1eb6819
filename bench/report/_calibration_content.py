"""What the report of a system-level calibration shows, and how it is made from an evaluation and an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bench.calibration import Estimate, Evaluation


@dataclass(frozen=True, eq=False)
class CalibrationContent:
    """What the report shows, in printed units; arrays by state, shape (30,), or by position, (positions, 30).

    `target` is NaN for states without one. `estimate`, `truth` (24,): of the parameters, None where not known.
    """

    scheme: str
    home: str
    moves: Sequence[str]
    up_axes: Sequence[str]
    table: str
    dwell_s: float
    duration_s: float
    names: Sequence[str]
    units: Sequence[str]
    prior: NDArray[np.float64]
    sigma: NDArray[np.float64]
    target: NDArray[np.float64]
    degree: NDArray[np.float64]
    course: NDArray[np.float64]
    rank: int
    poorly_seen: Sequence[str] = ()
    warnings: Sequence[str] = ()
    estimate: NDArray[np.float64] | None = None
    truth: NDArray[np.float64] | None = None
    innovation_rms: float | None = None
    created_utc: str = ""


def scheme_content(evaluation: Evaluation, created_utc: str = "") -> CalibrationContent:
    """Return the content of a scheme's evaluation."""
    from bench.calibration import STATE_NAMES, STATE_UNITS, UNIT_SIZE, home_text

    schedule, task = evaluation.schedule, evaluation.task
    return CalibrationContent(
        scheme=schedule.name,
        home=home_text(schedule.home),
        moves=[str(move) for move in schedule.moves],
        up_axes=schedule.up_axes(),
        table=evaluation.table,
        dwell_s=schedule.dwell_s,
        duration_s=schedule.duration_s,
        names=STATE_NAMES,
        units=STATE_UNITS,
        prior=task.prior_sigma / UNIT_SIZE,
        sigma=evaluation.sigma / UNIT_SIZE,
        target=np.concatenate([np.full(6, np.nan), task.target_sigma]) / UNIT_SIZE,
        degree=evaluation.degrees.normalised,
        course=evaluation.course / UNIT_SIZE,
        rank=evaluation.degrees.rank,
        poorly_seen=[str(each) for each in evaluation.combinations],
        warnings=evaluation.warnings,
        created_utc=created_utc,
    )


def calibration_content(
    evaluation: Evaluation,
    estimate: Estimate,
    truth: NDArray[np.float64] | None = None,
    created_utc: str = "",
) -> CalibrationContent:
    """Return the content of a calibration; `truth` (24,), SI, where the IMU is emulated."""
    from bench.calibration import PARAMETERS, UNIT_SIZE

    units = UNIT_SIZE[PARAMETERS]
    content = scheme_content(evaluation, created_utc)
    sigma, course = content.sigma.copy(), content.course.copy()
    sigma[PARAMETERS] = estimate.sigma / units
    if len(estimate.course) == len(course):
        course[:, PARAMETERS] = estimate.course / units
    return replace(
        content,
        sigma=sigma,
        course=course,
        estimate=estimate.parameters / units,
        truth=None if truth is None else truth / units,
        innovation_rms=estimate.innovation_rms,
    )
