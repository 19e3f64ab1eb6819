"""From run folders to ramp runs, one for each gyro of a run, and to a study for each ring laser in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.runs import case_temp_c, gyros_of, require_completed
from bench.analysis.common.seconds import gyro_seconds
from bench.analysis.rlg._rows import RampRun, ramp_run
from bench.analysis.rlg._study import RlgStudy, run_rlg_study
from bench.analysis.rlg._variables import CANDIDATES
from bench.record.recording import Run, Table, second_rows
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError

_MOVING = ("ramp_1", "ramp_2")
_FEW_LOST = 1e-3
"""Part of the samples that may be missing without a remark."""
_KEPT = (*_MOVING, "dwell_1", "dwell_2")


def study_units(
    training: Sequence[Path],
    tests: Sequence[Path],
    gyros: tuple[str, ...] = (),
    variables: Sequence[str] = CANDIDATES,
    *,
    p_enter: float = 0.05,
    p_remove: float = 0.10,
) -> dict[str, RlgStudy]:
    """Return the study of every unit of the training runs, judged on its test runs, by unit id.

    `gyros`: these only. ConfigurationError for a training run that was not completed.
    """
    judging = _by_unit(tests, gyros, allow_invalid=True)
    return {
        unit: run_rlg_study(runs, judging.get(unit, []), variables, p_enter=p_enter, p_remove=p_remove)
        for unit, runs in _by_unit(training, gyros, allow_invalid=False).items()
    }


def _by_unit(
    folders: Sequence[Path], gyros: tuple[str, ...], *, allow_invalid: bool
) -> dict[str, list[RampRun]]:
    runs: dict[str, list[RampRun]] = {}
    for folder in folders:
        if not allow_invalid:
            require_completed(Run.open(folder))
        for run in load_ramp_runs(folder, gyros):
            runs.setdefault(run.unit_id, []).append(run)
    return runs


def load_ramp_runs(folder: Path, gyros: tuple[str, ...] = ()) -> list[RampRun]:
    """Return the rows of every gyro (or those named) of a `thermal-ramp` run folder.

    Rows are those of the ramps and dwells: before and after, the unit goes somewhere else fast. T1 is the
    gyro's own case sensor if its stream carries one, else the chamber's sensor on its case; T2 is the gyro's
    own temperature. ConfigurationError names what a folder lacks.
    """
    run = Run.open(folder)
    phases = {phase.name: phase for phase in run.phases()}
    if "ramp_1" not in phases:
        raise ConfigurationError(
            "the run has no ramp: it cannot be fitted",
            where=str(folder),
            found=f"{run.manifest.procedure}, {run.manifest.outcome}: " + (", ".join(phases) or "no phases"),
            expected="a thermal-ramp run that got as far as its first ramp",
            remedy=run.manifest.reason or "run thermal-ramp",
        )
    names = gyros_of(run, gyros)
    start = math.ceil(phases["ramp_1"].start_s)
    end = math.floor(max(phases[name].end_s for name in _KEPT if name in phases))
    ramps = [(phases[name].start_s, phases[name].end_s) for name in _MOVING if name in phases]
    return [_ramp_run(run, name, start, end, ramps) for name in names]


def _ramp_run(run: Run, gyro: str, start: int, end: int, ramps: list[tuple[float, float]]) -> RampRun:
    table = run.gyro(gyro, None, float(start), float(end) + 1e-6)
    means = gyro_seconds(run, gyro, start, end)
    parameters = run.manifest.parameters
    direction = "down first" if parameters.get("downwards") else "up first"
    made = ramp_run(
        run.manifest.run_id,
        run.manifest.unit(gyro),
        np.arange(start + 1.0, end + 1.0),
        means.of(table["case_temp_c"], second_rows(table, start))
        if "case_temp_c" in table
        else case_temp_c(run, gyro, start, end),
        means.temp_c,
        DPH_PER_DPS * means.rate_dps - run.earth_rate_dph(np.arange(start + 0.5, end)),
        true_bias_dph=run.true_means(gyro, "bias_dph", start, end),
        ramps=ramps,
        checksum=run.checksum,
        kind=f"{_text(parameters.get('low_c'))} to {_text(parameters.get('high_c'))} °C, {direction}",
    )
    remarks = (*_lost(run, gyro, table, end - start), *means.remarks, *made.remarks)
    return replace(made, remarks=remarks)


def _lost(run: Run, gyro: str, table: Table, seconds_long: int) -> list[str]:
    """Return a remark if samples are missing: means of what is left carry more of the angle's resolution."""
    rate_hz = run.manifest.stream.get(gyro, {}).get("sample_rate_hz")
    if not rate_hz:
        return []
    expected = round(rate_hz * seconds_long)
    missing = expected - int(np.count_nonzero(table["valid"]))
    if missing <= _FEW_LOST * expected:
        return []
    return [f"{missing} of {expected} samples are missing or not valid: the means are noisier than usual"]


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else "?"
