"""The plant's wobble against scipy's rotations and closed forms; encoder errors; the unit in the lab."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks._without import without
from benchmarks.whirl_runs import LATITUDE_DEG, QUIET, STILL
from drivers.base.constants import EARTH_RATE_DPH
from drivers.base.errors import ConfigurationError
from simulators.plant import LabPlant, PlantConfig, TableParameters, UnitConfig
from simulators.plant.wobble import (
    PATENT_CLASS,
    Wobble,
    body_to_carried,
    nominal_wobble,
    play,
    turned_rad,
)

AS = math.radians(1.0 / 3600.0)


def lab(wobble: Wobble, **config: object) -> LabPlant:
    unit = UnitConfig("ins", model="ins_triad", change=without(*QUIET), wobble=wobble)
    return LabPlant(PlantConfig(latitude_deg=LATITUDE_DEG, units=(unit,), **{"table": STILL, **config}))  # type: ignore[arg-type]


def test_frames_and_increments_agree_with_scipy() -> None:
    psi = np.linspace(0.0, 7.0, 301)
    tilt = Wobble(PATENT_CLASS).tilt_rad(psi, np.zeros(301))
    carried = body_to_carried(psi, tilt)
    tipped = Rotation.from_rotvec(-np.stack([tilt.real, tilt.imag, 0.0 * psi], axis=1))
    expected = Rotation.from_rotvec(np.stack([0.0 * psi, 0.0 * psi, -psi], axis=1)) * tipped
    assert np.allclose(carried, expected.as_matrix(), atol=1e-14)
    earth = np.radians(15.0 / 3600.0) * np.array([0.6, -0.3, 0.7])
    still = Rotation.from_rotvec(-earth * 0.01 * np.arange(301)[:, None])
    inertial = expected * still
    turned = (inertial[:-1] * inertial[1:].inv()).as_rotvec().T
    assert np.abs(turned_rad(carried, earth, 0.01) - turned).max() < 1e-14


def test_without_wobble_the_unit_reads_table_and_earth_rate() -> None:
    plant = lab(Wobble())
    plant.table.servo(0.0, True)
    plant.table.demand_rate(0.0, 6.0)
    plant.advance(70.0)
    signal = plant.unit("ins").measure(10.0, 6000, 0.01)
    turned = signal.angle_increment_rad
    up = EARTH_RATE_DPH * math.sin(math.radians(LATITUDE_DEG)) / 3600.0
    assert np.degrees(turned[:, 2].sum()) == pytest.approx(360.0 + 60.0 * up, abs=1e-7)
    assert np.abs(turned[:, :2].sum(axis=0)).max() / AS < 0.05  # a whole turn: Earth rate averages out
    horizontal = EARTH_RATE_DPH * math.cos(math.radians(LATITUDE_DEG)) * 0.01
    assert np.hypot(turned[:, 0], turned[:, 1]).max() / AS == pytest.approx(horizontal, rel=1e-5)


def test_wobble_swings_the_sensed_rate_as_the_kinematics_say() -> None:
    """A tilt that stands still in rotating axes, line +1, gives j w Th: 3 arcsec at 6 deg/s 0.31 deg/h."""
    plain, tipped = lab(Wobble()), lab(Wobble({1.0: 3.0}))
    means = []
    for plant in (plain, tipped):
        plant.table.servo(0.0, True)
        plant.table.demand_rate(0.0, 6.0)
        plant.advance(70.0)
        means.append(plant.unit("ins").measure(10.0, 6000, 0.01).angle_increment_rad.sum(axis=0) / AS / 60.0)
    assert means[1][1] - means[0][1] == pytest.approx(math.radians(6.0) * 3.0, rel=1e-3)
    assert math.radians(6.0) * 3.0 == pytest.approx(0.314, abs=1e-3)
    assert abs(means[1][0] - means[0][0]) < 2e-3


def test_play_follows_the_turning_points() -> None:
    angle = np.radians([0.0, 1.0, 2.0, 1.8, 1.5, 1.0, 1.2, 1.4, 3.0])
    expected = [0.0, 0.0, 0.0, 0.4, 1.0, 1.0, 0.6, 0.2, 0.0]
    assert np.allclose(play(angle, math.radians(0.5), 0.0), expected)
    parts = np.concatenate(
        [play(angle[:5], math.radians(0.5), 0.0), play(angle[4:], math.radians(0.5), expected[4])[1:]]
    )
    assert np.allclose(parts, expected)


def test_samples_do_not_depend_on_how_calls_are_cut() -> None:
    cuts = [(6000,), (1, 2999, 1000, 2000)]
    signals = []
    for cut in cuts:
        plant = lab(Wobble({**PATENT_CLASS}, play_arcsec=5.0))
        plant.table.servo(0.0, True)
        plant.table.demand_rate(5.0, 6.0)
        plant.table.demand_rate(30.0, -6.0)
        plant.advance(60.0)
        at, parts = 0, []
        for count in cut:
            parts.append(plant.unit("ins").measure(at * 0.01, count, 0.01).angle_increment_rad)
            at += count
        signals.append(np.concatenate(parts))
    assert np.array_equal(signals[0], signals[1])


def test_encoder_noise_and_ripple() -> None:
    table = replace(STILL, encoder_noise_arcsec=2.0, encoder_ripple_arcsec=4.0, encoder_ripple_lines=36)
    plant = lab(Wobble(), table=table, seed=3)
    plant.table.servo(0.0, True)
    plant.table.demand_rate(0.0, 6.0)
    times = np.arange(20.0, 2020.0)
    read = np.array([plant.table.angle_deg(t) for t in times])
    true = np.array([plant.table.total_angle_deg(t) for t in times])
    error = ((read - true + 180.0) % 360.0 - 180.0) * 3600.0
    phase = np.exp(36j * np.radians(true))
    assert abs(2.0 * np.mean(error * np.conj(phase))) == pytest.approx(4.0, abs=0.3)
    rest = error - (2.0 * np.mean(error * np.conj(phase)) * phase).real
    assert rest.std() == pytest.approx(2.0, rel=0.1)
    again = lab(Wobble(), table=table, seed=3)
    again.table.servo(0.0, True)
    again.table.demand_rate(0.0, 6.0)
    assert again.table.angle_deg(777.0) == read[757]


def test_units_have_bearings_of_their_own_and_stay_upright() -> None:
    assert nominal_wobble(0) == nominal_wobble(0)
    assert nominal_wobble(1).lines_arcsec != nominal_wobble(2).lines_arcsec
    rms = math.sqrt(sum(abs(value) ** 2 for value in PATENT_CLASS.values()) / 2.0)
    assert rms == pytest.approx(10.4, abs=0.1)
    with pytest.raises(ConfigurationError, match="stays z up"):
        lab(Wobble()).mount("ins", "axis_up")


def test_other_units_turn_in_a_perfect_bearing() -> None:
    plant = LabPlant(PlantConfig(table=TableParameters(), units=(UnitConfig("m", model="mems"),)))
    assert type(plant.unit("m")).__name__ == "GyroUnit"
