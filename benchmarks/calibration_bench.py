"""System-level calibration through the emulated bench, byte by byte: what each scheme reaches, and how truly.

Run as `python -m benchmarks.calibration_bench [dwell_s]`: every scheme is turned on the two-axis table of
examples/two_axis.toml by the procedure itself and fitted from the run folder; the same IMU each time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.analysis.calibration import (
    PARAMETER_NAMES,
    PARAMETERS,
    UNIT_SIZE,
    Estimate,
    Evaluation,
    Task,
    evaluate,
    load_calibration_run,
)
from bench.analysis.calibration._estimator import Options, estimate
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from benchmarks._measure import Row, figure

BENCH = Path(__file__).parents[1] / "examples" / "two_axis.toml"
SCHEMES = ("19-position-z-up", "19-position", "23-position", "optimised")
_SHOWN = ("nabla_x", "Kg_zz", "Kg_xy", "Ka_yx", "K2_x")


def calibrated(scheme: str, dwell_s: float, seed: int = 1) -> tuple[Estimate, Evaluation, np.ndarray]:
    """Turn a scheme on the emulated bench and fit it; also what was predicted, and the unit's truth (24,), SI."""
    file, plant = load_bench_file(BENCH), Plant(seed=seed)
    procedure = find_procedure("system-calibration")
    parameters = procedure.parse({"scheme": scheme, "dwell_s": dwell_s, "warm_up_min": 0})
    with tempfile.TemporaryDirectory() as folder, EmulatedLab(file, plant) as lab:
        request = RunRequest(
            procedure,
            parameters,
            lab.file,
            Path(folder),
            EmulatedOperator(lab.perform),
            emulated=lab.emulated,
            before_close=lab.save_truth,
        )
        result = run_procedure(request)
        if result.outcome != "completed":
            raise SystemExit(f"{scheme}: {result.outcome}, {result.reason}")
        run = load_calibration_run(result.folder)
    assert run.truth is not None
    options = Options(alignment_s=min(60.0, 0.8 * dwell_s))
    found = estimate(run.increments, Task(), options, run.schedule)
    return found, evaluate(Task(), run.schedule, run.table), run.truth


def rows(dwell_s: float = 180.0) -> list[Row]:
    """Worst sigma over target through the bench, against what the scheme's evaluation promised."""
    task, rows = Task(), []
    for scheme in SCHEMES:
        found, promised, truth = calibrated(scheme, dwell_s)
        worst = float((found.sigma / task.target_sigma).max())
        error = found.parameters - truth
        nees = error @ np.linalg.solve(found.covariance, error) / 24.0
        sizes = found.sigma / UNIT_SIZE[PARAMETERS]
        shown = ", ".join(f"{name} {sizes[PARAMETER_NAMES.index(name)]:.2f}" for name in _SHOWN)
        title = f"{scheme}, {dwell_s:g} s dwell, through the bench: {shown}; NEES/24 {nees:.2f}"
        name = "prediction of `scheme evaluate`"
        rows.append(figure(title, worst, promised.merit.worst, name, "worst sigma/target", least=True))
    return rows


def main() -> None:
    """Print the table."""
    for row in rows(float(sys.argv[1]) if len(sys.argv) > 1 else 180.0):
        print(f"{row['benchmark']:<130}{row['ours']:>8.3f}{row['yardstick']:>8.3f}{row['ratio']:>8.3f}")


if __name__ == "__main__":
    main()
