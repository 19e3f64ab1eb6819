"""The lab as a whole: Earth rate in closed form, bits that do not depend on chunking, truth, units, refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks._thermal_runs import cold_shock
from benchmarks._without import effect_names, without
from drivers.base.constants import EARTH_RATE_DPH, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError
from simulators.interfaces import GyroPlant
from simulators.plant import LabPlant, PlantConfig, TableParameters, UnitConfig
from simulators.plant.fog import fog_unit
from simulators.plant.fog_parameters import FOG_MID
from simulators.plant.mounting import Mount, Mounting

QUIET = tuple(effect_names(fog_unit(FOG_MID, 0)))
STILL = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)


def quiet_lab(**unit: object) -> LabPlant:
    """A lab whose one gyro has no effect and no noise: it reads its input."""
    config = UnitConfig("g", change=without(*QUIET), **unit)  # type: ignore[arg-type]
    return LabPlant(PlantConfig(units=(config,), table=STILL))


def mean_dph(lab: LabPlant, start_s: float, seconds: int) -> float:
    lab.advance(start_s + seconds)
    signal = lab.unit("g").measure(start_s, 100 * seconds, 0.01)
    return math.degrees(float(signal.angle_increment_rad[:, 0].sum())) * 3600.0 / seconds


@pytest.mark.parametrize("angle", [0.0, 37.0, 90.0, 180.0, 270.0, 315.0])
@pytest.mark.parametrize("error", [0.0, 0.1])
def test_horizontal_axis_reads_the_projection_of_earth_rate(angle: float, error: float) -> None:
    lab = quiet_lab(mount_azimuth_error_deg=error, tilt_deg=0.1)
    lab.table.servo(0.0, True)
    lab.table.demand_angle(0.0, angle)
    north = earth_rate_north_dph(39.10) * math.cos(math.radians(angle + error))
    raised = math.radians(0.1)
    expected = math.cos(raised) * north + math.sin(raised) * earth_rate_up_dph(39.10)
    assert mean_dph(lab, 60.0, 10) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("rate", [20.0, -20.0, 0.0, 300.0])
def test_upward_axis_reads_table_rate_plus_vertical_earth_rate(rate: float) -> None:
    lab = quiet_lab(mounting="axis_up")
    lab.table.servo(0.0, True)
    lab.table.demand_rate(0.0, rate)
    expected = rate * 3600.0 + earth_rate_up_dph(39.10)
    assert mean_dph(lab, 60.0, 10) == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(
    ("roll_deg", "next_up", "last_up"), [(0, 0, 1), (90, 1, 0), (180, 0, -1), (270, -1, 0)]
)
def test_a_unit_turned_about_its_axis_takes_its_lean_with_it_and_not_the_fixtures_tilt(
    roll_deg: float, next_up: float, last_up: float
) -> None:
    """What a level axis feels of a rotation about the vertical is the sine of its elevation (IEEE Std 952)."""
    fixture, to_next, to_last = 0.1, 0.04, -0.07
    lab = quiet_lab(tilt_deg=fixture, lean_deg=(to_next, to_last))
    lab.mount("g", "axis_horizontal", roll_deg)
    lab.table.servo(0.0, True)
    means = []
    for start, rate in ((30.0, 18.0), (130.0, -18.0)):
        lab.table.demand_rate(start - 30.0, rate)
        means.append(mean_dph(lab, start, 20) / 3600.0)  # a whole turn
    elevation = math.degrees(math.asin((means[0] - means[1]) / 36.0))
    assert elevation == pytest.approx(fixture + to_next * next_up + to_last * last_up, abs=2e-6)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("mounting", ["axis_horizontal", "axis_up"])
def test_a_turn_in_the_fixture_is_a_right_handed_one(axis: str, mounting: Mounting) -> None:
    """Rodrigues about the axis under test: whatever is turned stays right-handed, and the axis stays."""
    before, after = (Mount(mounting, 0.0, 3.0, axis, roll).axes_in_table() for roll in (0.0, 50.0))
    k = before["xyz".index(axis)]
    skew = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    angle = math.radians(50.0)
    turn = np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew
    np.testing.assert_allclose(after, before @ turn.T, atol=1e-12)
    assert np.linalg.det(after) == pytest.approx(1.0)


def test_a_unit_with_z_up_is_not_turned_about_an_axis_that_nobody_told() -> None:
    with pytest.raises(ConfigurationError, match="z up") as refused:
        quiet_lab().mount("g", "z_up", 90.0)
    assert refused.value.found == "roll_deg = 90"


def test_turning_horizontal_axis_integrates_earth_rate_exactly() -> None:
    lab = quiet_lab()
    lab.table.servo(0.0, True)
    lab.table.demand_rate(0.0, 20.0)
    lab.advance(40.0)
    increments = lab.unit("g").measure(20.0, 20, 1.0).angle_increment_rad[:, 0]
    angle = np.radians([lab.table.total_angle_deg(t) for t in range(20, 41)])
    omega = math.radians(earth_rate_north_dph(39.10)) / 3600.0
    expected = omega * np.diff(np.sin(angle)) / math.radians(20.0)
    np.testing.assert_allclose(increments, expected, rtol=1e-9, atol=1e-15)


def test_stage_hand_turns_the_unit() -> None:
    lab = quiet_lab()
    lab.advance(100.5)
    lab.mount("g", "axis_up")
    lab.advance(102.0)
    rate = np.degrees(lab.unit("g").measure(100.0, 200, 0.01).angle_increment_rad[:, 0]) * 360_000.0
    np.testing.assert_allclose(rate[:50], earth_rate_north_dph(39.10), atol=1e-8)
    np.testing.assert_allclose(rate[50:], earth_rate_up_dph(39.10), atol=1e-8)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("mounting", ["axis_horizontal", "axis_up", "z_up"])
def test_three_axis_unit_sees_one_rotation_vector(mounting: Mounting, axis: str) -> None:
    effects = ("bias_offset", "bias_temperature", "sf_offset", "sf_temperature")
    noise = ("angle_random_walk", "bias_instability", "turn_on")
    bare = UnitConfig(
        "m", "mems", axis=axis, mounting=mounting, tilt_deg=3.0, change=without(*effects, *noise)
    )
    lab = LabPlant(PlantConfig(units=(bare,), table=STILL))
    lab.advance(20.0)
    vector = np.degrees(lab.unit("m").measure(10.0, 1, 1.0).angle_increment_rad[0]) * 3600.0
    assert np.linalg.norm(vector) == pytest.approx(EARTH_RATE_DPH, rel=1e-9)
    tested = "xyz".index(axis)
    tilt = math.radians(3.0)
    level, up = earth_rate_north_dph(39.10), earth_rate_up_dph(39.10)
    if mounting == "axis_horizontal":  # at table angle 0 it points north, raised by the tilt
        assert vector[tested] == pytest.approx(level * math.cos(tilt) + up * math.sin(tilt), rel=1e-6)
    elif mounting == "axis_up":  # tipped towards north
        assert vector[tested] == pytest.approx(up * math.cos(tilt) + level * math.sin(tilt), rel=1e-6)
    lab.table.servo(20.0, True)
    lab.table.demand_rate(20.0, 90.0)
    lab.advance(31.0)
    spun = lab.unit("m").measure(30.0, 1, 0.01).angle_increment_rad[0]
    upward = {"axis_horizontal": (tested + 2) % 3, "axis_up": tested, "z_up": 2}[mounting]
    assert np.argmax(np.abs(spun)) == upward
    assert spun[upward] > 0.0


def test_the_only_axis_of_a_unit_is_the_one_under_test() -> None:
    lab = quiet_lab(mounting="axis_up", axis="z")
    lab.advance(20.0)
    assert mean_dph(lab, 0.0, 10) == pytest.approx(earth_rate_up_dph(39.10), abs=1e-8)


def demand(lab: LabPlant, now_s: float, kind: str, value: float) -> None:
    if kind == "chamber":
        lab.chamber.demand(now_s, set_point_c=value, ramp_up=5.0, ramp_down=12.0, running=True)
    elif kind == "rate":
        lab.table.demand_rate(now_s, value)
    else:
        lab.table.demand_angle(now_s, value)


def play(
    demands: list[tuple[float, str, float]], cuts: list[int], unit: str, samples: int
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Run demands at their times; measure 100 Hz samples, a chunk as soon as each cut is reached."""
    units = (UnitConfig("fog", mounting="axis_up", tilt_deg=0.2), UnitConfig("mems", "mems"))
    lab = LabPlant(PlantConfig(seed=4, units=units))
    lab.table.servo(0.0, True)
    parts, done = [], 0
    events = sorted([(at, 1, kind, value) for at, kind, value in demands])
    for cut in [*cuts, samples]:
        end = 0.01 * cut
        while events and events[0][0] < end:
            at, _, kind, value = events.pop(0)
            lab.advance(at)
            demand(lab, at, kind, value)
        lab.advance(end)
        if cut > done:
            parts.append(lab.unit(unit).measure(0.01 * done, cut - done, 0.01))
            done = cut
    increments = np.concatenate([part.angle_increment_rad for part in parts])
    return increments, np.concatenate([part.temp_c for part in parts]), dict(lab.true_drift(unit))


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 19.9), st.sampled_from(["chamber", "rate", "angle"]), st.floats(-60.0, 60.0)
        ),
        max_size=5,
        unique_by=lambda item: item[0],
    ),
    st.lists(st.integers(1, 2000), max_size=12).map(sorted),
    st.sampled_from(["fog", "mems"]),
)
def test_bits_do_not_depend_on_how_calls_are_cut(
    demands: list[tuple[float, str, float]], cuts: list[int], unit: str
) -> None:
    whole = play(demands, [], unit, 2000)
    cut = play(demands, cuts, unit, 2000)
    np.testing.assert_array_equal(cut[0], whole[0])
    np.testing.assert_array_equal(cut[1], whole[1])
    for name, column in whole[2].items():
        np.testing.assert_array_equal(cut[2][name], column)


