"""From a run folder or a CSV record to the estimated parameters and their compensation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.calibration._compensation import ImuCompensation
from bench.analysis.calibration._conventions import Noise, Site, Task
from bench.analysis.calibration._estimator import BiasWander, Estimate, Options, estimate
from bench.analysis.calibration._further import after, changes, together
from bench.analysis.calibration._imu_log import read_imu_log
from bench.analysis.calibration._inflation import Inflation, inflation
from bench.analysis.calibration._record_noise import RecordNoise, record_noise
from bench.analysis.calibration._result import Evaluation, evaluate
from bench.analysis.calibration._runs import CalibrationRun, increments_of, load_calibration_run
from bench.analysis.calibration._schedule import load_scheme
from bench.analysis.common.compensation import provenance
from bench.analysis.common.runs import require_different
from bench.record.recording import Run, checksum
from bench.record.shown import Shown
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.common.uncertainty import Budget

_LARGEST = 30.0
_MOVED_DEG = 0.02
"""By so much the latitude is moved to see what depends on it."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Shown):
    """What a record gave: the estimate, what its scheme promised, and what the record shows of its noise.

    `corrected`: the estimate is with the noise and wander that the record shows, not with those told.
    `options`: how it was estimated. `earlier`: the calibrations of the unit that are in the estimate; `alone` is
    what this record gave by itself.
    """

    run: CalibrationRun
    estimate: Estimate
    evaluation: Evaluation
    wander: BiasWander | None
    noise: RecordNoise
    corrected: bool
    options: Options
    alone: Estimate
    earlier: tuple[ImuCompensation, ...] = ()

    def shown(self) -> dict[str, object]:
        """Return unit, run and scheme, and how well the estimate explains the record (1: as its noise says)."""
        return {
            "unit": self.run.unit_id,
            "run": self.run.run_id,
            "scheme": self.run.schedule.name,
            "innovation rms": self.estimate.innovation_rms,
        }

    @cached_property
    def budgets(self) -> dict[str, Budget]:
        """The uncertainty budget of each parameter by its name, in its printed unit; takes one more estimate."""
        from bench.analysis.calibration._budget import parameter_budgets  # the one part that needs scipy

        task, run = self.evaluation.task, self.run
        site = task.site
        elsewhere = replace(site, latitude_deg=site.latitude_deg - _MOVED_DEG, gravity=site.gravity_mps2)
        noise = self.noise.found if self.corrected else task.noise
        moved = estimate(
            run.increments, replace(task, site=elsewhere, noise=noise), self.options, run.schedule
        )
        per_latitude_deg = (self.alone.parameters - moved.parameters) / _MOVED_DEG
        return parameter_budgets(self.estimate, site.gravity_mps2, per_latitude_deg, run.certificates)

    @cached_property
    def inflation(self) -> Inflation:
        """By how much a navigation filter has to take the noise larger than the white noise of this record."""
        run = self.run.increments
        noise = self.noise.found if self.corrected else self.evaluation.task.noise
        length_s = len(run.angle_rad) * run.period_s
        told = ((self.wander, 1.0),) if self.wander is not None else ()
        return inflation(noise, self.noise.wanders or told, self.evaluation.task.site, length_s)

    def compensation(self, declared: Sequence[str] = ()) -> ImuCompensation:
        """Return the compensation; `declared`: what its user has to know of it."""
        names = ("parameters", "sigma", "covariance", "lever_m", "lag_s", "innovation_rms")
        runs = {run: checksum for each in self.earlier for run, checksum in each.runs.items()}
        return ImuCompensation(
            self.run.unit_id,
            **{name: getattr(self.estimate, name) for name in names},
            scheme=", ".join([*(each.scheme for each in self.earlier), self.run.schedule.name]),
            declared=tuple(declared),
            **provenance({**runs, self.run.run_id: self.run.checksum}),
        )


