"""Loggers drawn at random: what they write is the table and the gyro, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.any_logger import LOGGERS, MOTIONS, answer, drawn, motion, rows

EXACT = replace(
    drawn(np.random.default_rng(1), "exact"),
    row_s=0.1,
    clock="even",
    lost=0.0,
    wraps=False,
    elevation_deg=90.0,
    arw_deg_per_sqrt_h=0.0,
    bias_instability_dph=0.0,
)
EARTH_UP_DPH = 15.041067 * np.sin(np.radians(48.0))


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_motion_has_no_jump_of_angle_or_rate(kind: str) -> None:
    angle_deg, long_s = motion(kind, np.random.default_rng(2))
    rate_dps = np.diff(angle_deg(np.arange(0.0, long_s, 0.01))) / 0.01
    assert np.abs(rate_dps).max() <= 80.1
    assert np.abs(np.diff(rate_dps)).max() <= 300.0 * 0.01 + 1e-6


def test_a_row_has_the_mean_rate_since_the_one_before() -> None:
    angle_deg, long_s = motion("steps", np.random.default_rng(3))
    stamps, rate, angle = rows(EXACT, angle_deg, long_s, np.random.default_rng(4))
    turned_deg = np.cumsum((rate[1:] - EARTH_UP_DPH) * np.diff(stamps)) / 3600.0
    assert turned_deg == pytest.approx(angle[1:] - angle[0], abs=1e-4)


def test_a_level_axis_feels_the_earth_by_its_heading() -> None:
    angle_deg, long_s = motion("heads", np.random.default_rng(3))
    level = replace(EXACT, elevation_deg=0.0)
    _, rate, angle = rows(level, angle_deg, long_s, np.random.default_rng(4))
    still = np.append(False, np.diff(angle) == 0.0)
    north_dph = 15.041067 * np.cos(np.radians(48.0))
    assert rate[still] == pytest.approx(north_dph * np.cos(np.radians(angle[still])), abs=0.03)


def test_stamps_and_angles_are_as_coarse_as_drawn_and_rows_as_many() -> None:
    angle_deg, long_s = motion("sine", np.random.default_rng(3))
    coarse = replace(EXACT, digits=2, cut_off=True, code_deg=0.01, wraps=True, lost=0.05)
    stamps, _, angle = rows(coarse, angle_deg, long_s, np.random.default_rng(5))
    assert np.abs(100.0 * stamps - np.rint(100.0 * stamps)).max() < 1e-6
    assert (
        np.abs(100.0 * angle - np.rint(100.0 * angle)).max() < 1e-6
        and angle.min() >= 0.0
        and angle.max() < 360.0
    )
    assert len(stamps) == pytest.approx(0.95 * long_s / 0.1, rel=0.01)


def test_a_perfect_gyro_behind_an_exact_logger_has_no_gap(tmp_path: Path) -> None:
    for seed in range(3):
        folder = tmp_path / str(seed)
        folder.mkdir()
        assert answer(seed, LOGGERS[0], folder)[0] == "no gap"
