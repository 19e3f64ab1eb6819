"""Logs of a perfect gyro as strange loggers write them: what is left beside the table's rate is nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._rows import steady_beside
from drivers.base.errors import ConfigurationError

_MAPPING = """
format = 1
unit_id = "G7"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/s" }
t_in = { name = "warm", unit = "degC" }
angle = { name = "table", unit = "deg" }
[[run]]
file = "a.csv"
profile = "stairs"
condition = "+20"
elevation_deg = 90.0
"""
Rows = np.ndarray
"""Time, rate, angle, temperature (rows, 4)."""


def _stairs() -> Rows:
    """Rows of 0.2 s: rest, 20 deg/s, -20 deg/s, rest; the rate is the mean over the row."""
    time_s = np.arange(0.0, 600.0, 0.2)
    fine = np.arange(0.0, 600.0, 1e-3)
    ramps = np.interp(fine, [0, 150, 152, 300, 304, 450, 452, 600], [0, 0, 20, 20, -20, -20, 0, 0])
    angle = np.interp(time_s, fine, np.cumsum(ramps) * 1e-3)
    rate = np.diff(angle, prepend=0.0) / 0.2
    warm = 25.0 + 0.01 * time_s
    return np.stack((time_s, rate, angle, warm), axis=1)


def _run(folder: Path, rows: Rows) -> GapRun:
    lines = [",".join("" if np.isnan(value) else f"{value:.9f}" for value in row) for row in rows]
    (folder / "a.csv").write_text("\n".join(["t,rate,table,warm", *lines]) + "\n", encoding="utf-8")
    (folder / "map.toml").write_text(_MAPPING, encoding="utf-8")
    (run,) = read_mapped_runs(folder / "map.toml")
    return run


def _left_dph(run: GapRun) -> np.ndarray:
    return np.asarray(run.output_dph - 3600.0 * run.stimulus.table_rate_dps)


def _late_rows(rows: Rows, rng: np.random.Generator) -> Rows:
    place = np.arange(len(rows), dtype=float)
    place[rng.choice(len(rows) - 3, 12, replace=False)] += 1.5
    return np.asarray(rows[np.argsort(place)])


def _twice(rows: Rows, rng: np.random.Generator) -> Rows:
    return np.asarray(rows[np.sort(np.append(np.arange(len(rows)), rng.integers(0, len(rows), 15)))])


def _clock_set(by_s: float) -> Callable[[Rows, np.random.Generator], Rows]:
    def rows_of(rows: Rows, rng: np.random.Generator) -> Rows:
        result = rows.copy()
        result[int(rng.integers(900, 1400)) :, 0] += by_s
        return result

    return rows_of


def _stamped_when_idle(rows: Rows, rng: np.random.Generator) -> Rows:
    result = rows.copy()
    result[1:, 0] += rng.uniform(-0.01, 0.01, len(rows) - 1)
    return result


def _without_a_beginning(rows: Rows, _: np.random.Generator) -> Rows:
    return np.asarray(rows[212:])


def _angles_missing(rows: Rows, rng: np.random.Generator) -> Rows:
    result = rows.copy()
    result[rng.integers(1, len(rows) - 1, 10), 2] = np.nan
    return result


def _temperature_seldom(rows: Rows, _: np.random.Generator) -> Rows:
    result = rows.copy()
    result[np.arange(len(rows)) % 300 != 0, 3] = np.nan
    return result


def _holes(rows: Rows, rng: np.random.Generator) -> Rows:
    gone = [np.arange(at, at + 7) for at in rng.integers(1, len(rows) - 8, 6)]
    return np.delete(rows, np.concatenate(gone), axis=0)


_LOGS = {
    "rows written late": _late_rows,
    "rows in any order": lambda rows, rng: rng.permutation(rows),
    "the first 4 s written late": lambda rows, rng: np.concatenate((rows[20:80], rows[:20], rows[80:])),
    "rows twice": _twice,
    "the clock set by 8 ms": _clock_set(0.008),
    "the clock set back by 8 ms": _clock_set(-0.008),
    "the clock set by 7.3 s": _clock_set(7.3),
    "an even stream, stamped when there is time": _stamped_when_idle,
    "the first 42 s missing": _without_a_beginning,
    "some angles missing": _angles_missing,
    "temperatures once a minute": _temperature_seldom,
    "holes while it turns": _holes,
}


@pytest.mark.parametrize("kind", _LOGS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_perfect_gyro_in_a_strange_log_leaves_nothing(tmp_path: Path, kind: str, seed: int) -> None:
    """A row of 0.2 s that the clock says was 0.208 s has a rate of 2800 deg/h that the gyro never gave."""
    run = _run(tmp_path, _LOGS[kind](_stairs(), np.random.default_rng(seed)))
    left = _left_dph(run)
    assert np.isnan(left).mean() < 0.15
    assert np.nanmax(np.abs(left)) < 2.0


def test_what_was_set_right_is_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    run = _run(tmp_path, _twice(_late_rows(_stairs(), rng), rng))
    assert [remark.split(" rows ")[1] for remark in run.remarks] == [
        "written late, put in their place",
        "twice, taken once",
    ]
    assert not _run(tmp_path, _stairs()).remarks


def test_true_stamps_of_uneven_rows_are_kept(tmp_path: Path) -> None:
    """A logger that polls: rows are as long as their stamps say."""
    rows, rng = _stairs(), np.random.default_rng(5)
    time_s = rows[:, 0].copy()
    time_s[1:] += rng.uniform(-0.01, 0.01, len(rows) - 1)
    rows[:, 2] = np.interp(time_s, rows[:, 0], rows[:, 2])
    rows[:, 0] = time_s
    rows[1:, 1] = np.diff(rows[:, 2]) / np.diff(time_s)
    assert np.nanmax(np.abs(_left_dph(_run(tmp_path, rows)))) < 2.0


def test_a_rate_is_steady_up_to_a_masked_move() -> None:
    """Rest, a masked move to 20 deg/s within five steps, then steady: the step after the mask keeps its rate."""
    rates = np.array([0.0, 0, 0, 1, 7, 13, 18, 19, 20, 20, 20])
    missing = (np.arange(11) >= 3) & (np.arange(11) < 8)
    angle = steady_beside(5.0 + np.concatenate(([0.0], np.cumsum(rates))), missing)
    assert angle[-1] == pytest.approx(5.0 + rates.sum())
    turned = np.diff(angle)
    assert turned[[2, 3]].tolist() == pytest.approx([0.0, 0.0], abs=1e-9)
    assert turned[[7, 8]].tolist() == pytest.approx([20.0, 20.0])
    swinging = np.concatenate(([0.0], np.cumsum(np.sin(np.arange(11.0)))))
    assert steady_beside(swinging, missing) == pytest.approx(swinging)


@pytest.mark.parametrize("by_s", [-40.07, -40.1, -300.1])
def test_a_counter_of_seconds_that_is_set_back_far_is_refused(tmp_path: Path, by_s: float) -> None:
    """Rows of two times would lie evenly between each other, or before the first one."""
    with pytest.raises(ConfigurationError, match="does not grow"):
        _run(tmp_path, _clock_set(by_s)(_stairs(), np.random.default_rng(6)))