def load_record(
    record: Path,
    *,
    scheme: str | None = None,
    gyro: str | None = None,
    dwell_s: float = 180.0,
    latitude_deg: float | None = None,
) -> CalibrationRun:
    """Return what a run folder of the scheme holds, or a log with what is told of it.

    A log is what `read_imu_log` reads and needs `scheme`; without a mapping, `latitude_deg`, too. RecordError
    says what makes a record unusable.
    """
    if record.is_dir() and Run.open(record).manifest.imported is None:
        run = load_calibration_run(record, gyro)
        return run if latitude_deg is None else replace(run, latitude_deg=latitude_deg)
    mapped = record.is_dir() or record.suffix == ".toml"
    if scheme is None or (latitude_deg is None and not mapped):
        raise ConfigurationError(
            "a log does not say what was turned where",
            where=str(record),
            found="--scheme " + (scheme or "left out"),
            expected="--scheme, and --dwell-s if it was not 180"
            if mapped
            else "--scheme and --latitude-deg, and --dwell-s if it was not 180",
            remedy="a run folder of `gyrobench run system-calibration` says it itself",
        )
    log = read_imu_log(record)
    latitude_deg = log.latitude_deg if latitude_deg is None else latitude_deg
    assert latitude_deg is not None  # a mapping says it
    increments, remarks = increments_of(log.rates_dps, log.forces_mps2, log.period_s, str(record))
    return CalibrationRun(
        run_id=log.file.stem,
        checksum=checksum(log.file).sha256,
        gyro=gyro or log.unit_id or log.file.stem,
        unit_id=gyro or log.unit_id or log.file.stem,
        latitude_deg=latitude_deg,
        increments=increments,
        schedule=load_scheme(scheme).with_(dwell_s=dwell_s),
        table="by-hand",
        mounting="",
        turn_s=(),
        truth=None,
        remarks=remarks,
    )


def calibrate(
    run: CalibrationRun,
    noise: Noise,
    *,
    gravity_mps2: float | None = None,
    wander: BiasWander | None = None,
    lever_arms: bool = False,
    range_dps: float | None = None,
    as_told: bool = False,
    earlier: Sequence[ImuCompensation] = (),
    prior_scale: float = 1.0,
) -> Calibration:
    """Estimate the parameters of an IMU from the record of a scheme; `range_dps`: the measuring range.

    `prior_scale`: how many times larger its errors may be than those of a navigation-grade unit after its factory
    calibration (`Task`). ConfigurationError below 1, and above 30, where turns are no longer known well enough.

    `noise` is what is known of the unit beforehand. Unless `as_told`, the estimate is made again with the noise
    and the wander that the record shows. `earlier`: calibrations of the same unit by other runs, whose
    information is added; what changed since is a caution. UnitMismatch for another unit's, ConfigurationError for
    a run twice.
    """
    for each in earlier:
        each.require_unit(run.unit_id)
        if run.run_id in each.runs:
            raise ConfigurationError(
                "the run is in the earlier calibration already", where=run.run_id, found=", ".join(each.runs)
            )
    every = [(name, checksum) for each in earlier for name, checksum in each.runs.items()]
    require_different([*every, (run.run_id, run.checksum)])
    if not 1.0 <= prior_scale <= _LARGEST:
        raise ConfigurationError(
            "errors that a scheme does not calibrate",
            where="prior_scale",
            found=f"{prior_scale:g} times those of a navigation-grade unit",
            expected=f"1 to {_LARGEST:g}",
            remedy="calibrate a unit of larger errors by hand first, and this scheme on its corrected output",
        )
    task = Task(site=Site(latitude_deg=run.latitude_deg, gravity=gravity_mps2), noise=noise)
    task = replace(task, prior_sigma=task.prior_sigma * np.where(np.arange(30) // 3 == 1, 1.0, prior_scale))
    options = Options(
        passes=3 if prior_scale == 1.0 else 6,
        wander=wander,
        lever_arms=lever_arms,
        alignment_s=min(60.0, 0.8 * run.schedule.dwell_s),
        gyro_range_dps=range_dps,
    )
    estimated = estimate(run.increments, task, options, run.schedule)
    shown = record_noise(run.increments, task, options, estimated, run.schedule)
    if not as_told:
        wander = wander or shown.wander
        options = replace(options, wander=wander)
        estimated = estimate(run.increments, replace(task, noise=shown.found), options, run.schedule)
    evaluation = evaluate(after(task, earlier) if earlier else task, run.schedule, run.table)
    remarks = [text for each in earlier for text in changes(estimated, task, each)]
    if earlier:
        runs = ", ".join(run for each in earlier for run in each.runs)
        remarks.append(f"Together with {runs}: values and sigmas are of all runs, the course is this run's.")
    return Calibration(
        run,
        together(estimated, task, earlier) if earlier else estimated,
        replace(evaluation, cautions=(*run.remarks, *remarks, *evaluation.cautions)),
        wander,
        shown,
        not as_told,
        options,
        estimated,
        tuple(earlier),
    )
