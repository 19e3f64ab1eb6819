"""Clocks of gyro and table that are apart, on a table that swings: what is known of it is no gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap._align import aligned, offset_ms, over_offset
from bench.analysis.gap._data import GapRun, check_runs
from bench.analysis.gap._diagnose import diagnose
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._model_file import Model, parse_model
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus

OFFSET_S = 0.02
NOISE_DPH = 0.03 * 60.0 / np.sqrt(0.25)
"""0.03 deg/sqrt(h) in rows of 0.25 s."""
MAPPING = """
format = 1
unit_id = "G"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
angle = { name = "angle", unit = "deg" }
[[run]]
file = "*.csv"
profile = "swings"
elevation_deg = 90.0
"""
SHEET = """
format = 1
name = "G"
[noise]
arw_deg_per_sqrt_h = 0.03
bias_instability_dph = 0.02
[[effect]]
name = "scale_factor"
parameters = { sf_ppm = 0.0 }
sigma = { sf_ppm = 150.0 }
"""


def swing_deg(t_s: Array) -> Array:
    """60 deg/s at 0.1 Hz, then 20 deg/s at 0.05 Hz, in and out over 30 s each."""

    def part(hz: float, dps: float, start_s: float) -> Array:
        grow = [
            0.5 - 0.5 * np.cos(np.pi * np.clip(each / 30.0, 0.0, 1.0))
            for each in (t_s - start_s, start_s + 500.0 - t_s)
        ]
        return (
            dps / (2.0 * np.pi * hz) * (1.0 - np.cos(2.0 * np.pi * hz * (t_s - start_s))) * grow[0] * grow[1]
        )

    return np.asarray(part(0.1, 60.0, 60.0) + part(0.05, 20.0, 620.0))


@pytest.fixture
def logs(tmp_path: Path) -> list[GapRun]:
    return logs_of(tmp_path, OFFSET_S)


def logs_of(tmp_path: Path, offset_s: float, sf_ppm: float = 0.0) -> list[GapRun]:
    """Three logs at 4 Hz; the table's stamps are late, the gyro is perfect. Two swings begin alike."""
    t_s = 0.25 * np.arange(4801)
    for number, start_s in enumerate((0.0, 0.0, 3.7)):
        noise = NOISE_DPH * np.random.default_rng(number).normal(size=4800)
        turned = (1.0 + 1e-6 * sf_ppm) * swing_deg(t_s - start_s)
        rate = 3600.0 * np.diff(turned) / 0.25 + 15.041 * np.sin(np.radians(48.0)) + noise
        rows = np.column_stack((t_s[1:], rate, swing_deg(t_s[1:] - offset_s - start_s)))
        np.savetxt(tmp_path / f"s{number}.csv", rows, "%.5f", ",", header="t,rate,angle", comments="")
    (tmp_path / "map.toml").write_text(MAPPING)
    return read_mapped_runs(tmp_path / "map.toml")


def model(offset: Sequence[float] | None) -> Model:
    if offset is None:
        return parse_model(SHEET, "sheet")
    told = f"parameters = {{ offset_ms = {offset[0]} }}\nsigma = {{ offset_ms = {offset[1]} }}"
    return parse_model(f"{SHEET}\n[[effect]]\nname = 'time_offset'\n{told}\n", "sheet")


@pytest.mark.parametrize("told", [(0.0, 50.0), (20.0, 1.0)])
def test_an_offset_that_the_model_has_is_no_gap(logs: list[GapRun], told: tuple[float, float]) -> None:
    found = diagnose(logs[:2], model(told), logs[2:]).rate
    assert found.verdict == "no gap" and not found.causes
    (fitted,) = (term.values[0] for term in found.model.terms if term.name == "time_offset")
    assert fitted == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize("sf_ppm", [-110.0, 110.0])
def test_a_scale_factor_is_not_taken_for_the_second_order(tmp_path: Path, sf_ppm: float) -> None:
    """Of a swing the second order is a part of the rate: 16 ms at 0.1 Hz are 51 ppm, at 0.05 Hz 13."""
    logs = logs_of(tmp_path, -0.016, sf_ppm)
    assert offset_ms(logs, model((0.0, 50.0))) == pytest.approx(-16.0, abs=0.1)
    assert all(run.stimulus.over_offset_dph is not None for run in over_offset(logs, -16.0))
    assert diagnose(logs[:2], model((0.0, 50.0)), logs[2:]).rate.verdict == "no gap"


def test_one_that_it_lacks_is_the_cause(logs: list[GapRun]) -> None:
    found = diagnose(logs[:2], model(None), logs[2:]).rate
    assert [cause.name for cause in found.causes] == ["time_offset"] and not found.stochastic
    assert found.causes[0].terms[0].values[0] == pytest.approx(20.0, abs=0.5)


def test_the_offset_is_that_of_the_logs_and_of_what_is_said(logs: list[GapRun]) -> None:
    # noise of 3.6 deg/h a row against 60 deg/s at 0.1 Hz: 0.04 ms from 1,000 s
    assert offset_ms(logs, model((0.0, 50.0))) == pytest.approx(20.0, abs=0.1)
    assert offset_ms(logs, model((20.0, 1e-6))) == pytest.approx(20.0, abs=1e-4)
    assert offset_ms(logs, model(None)) == pytest.approx(20.0, abs=0.1)
    # what the model says is one more reading: as sure as the logs, it draws the offset to the middle
    assert 12.0 < offset_ms(logs, model((10.0, 5e-3))) < 18.0


