"""System-level calibration on a pier that rocks, through the emulated bench: are its sigmas then true?

    python -m benchmarks.off_class.rocking [--seeds N]

Tilts turn gravity and Earth rate in the unit, and gyros measure them. 22 turns, a minute at each rest, 26 min.
NEES/24: mean squared error in units of the covariance that was stated, with the noise that the filter is told and
with that read off the record. `size`: geometric mean of the sigmas against those of the pier at rest.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.analysis.calibration import CalibrationRun, Estimate, Task, load_calibration_run
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._record_noise import record_noise
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from benchmarks.off_class.calibration import nees_of
from drivers.base.errors import RecordError
from simulators.config import Ground

BENCH = Path(__file__).parents[2] / "examples" / "two_axis.toml"
GROUNDS: Mapping[str, Ground] = {
    "at rest": Ground(),
    "sun, 10 arcsec a day": Ground(sun_arcsec=10.0),
    "sun, 300 arcsec a day": Ground(sun_arcsec=300.0),
    "people, 1 arcsec a step": Ground(step_arcsec=1.0, steps_per_min=20.0),
    "wind, 3 arcsec at 0.15 Hz": Ground(rock_arcsec=(3.0, 3.0, 0.3), rock_hz=0.15),
    "wind, 30 arcsec at 0.15 Hz": Ground(rock_arcsec=(30.0, 30.0, 3.0), rock_hz=0.15),
    "wind, 300 arcsec at 0.15 Hz": Ground(rock_arcsec=(300.0, 300.0, 30.0), rock_hz=0.15),
}
"""From a good pier to the top floor of a building. A geodetic pier's tilt is of the first sizes."""


def recorded(ground: Ground, seed: int) -> CalibrationRun:
    """Turn the scheme on the emulated bench, an IMU of that seed's on it."""
    file = load_bench_file(BENCH)
    gyro = replace(file.gyro[0], unit=f"IMU-{seed:03d}")
    file, procedure = file.model_copy(update={"gyro": (gyro,)}), find_procedure("system-calibration")
    asked = procedure.parse({"scheme": "optimised", "dwell_s": 60.0, "warm_up_min": 0})
    with (
        tempfile.TemporaryDirectory() as folder,
        EmulatedLab(file, Plant(seed=seed, ground=ground)) as lab,
    ):
        operator = EmulatedOperator(lab.perform)
        request = RunRequest(
            procedure,
            asked,
            lab.file,
            Path(folder),
            operator,
            emulated=lab.emulated,
            before_close=lab.save_truth,
        )
        result = run_procedure(request)
        if result.outcome != "completed":
            raise SystemExit(f"{result.outcome}: {result.reason}")
        return load_calibration_run(result.folder)


def fitted(run: CalibrationRun) -> tuple[Estimate, Estimate, int]:
    """Return the estimate with the noise told, the one with the noise found, and how many alarms there were."""
    options = Options(alignment_s=48.0)
    told = estimate(run.increments, Task(), options, run.schedule)
    shown = record_noise(run.increments, Task(), options, told, run.schedule)
    corrected = replace(options, wander=shown.wander)
    return (
        told,
        estimate(run.increments, replace(Task(), noise=shown.found), corrected, run.schedule),
        len(shown.alarms),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=4)
    seeds = range(1, 1 + parser.parse_args(arguments).seeds)
    print("| ground | NEES/24 as told | own noise | size | runs with an alarm |\n|---|---|---|---|---|")
    still: dict[int, np.ndarray] = {}
    for name, ground in GROUNDS.items():
        rows, refused = [], 0
        for seed in seeds:
            run = recorded(ground, seed)
            assert run.truth is not None
            try:
                told, found, alarms = fitted(run)
            except RecordError:
                refused += 1
                continue
            sigma = np.sqrt(np.diag(found.covariance))
            still.setdefault(seed, sigma)
            size = float(np.exp(np.mean(np.log(sigma / still[seed]))))
            rows.append((nees_of(told, run.truth), nees_of(found, run.truth), size, float(alarms > 0)))
        if refused:
            print(f"| {name} | {refused} of {refused + len(rows)} refused | | | |", flush=True)
            continue
        told_nees, own, size, alarmed = np.mean(rows, axis=0)
        print(
            f"| {name} | {told_nees:.2f} | {own:.2f} | {size:.2f} | {alarmed * len(rows):.0f} of {len(rows)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
