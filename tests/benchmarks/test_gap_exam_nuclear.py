"""The nuclear resonance gyros: bench by balances, noise and counter as documented, effects by closed forms."""

import math

import numpy as np
import pytest

from benchmarks.gap_exam import _nuclear_effects as effects
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._nuclear import NUCLEAR, SHEET, rows
from benchmarks.gap_exam._nuclear_bench import (
    BOARD_W,
    COILS_W,
    LATITUDE_DEG,
    LOOP_DAMPING,
    LOOP_HZ,
    THERMAL_S,
    chamber,
    gyro,
    ladder,
    table_deg,
)
from benchmarks.gap_exam._signals import drawn
from tests.gap_families import null_residual, repeats_apart, share_of_the_column, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(NUCLEAR, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    """The runs of a unit by key."""
    return {stage.key: stage for stage in NUCLEAR.campaign(unit)}


def test_a_seed_makes_one_campaign(unit, stages):
    again = {stage.key: stage for stage in NUCLEAR.campaign(draw_unit(NUCLEAR, 5, {}))}
    for key in ("TU|0", "LC|1"):
        np.testing.assert_array_equal(again[key].t_in_c, stages[key].t_in_c)
        np.testing.assert_array_equal(again[key].edges_s, stages[key].edges_s)


def test_what_is_heated_leaves_by_the_air():
    """In a soak all power goes through base, frame and board into the air; the oven stands at its demand."""
    nodes = gyro(np.full(round(12.0 * 3600.0 / THERMAL_S), 20.0), None, 1.0)
    last = {name: float(values[-1]) for name, values in nodes.items()}
    out = 5.0 * (last["base"] - 20.0) + 0.8 * (last["frame"] - 20.0) + 0.05 * (last["board"] - 20.0)
    laser_w = 0.9 * (62.0 - last["laser"])
    assert out == pytest.approx(BOARD_W + COILS_W + last["oven_w"] + laser_w, rel=1e-4)
    assert 0.97 * last["oven"] + 0.03 * last["former"] == pytest.approx(110.0, abs=1e-3)


def test_the_chamber_holds_what_it_is_told_and_ripples_in_the_cold():
    air = chamber(np.full(9000, -10.0), drawn(3, "air"))
    assert air[-3000:].mean() == pytest.approx(-10.0, abs=0.15)
    assert np.ptp(air[-3000:]) > 0.05


def test_the_table_lags_a_steady_rate_by_twice_its_damping():
    """A loop without zeros follows a ramp of angle late by 2 zeta / omega."""
    step_s = 0.1
    angle = table_deg([(10.0, 6.0)], np.arange(3001) * step_s, 0.0, step_s)
    # the demand turns from 10 s on, at 6 deg/s after 6/30 s
    late_s = (6.0 * (300.0 - 10.0) - 0.5 * 6.0**2 / 30.0 - angle[-1]) / 6.0
    assert late_s == pytest.approx(2.0 * LOOP_DAMPING / (2.0 * math.pi * LOOP_HZ), abs=2e-3)


def test_output_is_whole_tags_and_its_noise_that_of_the_sheet(unit):
    stage = still(60_000, 0.5)
    output = rows(unit, stage, np.full(60_000, 9.0), drawn(8, "log"))
    tags = output * 0.5 / SHEET.quantum_arcsec
    np.testing.assert_allclose(tags, np.round(tags), atol=1e-6)
    expected = SHEET.arw_deg_per_sqrt_h**2 * 3600.0 / 0.5 + SHEET.quantum_arcsec**2 / 6.0 / 0.5**2
    assert np.var(output) == pytest.approx(expected, rel=0.05)


def test_a_null_is_noise_of_the_sheet(tmp_path):
    left = null_residual(NUCLEAR, tmp_path, 7, seen_share=0.9)
    # turn-on, flicker and walk are the slowest few of it
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.1)


def test_every_effect_shows_and_is_proportional_to_its_size(unit, stages):
    few = [stages[key] for key in ("TU|0", "TW|0", "LC|0", "LH|0", "CA|0", "PO|0", "HD|0", "PU|0")]
    for name, effect in NUCLEAR.effects.items():
        size = effect.sizes[1] if effect.curved else 0.5
        added = [effect.signal(unit, stage, size) for stage in few]
        assert all(np.isfinite(own).all() for own in added), name
        assert max(np.abs(own).max() for own in added) > 0.0, name
        if not effect.curved:
            twice = effect.signal(unit, few[0], 2.0 * size)
            np.testing.assert_allclose(twice, 2.0 * added[0], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["misalignment", "azimuth", "tilt", "latency"])
def test_true_values_are_those_of_the_catalogues_own_columns(unit, stages, name):
    """A leaning axis also turns with the table, which the catalogue's column has as well."""
    share = share_of_the_column(NUCLEAR, unit, list(stages.values()), name, 0.05)
    assert share == pytest.approx(1.0, abs=0.13 if name == "latency" else 0.06)


@pytest.mark.parametrize("name", ["relocked", "hunting_oven", "remanence"])
def test_what_changes_differs_between_repeats(unit, stages, name):
    apart, whole = repeats_apart(NUCLEAR, unit, list(stages.values()), name)
    assert whole > 0.0 and apart > 0.2


def test_light_shift_has_its_extremes_a_width_from_the_line(unit, stages):
    stage = stages["TU|0"]
    own = effects.EFFECTS["light_shift_zero"].signal(unit, stage, 3.0)
    assert np.abs(own).max() <= 3.0 + 1e-9
    x = (stage.body("laser") - 54.0 - 1.5 * unit.draw["a"]) / 4.0
    at_line = np.abs(x) < 0.01
    assert np.abs(own[at_line]).max(initial=0.0) < 0.07


def test_locking_is_adlers_and_the_squelch_mutes(unit, stages):
    stage = stages["LR|0"]
    rate = effects.true_dph(stage)
    locked = rate + effects.EFFECTS["crosstalk"].signal(unit, stage, 400.0)
    slow, fast = np.abs(rate) < 399.0, np.abs(rate) > 2000.0
    np.testing.assert_allclose(locked[slow], 0.0, atol=1e-9)
    np.testing.assert_allclose(locked[fast] ** 2, rate[fast] ** 2 - 400.0**2, rtol=1e-9)
    muted = rate + effects.EFFECTS["squelch"].signal(unit, stage, 400.0)
    assert np.abs(muted[np.abs(rate) < 200.0]).max() < 1.0
    fast = np.abs(rate) > 1000.0
    np.testing.assert_allclose(muted[fast], rate[fast], rtol=1e-6)


def test_the_ladder_goes_up_one_way_and_down_the_other():
    rates = [rate for _, rate in ladder() if rate]
    assert len(rates) == 18 and sum(rates) == pytest.approx(0.0)
    assert max(rates) == -min(rates) == 60.0
    assert NUCLEAR.latitude_deg == LATITUDE_DEG
