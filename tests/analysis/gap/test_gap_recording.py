"""A real chamber cycle of a MEMS gyro whose axes are known: y follows temperature, z hardly comes again."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Diagnosis, Model, Noise, Shrinkage, closed_model, diagnose
from bench.analysis.gap._close import shrinkage
from bench.analysis.gap._data import GapRun
from simulators.effects import Stimulus

RECORDING = (
    Path(__file__).parents[4] / "shared" / "data" / "mems_chamber_cycle" / "imu_raw_data_first_legs.csv"
)
pytestmark = pytest.mark.skipif(not RECORDING.exists(), reason=f"no recording at {RECORDING}")
DATA_SHEET = Model("MEMS", (), Noise(arw_deg_per_sqrt_h=1.0, bias_instability_dph=10.0))


def legs(column: int) -> list[GapRun]:
    """Cooling and the two halves of the heating, a row taken for a second; the first two rows are outliers."""
    rows = np.loadtxt(RECORDING, delimiter="\t", skiprows=3)
    turn = int(rows[:, 8].argmin())
    ends = (0, turn, (turn + len(rows)) // 2, len(rows))
    runs = []
    for number, (first, last) in enumerate(pairwise(ends)):
        part, n = rows[first:last], last - first
        time_s, temp_c = np.arange(1.0, n + 1.0), part[:, 8]
        s = Stimulus(time_s, temp_c, temp_c, np.full(n + 1, 90.0), np.zeros(n), 40.0)
        output = np.degrees(part[:, column]) * 3600.0
        phase = np.full(n, "run")
        runs.append(
            GapRun(
                f"leg {number}",
                "MEMS",
                f"leg {number}",
                "east",
                s,
                output,
                phase,
                checksum=f"sum of {number}",
            )
        )
    return runs


def judged(column: int) -> tuple[Diagnosis, Shrinkage]:
    cooling, heating, last = legs(column)
    found = diagnose([cooling, heating], DATA_SHEET)
    return found, shrinkage(found.model, closed_model(found), [last], found.rate.floor)


def test_a_bias_that_follows_temperature_is_named_and_holds_on_a_leg_that_was_not_fitted() -> None:
    found, shrunk = judged(2)
    assert found.verdict == "explained"
    assert {cause.name for cause in found.causes} <= {"bias_linear", "bias_quadratic", "bias_cubic"}
    assert shrunk.share > 0.9  # though the leg is warmer than what was fitted
    assert not shrunk.caution


def test_what_does_not_come_again_is_said_not_to_hold() -> None:
    _, shrunk = judged(3)
    assert "held-out runs" in shrunk.caution
