"""What the report of a system-level calibration shows, and how it is made from an evaluation and an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.calibration import BiasWander, CalibrationRun, Estimate, Evaluation

CLASSICAL = ("19-position", "23-position")
_LOUD = 1.1


@dataclass(frozen=True, eq=False)
class SchemeColumn:
    """What one scheme, or the first turns of one, sees: white-noise degree and gain ratio by state, (30,)."""

    title: str
    rank: int
    degree: Array
    gain: Array


@dataclass(frozen=True, eq=False)
class CalibrationContent:
    """What the report shows, in printed units; arrays by state, shape (30,), or by position, (positions, 30).

    `target` is NaN for states without one. `estimate`, `truth` (24,): of the parameters, None where not known;
    `nees`: mean square of the errors over their covariance, 1 if sigma is right. `first_turns`: this scheme cut
    after so many turns; `others`: classical schemes under the same task, beside it.
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
    prior: Array
    sigma: Array
    target: Array
    degree: Array
    course: Array
    rank: int
    poorly_seen: Sequence[str] = ()
    warnings: Sequence[str] = ()
    estimate: Array | None = None
    truth: Array | None = None
    nees: float | None = None
    innovation_rms: float | None = None
    first_turns: Sequence[SchemeColumn] = ()
    others: Sequence[SchemeColumn] = ()
    facts: Sequence[tuple[str, str]] = ()
    created_utc: str = ""


def scheme_content(evaluation: Evaluation, created_utc: str = "") -> CalibrationContent:
    """Return the content of a scheme's evaluation."""
    from bench.analysis.calibration import STATE_NAMES, STATE_UNITS, UNIT_SIZE, home_text

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
        first_turns=_first_turns(evaluation),
        others=_others(evaluation),
        created_utc=created_utc,
    )


def calibration_content(
    evaluation: Evaluation,
    estimate: Estimate,
    truth: Array | None = None,
    created_utc: str = "",
    *,
    run: CalibrationRun | None = None,
    wander: BiasWander | None = None,
) -> CalibrationContent:
    """Return the content of a calibration; `truth` (24,), SI, where the IMU is emulated."""
    from bench.analysis.calibration import PARAMETERS, UNIT_SIZE, missed_targets

    units = UNIT_SIZE[PARAMETERS]
    content = scheme_content(evaluation, created_utc)
    sigma, course = content.sigma.copy(), content.course.copy()
    sigma[PARAMETERS] = estimate.sigma / units
    if len(estimate.course) == len(course):
        course[:, PARAMETERS] = estimate.course / units
    nees = None
    if truth is not None:
        error = estimate.parameters - truth
        nees = float(error @ np.linalg.solve(estimate.covariance, error)) / len(error)
    warnings = [*missed_targets(estimate.sigma, evaluation.task), *evaluation.cautions]
    if estimate.innovation_rms > _LOUD and wander is None:
        warnings.insert(
            0,
            f"Innovations have rms {estimate.innovation_rms:.2f}: the unit is noisier than assumed, or its "
            "biases wander. Every sigma here is too small: give the noise (--arw, --vrw, --wander-dph, "
            "--wander-ug).",
        )
    return replace(
        content,
        sigma=sigma,
        course=course,
        estimate=estimate.parameters / units,
        truth=None if truth is None else truth / units,
        nees=nees,
        innovation_rms=estimate.innovation_rms,
        warnings=warnings,
        facts=[] if run is None else _facts(run),
    )


def _facts(run: CalibrationRun) -> list[tuple[str, str]]:
    facts = [("Unit", run.unit_id), ("Record", run.run_id), ("Latitude", f"{run.latitude_deg:.4f} deg")]
    if run.mounting:
        facts.append(("Mounted with all axes at 0", run.mounting))
    if run.turn_s:
        turned = f"{min(run.turn_s):.1f} to {max(run.turn_s):.1f} s"
        facts.append(("Turns as the table made them, settling included", turned))
    return facts


def _column(title: str, evaluation: Evaluation) -> SchemeColumn:
    degrees = evaluation.degrees
    return SchemeColumn(title, degrees.rank, degrees.normalised, evaluation.gain)


def _first_turns(evaluation: Evaluation) -> list[SchemeColumn]:
    """Return what the first one, two, three turns alone would see, and the whole scheme."""
    from bench.analysis.calibration import evaluate

    schedule = evaluation.schedule
    found = []
    for count in (1, 2, 3):
        if count < len(schedule.moves):
            part = schedule.with_(moves=schedule.moves[:count])
            title = " ".join(str(move) for move in part.moves)
            found.append(_column(title, evaluate(evaluation.task, part)))
    return [*found, _column("whole scheme", evaluation)]


def _others(evaluation: Evaluation) -> list[SchemeColumn]:
    """Return the classical schemes in their own homes, and in this scheme's, under the same task and dwell."""
    from bench.analysis.calibration import evaluate, load_scheme

    schedule = evaluation.schedule
    pattern = {"dwell_s": schedule.dwell_s, "rate_dps": schedule.rate_dps, "profile": schedule.profile}
    names = [name for name in ("19-position-z-up", *CLASSICAL) if name != schedule.name]
    schemes = [load_scheme(name).with_(**pattern) for name in names]
    columns = [_column(scheme.name, evaluate(evaluation.task, scheme)) for scheme in schemes]
    return [_column(schedule.name, evaluation), *columns]
