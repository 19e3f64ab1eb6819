"""The ring laser's physics against closed forms, and through its emulator's bytes."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks._rlg_runs import ramp_profile, rlg_run
from benchmarks._without import without
from drivers.frames import FrameDecoder, load_family
from simulators.emulators.frames import FrameEmulator
from simulators.plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.rlg import (
    RLG_NOISE,
    RlgCoefficients,
    lock_in_random_walk,
    rlg_axis,
    rlg_coefficients,
    rlg_network,
    rlg_unit,
)


def test_two_watts_warm_block_and_case_by_their_conductances() -> None:
    network = rlg_network()
    steady = np.linalg.solve(network.dynamics, -network.drive @ [-10.0, 1.0])
    state = dict(zip(network.names, steady, strict=True))
    assert state["case"] == pytest.approx(-10.0 + 2.0 / 1.2)
    assert state["block"] == pytest.approx(-10.0 + 2.0 / 1.2 + 2.0 / 0.30)
    assert state["case_sensor"] == pytest.approx(state["case"])


def test_random_walk_of_lock_in() -> None:
    # 4e-3 deg/s, 1.57 arcsec a count, 100 deg/s: 0.004 sqrt(4.361e-4 / 628.3) = 3.332e-6 deg/sqrt(s).
    assert lock_in_random_walk(4e-3) == pytest.approx(60 * 3.332e-6, rel=1e-3)
    assert lock_in_random_walk(8e-3) == pytest.approx(2 * lock_in_random_walk(4e-3))
    assert lock_in_random_walk(4e-3, peak_dither_dps=400.0) == pytest.approx(lock_in_random_walk(4e-3) / 2)
    assert RLG_NOISE.arw_deg_per_sqrt_h == pytest.approx(2e-4, rel=1e-3)


def test_bias_is_the_documented_sum() -> None:
    c = RlgCoefficients()
    t1, t2, d1 = -13.0, -9.5, 0.4
    state = SimpleNamespace(case_c=t1, block_c=t2, case_rate=d1)
    total = sum(effect(state) for effect in rlg_axis(c).bias_dph.values())
    by_hand = (
        0.004 - 2.2e-4 * (t1 - 25) + 4e-7 * (t1 - 25) ** 2 + 0.024 * d1 - 1.6e-4 * t1 * d1 + 0.012 * d1**2
    )
    by_hand += 1e-3 * (t1 - t2) + 6e-4 * np.sin(2 * np.pi * t2 / 9.0) + 4e-4 * np.tanh(d1 / 0.1)
    assert total == pytest.approx(by_hand, rel=1e-12)


def test_on_a_steady_ramp_the_block_lags_by_its_heat() -> None:
    run = rlg_run(
        ramp_profile(dwell_min=30.0), run_seed=3, change=without("bias_instability", "angle_random_walk")
    )
    late = slice(1800 + 12_000, 1800 + 18_000)
    assert 60 * np.gradient(
        np.convolve(run.case_c, np.ones(600) / 600, "same")[late]
    ).mean() == pytest.approx(1 / 3, rel=0.01)
    # Block: 2 W and 350 J/K at 1/3 K/min through 0.30 W/K.
    gap = (2.0 - 350.0 / 180.0) / 0.30
    assert (run.block_c - run.case_c)[late].mean() == pytest.approx(gap, abs=0.15)


def test_units_and_runs_differ_as_documented_and_come_again() -> None:
    assert rlg_coefficients(5, 7) == rlg_coefficients(5, 7)
    nominal = RlgCoefficients()
    units = [rlg_coefficients(unit, 1) for unit in range(1, 300)]
    for item in fields(nominal):
        ratios = np.array([getattr(unit, item.name) for unit in units]) / getattr(nominal, item.name)
        assert ratios.mean() == pytest.approx(1.0, abs=0.04)
        assert 0.11 < ratios.std() < 0.18
    days = np.array([rlg_coefficients(0, day).per_rate for day in range(300)]) / nominal.per_rate
    assert days.std() == pytest.approx(0.03, abs=0.006)
    assert len({rlg_coefficients(0, day).offset for day in range(9)}) == 1


def test_without_effects_nothing_is_left_but_the_earth_free_output() -> None:
    model = rlg_unit(0)
    everything = [name for axis in model.axis_models for name in (*axis.bias_dph, *axis.sf_error_ppm)]
    run = rlg_run(
        ramp_profile(dwell_min=2.0, low_c=20.0, high_c=22.0),
        change=without(*everything, "turn_on", "angle_random_walk", "bias_instability", "quantisation"),
    )
    assert np.abs(run.true_bias_dph).max() == 0.0
    assert np.abs(run.bias_dph[5:]).max() < 1e-6  # the table points east first


def test_the_emulated_units_bytes_carry_both_sensors() -> None:
    lab = LabPlant(PlantConfig(seed=4, units=(UnitConfig("g", "rlg"),)))
    lab.chamber.demand(0.0, set_point_c=45.0, ramp_up=5.0, ramp_down=5.0, running=True)
    lab.advance(600.0)
    emulator = FrameEmulator(lab.unit("g"), load_family("rlg2t"), axes="x", rate_hz=1.0, baudrate=115200)
    block = emulator.stream(600.0)
    assert block is not None
    columns = FrameDecoder(load_family("rlg2t"), rate_hz=1.0, axes="x").feed(block.data).columns
    truth = lab.true_drift("g")
    count = len(columns["counter"])
    assert count == 599  # the 600th is on its way
    assert np.allclose(columns["temp_c"], truth["sensor_temp_c"][1 : count + 1], atol=0.006)
    assert np.allclose(columns["case_temp_c"], truth["case_temp_c"][:count], atol=0.006)
    assert columns["case_temp_c"][-1] > columns["temp_c"][-1] - 5.0 > 20.0