@pytest.mark.parametrize(("offset_s", "found_ms"), [(2e-3, 0.0), (5e-3, 5.0)])
def test_what_is_of_first_order_is_left_to_the_effects_column(
    tmp_path: Path, offset_s: float, found_ms: float
) -> None:
    """Of 2 ms the second order is 0.17 deg/h: not three times the noise in 1,500 samples; of 5 ms 1.1 deg/h."""
    logs = logs_of(tmp_path, offset_s)
    assert offset_ms(logs, model((0.0, 50.0))) == pytest.approx(found_ms, abs=0.1)
    # by chance one run is fitted a tenth of a variance worse over it: that is no reason
    over = [run.stimulus.over_offset_dph is not None for run in over_offset(logs, found_ms)]
    assert over == [bool(found_ms)] * 3


def test_a_clock_two_seconds_and_a_part_apart_is_both(logs: list[GapRun]) -> None:
    late = [replace(run, output_dph=np.roll(run.output_dph, 2)) for run in logs]
    assert offset_ms(aligned(late)[0], model((0.0, 50.0))) == pytest.approx(20.0, abs=0.2)


def test_what_each_ms_does_is_over_the_offset(logs: list[GapRun]) -> None:
    """The rate of the table where it was 20 ms later, by a closed form: means of samples of 1 s, deg/h."""
    (run,) = over_offset(logs[:1], 1000.0 * OFFSET_S)
    s, edges_s = run.stimulus, np.arange(len(run.stimulus) + 1.0) + 0.25
    exact = 3600.0 * (np.diff(swing_deg(edges_s)) - np.diff(swing_deg(edges_s - OFFSET_S)))
    (column,) = Variant(effect("time_offset"), {"side": 0.0}).columns(s)
    inside = slice(2, -2)
    assert 20.0 * column[inside] == pytest.approx(exact[inside], abs=0.6)
    at_once = Variant(effect("time_offset"), {"side": 0.0}).columns(logs[0].stimulus)[0]
    assert np.abs(20.0 * at_once - exact).max() > 10.0
    assert over_offset(logs, 0.0) == logs


def test_repeats_that_begin_at_the_same_row_are_no_copies(logs: list[GapRun]) -> None:
    check_runs(logs)
    copy = replace(logs[0], run_id="again", output_dph=logs[0].output_dph + 0.1)
    with pytest.raises(ConfigurationError, match="hold the same samples"):
        check_runs([logs[0], copy])


def _steps(name: str, late: int, masked: int, seed: int, period_s: float = 1.0) -> GapRun:
    """A run of steps of rate whose gyro is some samples late, what is beside a step missing."""
    rate = np.where(np.arange(600) % 100 < 50, 4.0, -4.0)
    s = replace(stimulus(600, cold=False), angle_deg=np.concatenate(([0.0], np.cumsum(period_s * rate))))
    s = replace(s, period_s=period_s, time_s=period_s * s.time_s)
    run = made_run(name, s, np.random.default_rng(seed))
    near = np.abs(np.arange(600)[:, None] - np.flatnonzero(np.diff(rate))).min(axis=1)
    return replace(run, output_dph=np.where(near <= masked, np.nan, np.roll(run.output_dph, late)))


def test_a_run_that_shows_no_offset_has_that_of_all_others() -> None:
    open_runs = [_steps("a", 2, -1, 1), _steps("b", 1, -1, 2, period_s=2.0)]
    hidden, slow = _steps("c", 2, 7, 3), _steps("d", 1, 7, 3, period_s=2.0)
    (*_, found, slowly), notes = aligned([*open_runs, hidden, slow])
    assert slowly.stimulus.angle_deg[1:].tolist() == slow.stimulus.angle_deg[:-1].tolist()
    assert found.stimulus.angle_deg[2:].tolist() == hidden.stimulus.angle_deg[:-2].tolist()
    assert len(notes) == 4 and "as in the other runs" in notes[2]
    # others that disagree, or that show that there is none, say nothing of it
    for other in (_steps("b", 3, -1, 2), _steps("b", 0, -1, 2)):
        assert aligned([open_runs[0], other, hidden])[0][2] is hidden


def test_steps_whose_corners_are_missing_show_no_offset() -> None:
    """Rows beside them show what a servo does after a corner: at once, tens of ms would be noise there."""

    def settling(seed: int) -> GapRun:
        s, rng = stimulus(600, cold=False), np.random.default_rng(seed)
        rate = np.where(np.arange(600) % 100 < 50, 20.0, -20.0)
        rate[50::50] *= 0.68
        rate += 1e-4 * np.sin(np.arange(600.0))
        s = replace(s, angle_deg=np.concatenate(([0.0], np.cumsum(rate))))
        run = made_run("a", s, rng)
        beside = np.isin(np.arange(600) % 50, (49, 0, 1))
        return replace(run, output_dph=np.where(beside, np.nan, run.output_dph))

    assert not any(offset_ms([settling(seed)], model(None)) for seed in range(20))
    still = replace(settling(0), stimulus=stimulus(600, cold=False))
    assert offset_ms([still], model(None)) == 0.0


def test_what_held_out_runs_cannot_show_they_neither_confirm_nor_refute(logs: list[GapRun]) -> None:
    """A held-out run of a table that stands shows nothing of a clock."""
    s = replace(logs[0].stimulus, angle_deg=np.zeros(len(logs[0].stimulus) + 1), edge_rate_dps=None)
    noise = np.random.default_rng(9).normal(0.0, 1.8, len(s))
    still = replace(
        logs[0],
        run_id="still",
        checksum="still",
        stimulus=s,
        output_dph=s.input_rate_dph + noise,
        table_rows=None,
    )
    found = diagnose(logs[:2], model(None), [still]).rate
    assert "time_offset" in [cause.name for cause in found.causes] and not found.held_out[0].cells
    assert found.none_held_out.endswith(": they neither confirm nor refute what is named")
    assert replace(found, causes=()).none_held_out == "no gap above the floor on the held-out runs"
