"""All figures of a standard-test run folder, for one gyro."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.analysis.common.allan import AllanDeviation
from bench.analysis.common.allan_noise import NoiseFit
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.common.runs import require_different
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._estimate import spread
from bench.analysis.figures._parts import (
    ELEVATION,
    MISALIGNMENT_ACROSS,
    PARTS,
    Figure,
    noise_figures,
    noise_of,
)
from bench.analysis.figures._record import Measured, Record
from bench.record.benchfile import calibrations_of
from bench.record.events.run import Interval
from bench.record.recording import Run
from bench.record.shown import Shown
from drivers.base.errors import BenchError, ConfigurationError


@dataclass(frozen=True, repr=False)
class StandardFigures(Shown):
    """Figures of one unit. `missing`: what the record does not give, and why."""

    run_id: str
    unit_id: str
    gyro: str
    figures: tuple[Figure, ...]
    missing: tuple[tuple[str, str], ...]
    allan: AllanDeviation | None
    noise: NoiseFit | None

    def shown(self) -> dict[str, object]:
        """Return the unit, the run, and how many figures it gives; `figures` has them."""
        return {
            "unit": self.unit_id,
            "run": self.run_id,
            "figures": len(self.figures),
            "not measured": [what for what, _ in self.missing],
        }

    def value(self, name: str) -> float:
        """Return a figure's value; raises KeyError."""
        return {figure.name: figure.value for figure in self.figures}[name]


def figures_of_unit(
    folders: Sequence[Path], gyro: str | None = None
) -> tuple[list[StandardFigures], Sequence[Figure]]:
    """Return the figures of one unit's `standard-test` runs, and those over several runs, which are power-ons.

    ConfigurationError for a run that is named twice.
    """
    results = [standard_figures(folder, gyro) for folder in folders]
    units = sorted({result.unit_id for result in results})
    if len(units) != 1:
        raise ConfigurationError(
            "one report is of one unit",
            where="standard test",
            found=", ".join(units) or "no run",
            expected="runs of one unit",
            remedy="name a gyro, or report each unit on its own",
        )
    require_different((result.run_id, result.run_id) for result in results)
    return results, figures_over_runs(results) if len(results) > 1 else ()


def standard_figures(folder: Path, gyro: str | None = None) -> StandardFigures:
    """Return every figure that a `standard-test` run folder gives; what is missing is named, not guessed.

    Intervals hold what the bench adds: each figure has its budget.
    """
    run = Run.open(folder)
    name = gyro or next(iter(run.manifest.units), "")
    if not run.of(Interval) or name not in run.manifest.units:
        raise ConfigurationError(
            "no standard test of that gyro in this run",
            where=str(folder),
            found=f"{run.manifest.procedure}, gyros {', '.join(run.manifest.units)}",
            expected=f"a standard-test run with gyro {name}",
        )
    record = Record(run, name, run.azimuth_error_deg)
    figures, missing, allan, noise = figures_of_record(record)
    doubt_deg = run.manifest.measured("azimuth_error_2_sigma")
    bench = BenchErrors(calibrations_of(run.manifest.bench), None if doubt_deg is None else 0.5 * doubt_deg)
    figures = with_budgets(figures, record, bench)
    return StandardFigures(
        run.manifest.run_id, run.manifest.unit(name), name, tuple(figures), tuple(missing), allan, noise
    )


def figures_of_record(
    record: Measured,
) -> tuple[list[Figure], list[tuple[str, str]], AllanDeviation | None, NoiseFit | None]:
    """Return the figures of a record with intervals of their noise, what is missing and why, the Allan deviation
    and its noise.
    """
    figures: list[Figure] = []
    missing: list[tuple[str, str]] = []
    allan = noise = None
    coefficients = None
    try:
        allan, noise = noise_of(record, "noise")
        coefficients = noise.for_errors
        of_noise = noise_figures(allan, noise)
    except BenchError as error:
        of_noise = []
        missing.append(("noise", str(error)))
        with suppress(
            BenchError
        ):  # a bias record too tells the noise that makes the other figures' intervals
            coefficients = noise_of(record, "bias")[1].for_errors
    for what, part in PARTS.items():
        try:
            figures += part(record, coefficients)
        except BenchError as error:
            missing.append((what, str(error)))
    names = {figure.name for figure in figures}
    if ELEVATION in names and MISALIGNMENT_ACROSS not in names:
        missing.append(
            (
                MISALIGNMENT_ACROSS,
                "nobody turned the unit to 90 and 270 deg about its axis, both senses of rotation each",
            )
        )
    return figures + of_noise, missing, allan, noise


def figures_over_runs(runs: Iterable[StandardFigures]) -> tuple[Figure, ...]:
    """Return repeatabilities over runs of one unit, a power-on each (the standards want at least six).

    What the noise within each run adds is taken off.
    """
    runs = list(runs)
    source = f"GJB 2426A, {len(runs)} power-ons"
    found = []
    for name, title, unit in (
        ("bias", "bias repeatability", "deg/h"),
        ("scale factor", "scale-factor repeatability between runs", "ppm"),
    ):
        each = [item for run in runs for item in run.figures if item.name == name]
        if len(each) > 1:
            values = np.array([item.value for item in each])
            factor = 1e6 / abs(float(values.mean())) if unit == "ppm" else 1.0
            covariance = np.diag([item.standard_error**2 for item in each])
            found.append(Figure.of(title, spread(values, covariance).times(factor), unit, source))
    return tuple(found)
