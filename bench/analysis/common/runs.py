"""What every fit asks of the runs it is made from and judged on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from bench.record.recording import Run
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


class _UnitRun(Protocol):
    @property
    def run_id(self) -> str: ...
    @property
    def unit_id(self) -> str: ...
    @property
    def checksum(self) -> str: ...


def require_separate(training: Sequence[_UnitRun], judging: Sequence[_UnitRun]) -> None:
    """Raise ConfigurationError for no training run, runs of several units, or a run both fitted and judged."""
    units = {run.unit_id for run in (*training, *judging)}
    if not training or len(units) > 1:
        raise ConfigurationError(
            "one fit is of one unit",
            where="fit",
            found=", ".join(sorted(units)) or "no training run",
            expected="training runs and test runs of one unit: a compensation belongs to one gyro",
            remedy="fit each unit on its own runs",
        )
    require_different((run.run_id, run.checksum) for run in training)
    require_different((run.run_id, run.checksum) for run in judging)
    require_unseen(training, judging)


def require_different(runs: Iterable[tuple[str, str]]) -> None:
    """Raise ConfigurationError for a recording that is there twice: it would count as two independent ones.

    `runs`: name and checksum of each; one without a checksum is never taken for another.
    """
    seen: dict[str, str] = {}
    for name, checksum in runs:
        if checksum and checksum in seen:
            twice = name if name == seen[checksum] else f"{seen[checksum]} and {name}"
            raise ConfigurationError(
                "a recording is named twice",
                where="fit",
                found=twice,
                expected="different recordings: each counts as an independent one",
                remedy="name each once; a copy is no further run",
            )
        seen[checksum] = name


def require_unseen(training: Sequence[_UnitRun], judging: Sequence[_UnitRun]) -> None:
    """Raise ConfigurationError for a run both fitted and judged.

    The same run is told by its checksum; a run without one is never taken for another.
    """
    seen = {run.checksum for run in training if run.checksum}
    if twice := [run.run_id for run in judging if run.checksum in seen]:
        raise ConfigurationError(
            "a run is used for fitting and for judging",
            where="fit",
            found=", ".join(twice),
            expected="different runs: a fit is judged on what it has not seen",
            remedy="name each run once",
        )


def require_completed(run: Run) -> None:
    """Raise ConfigurationError for a run that did not meet its own criteria."""
    if run.manifest.outcome != "completed":
        raise ConfigurationError(
            "a run that was not completed cannot be fitted",
            where=str(run.place),
            found=f"{run.manifest.outcome}: {run.manifest.reason}",
            expected="runs that met their own criteria",
            remedy="leave it out, or name it with --test to see what the fit makes of it",
        )


def gyros_of(run: Run, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return `names`, or all gyros of the run if there are none; ConfigurationError for one it does not have."""
    units = run.manifest.units
    unknown = [name for name in names if name not in units]
    if unknown or not units:
        raise ConfigurationError(
            "the run has no such gyro",
            where=str(run.place),
            found=", ".join(unknown),
            expected=", ".join(units),
        )
    return tuple(names or units)


def case_temp_c(run: Run, gyro: str, start_s: int, end_s: int) -> Array:
    """Return the case temperature at the middle of every second, (end_s - start_s,).

    ConfigurationError for a gyro without a sensor on its case.
    """
    case_c = run.case_temp_c(gyro, np.arange(start_s + 0.5, end_s))
    if case_c is None:
        imported = run.manifest.imported is not None
        raise ConfigurationError(
            "the gyro has no case temperature sensor",
            where=str(run.place),
            found=f"{gyro}: no column t_out" if imported else f"{gyro}: no case_sensor in the bench file",
            expected="a record of the temperature on the unit's case",
            remedy="map a column to t_out and import the log again"
            if imported
            else "set case_sensor for this gyro and auxiliary for the chamber, and run again",
        )
    return case_c
