"""From run folders to a study for each ring laser in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.analysis.rlg._dataset import load_ramp_runs
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._study import RlgStudy, run_rlg_study
from bench.analysis.rlg._variables import CANDIDATES
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError


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
        manifest = Run.open(folder).manifest
        if manifest.outcome != "completed" and not allow_invalid:
            raise ConfigurationError(
                "a run that was not completed cannot be fitted",
                where=str(folder),
                found=f"{manifest.outcome}: {manifest.reason}",
                expected="runs that met their own criteria",
                remedy="leave it out, or name it with --test to see what the equation makes of it",
            )
        for run in load_ramp_runs(folder, gyros):
            runs.setdefault(run.unit_id, []).append(run)
    return runs
