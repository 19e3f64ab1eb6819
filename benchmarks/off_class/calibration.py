"""System-level calibration: does it notice noise that is not what it was told, and are its sigmas then true?

    python -m benchmarks.off_class.calibration [--records N]

NEES/24 is the mean squared error in units of the covariance that was stated: 1 when sigmas are true. Of twenty
records its mean scatters by 0.065. Biases are means over the record.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.calibration import Estimate, Schedule, Task, load_scheme
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._record_noise import record_noise
from benchmarks._measure import Row, figure, usual
from benchmarks.off_class._imu_noise import AS_TOLD, WRONG, Disturbance, record
from drivers.base.arrays import Array


@dataclass(frozen=True)
class Outcome:
    """What records of one kind of noise gave: alarms, NEES/24 with the noise told and found."""

    alarms: int
    records: int
    nees_as_told: float
    nees: float
    innovations: float

    @property
    def alarm_pct(self) -> float:
        """Records with an alarm, %."""
        return 100.0 * self.alarms / self.records


def scheme() -> Schedule:
    """Return the scheme of the exam: 22 turns, a minute at each position, 26 min."""
    return load_scheme("optimised").with_(dwell_s=60.0)


def examine(disturbance: Disturbance, records: int) -> Outcome:
    """Calibrate `records` IMUs drawn from the priors, others for each kind of noise."""
    task, schedule = Task(), scheme()
    alarms, told, nees, innovations = 0, [], [], []
    first_seed = 1000 * [*(AS_TOLD | WRONG).values()].index(disturbance)
    for seed in range(first_seed, first_seed + records):
        data, truth = record(task, schedule, disturbance, seed)
        options = Options(alignment_s=48.0)
        first = estimate(data, task, options, schedule)
        shown = record_noise(data, task, options, first, schedule)
        corrected = replace(options, wander=shown.wander)
        found = estimate(data, replace(task, noise=shown.found), corrected, schedule)
        alarms += bool(shown.alarms)
        told.append(nees_of(first, truth))
        nees.append(nees_of(found, truth))
        innovations.append(found.innovation_rms)
    return Outcome(alarms, records, float(np.mean(told)), float(np.mean(nees)), float(np.mean(innovations)))


def nees_of(found: Estimate, truth: Array) -> float:
    """Return the squared error of the 24 parameters in units of the covariance that was stated, over 24."""
    error = found.parameters - truth
    return float(error @ np.linalg.solve(found.covariance, error)) / 24.0


def rows() -> Iterator[Row]:
    """Return alarms and NEES, kind of noise by kind."""
    records = usual(20, 4)
    for name, disturbance in (AS_TOLD | WRONG).items():
        outcome = examine(disturbance, records)
        if name in AS_TOLD:
            yield figure(
                f"calibration, {name}, alarms", outcome.alarm_pct, 2.0, "goal, at most", "%", least=True
            )
        else:
            yield figure(f"calibration, {name}, alarms", outcome.alarm_pct, 95.0, "goal", "%")
        yield figure(f"calibration, {name}, NEES/24", outcome.nees, 1.0, "goal, .8 to 1.2", "1")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--records", type=int, default=20)
    asked = parser.parse_args(arguments)
    print("| noise | alarms, % | NEES/24 as told | corrected | innovations, rms |\n|---|---|---|---|---|")
    for name, disturbance in (AS_TOLD | WRONG).items():
        o = examine(disturbance, asked.records)
        print(
            f"| {name} | {o.alarm_pct:.0f} | {o.nees_as_told:.2f} | {o.nees:.2f} | {o.innovations:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