def test_seeds_change_noise_and_turn_on_but_not_the_unit() -> None:
    first, again, other = (cold_shock(run_seed=seed, soak_min=5.0, return_min=5.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.rate_dps, again.rate_dps)
    assert not np.array_equal(first.rate_dps, other.rate_dps)
    turned_on = first.true_bias_dph - other.true_bias_dph
    assert 0.0 < abs(turned_on.mean()) < 0.06
    assert np.ptp(turned_on) < 0.02  # only the air's noise differs besides
    mean = [cold_shock(run_seed=s, soak_min=1.0, return_min=1.0, equilibrium_min=31.0) for s in range(40)]
    constants = [data.true_bias_dph[0] for data in mean]
    assert np.std(constants) == pytest.approx(0.010, rel=0.4)


def test_output_is_truth_plus_noise_of_the_stated_size() -> None:
    data = cold_shock()
    assert data.phase[0] == "equilibrium"
    assert data.phase[5399] == "reference"
    assert data.phase[5400] == "shock"
    assert data.phase[5750] == "soak"
    assert data.reference_s == (3600.0, 5400.0)
    residual = data.bias_dph - data.true_bias_dph
    blocks = residual.reshape(-1, 100).mean(axis=1)
    # 6 N, and the flicker's 100-s means
    assert 0.9 * 6.0 * 0.004 < blocks.std() < 1.25 * 6.0 * 0.004
    assert abs(residual.mean()) < 0.02


def test_output_and_truth_drift_in_the_same_second() -> None:
    """Two units with the same noise: what their outputs differ by is what their truths do, at every second."""
    runs = [cold_shock(unit_seed=seed, equilibrium_min=31.0, soak_min=5.0, return_min=1.0) for seed in (0, 1)]
    outputs, truths = ([getattr(run, name) for run in runs] for name in ("bias_dph", "true_bias_dph"))
    seen, true = outputs[0] - outputs[1], truths[0] - truths[1]
    shift_dph = 0.5 * np.abs(np.diff(true)).max()  # what half a second would make
    left = seen - true
    assert shift_dph > 1e-4
    assert np.abs(left - np.median(left)).max() < 0.2 * shift_dph


def test_rate_runs_carry_the_scale_factor_error() -> None:
    runs = {
        rate: cold_shock(rate_dps=rate, mounting="axis_up", run_seed=3, soak_min=30.0, return_min=10.0)
        for rate in (20.0, -20.0)
    }
    slope = (runs[20.0].rate_dps - runs[-20.0].rate_dps) / 40.0
    whole = len(slope) // 100 * 100
    measured_ppm = (slope[:whole].reshape(-1, 100).mean(axis=1) - 1.0) * 1e6
    truth = runs[20.0].true_sf_error_ppm[:whole].reshape(-1, 100).mean(axis=1)
    # white noise of two runs at 40 deg/s apart: 6 N sqrt(2) / (40 * 3600) = 0.24 ppm; asymmetry 1.5 ppm
    np.testing.assert_allclose(measured_ppm[1:] - 1.5, truth[1:], atol=1.5)
    mean_dph = 0.5 * (runs[20.0].rate_dps + runs[-20.0].rate_dps)[:whole].mean() * 3600.0
    assert mean_dph == pytest.approx(earth_rate_up_dph(39.10) + runs[20.0].true_bias_dph.mean(), abs=0.2)


def test_double_shock_is_cold_twice() -> None:
    data = cold_shock(equilibrium_min=31.0, soak_min=20.0, return_min=5.0, shocks=2)
    cold = data.air_temp_c < -40.0
    assert np.count_nonzero(np.diff(cold.astype(int)) == 1) == 2
    assert data.reference_s == (60.0, 1860.0)


def test_chamber_demand_counts_from_the_next_tick_and_air_is_linear_between_ticks() -> None:
    lab = LabPlant(PlantConfig())
    lab.advance(10.0)
    lab.chamber.demand(10.4, set_point_c=-40.0, ramp_up=0.0, ramp_down=0.0, running=True)
    assert lab.chamber.air_temp_c(11.0) == 25.0
    assert lab.chamber.set_point_c(12.0) == -40.0
    cold = lab.chamber.air_temp_c(12.0)
    assert cold < 25.0
    halfway = LabPlant(PlantConfig())
    halfway.chamber.demand(10.4, set_point_c=-40.0, ramp_up=0.0, ramp_down=0.0, running=True)
    assert halfway.chamber.air_temp_c(11.5) == pytest.approx(0.5 * (25.0 + cold), abs=1e-12)


def test_auxiliary_sensor_sits_on_the_case() -> None:
    lab = LabPlant(PlantConfig(units=(UnitConfig("g", aux_sensor=2),)))
    lab.chamber.demand(0.0, set_point_c=-40.0, ramp_up=0.0, ramp_down=0.0, running=True)
    case, air = lab.chamber.auxiliary_c(2, 600.0), lab.chamber.auxiliary_c(1, 600.0)
    assert case == lab.true_drift("g")["case_temp_c"][600]
    assert air == lab.chamber.air_temp_c(600.0)
    assert case > air + 5.0


def test_leaving_an_effect_out_takes_away_exactly_that_effect() -> None:
    def bias(names: tuple[str, ...]) -> np.ndarray:
        unit = UnitConfig("g", change=without(*names))
        lab = LabPlant(PlantConfig(units=(unit,)))
        lab.chamber.demand(0.0, set_point_c=-40.0, ramp_up=12.0, ramp_down=12.0, running=True)
        lab.advance(2000.0)
        return lab.true_drift("g")["bias_dph"]

    parts = (
        "bias_offset",
        "coil_static",
        "board_static",
        "shupe",
        "winding_stress",
        "bias_relaxation",
        "turn_on",
    )
    alone = [bias(tuple(name for name in parts if name != kept)) for kept in parts]
    np.testing.assert_allclose(sum(alone), bias(()), atol=1e-12)
    assert all(np.abs(part).max() > 0.0 for part in alone)


def test_refusals_name_what_was_wrong() -> None:
    with pytest.raises(ConfigurationError, match="gremlins"):
        LabPlant(PlantConfig(units=(UnitConfig("g", change=without("gremlins")),)))
    with pytest.raises(ConfigurationError, match="no unit"):
        LabPlant(PlantConfig()).unit("g")
    with pytest.raises(ConfigurationError, match="two units"):
        LabPlant(PlantConfig(units=(UnitConfig("g"), UnitConfig("g"))))
    lab = LabPlant(PlantConfig(units=(UnitConfig("g"),)))
    lab.advance(5.0)
    with pytest.raises(ConfigurationError, match="not reached"):
        lab.unit("g").measure(0.0, 501, 0.01)
    with pytest.raises(ConfigurationError, match="mounting"):
        lab.mount("g", "sideways")  # type: ignore[arg-type]


def test_the_lab_fits_its_seams() -> None:
    lab = LabPlant(PlantConfig(units=(UnitConfig("g"),)))
    gyro: GyroPlant = lab.unit("g")
    assert lab.chamber.set_point_c(0.0) == 25.0
    assert lab.table.settled(1.0)
    assert gyro.axes == "x"
    empty = gyro.measure(0.0, 0, 0.01)
    assert empty.angle_increment_rad.shape == (0, 1)
