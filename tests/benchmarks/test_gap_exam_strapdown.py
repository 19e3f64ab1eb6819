"""The fibre-optic family against closed forms: heat in the coil, winding, friction, loops, noise, its nulls; what
makes each effect act, its units, parity and memory.
"""

import math

import numpy as np
import pyarrow.parquet
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from bench.record.exchange import read_log, read_mapping
from benchmarks.gap_exam import _strapdown as lab
from benchmarks.gap_exam import _strapdown_bench as plant
from benchmarks.gap_exam import _strapdown_effects as wrong
from benchmarks.gap_exam._files import Logged, read_seal, write_case
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, prepare_folder
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._strapdown import STRAPDOWN
from tests.gap_families import deviations, null_residual, repeats_apart, share_of_the_column, still, stimulus

UNIT = draw_unit(STRAPDOWN, 5, {})
EFFECTS = STRAPDOWN.effects


@pytest.fixture(scope="module")
def stages():
    return STRAPDOWN.campaign(UNIT)


def test_the_coil_cools_at_the_rates_of_a_slab_between_two_films():
    """Carslaw and Jaeger, Conduction of Heat in Solids, 3.10: (z^2 - B1 B2) tan z = z (B1 + B2)."""
    flows, _, _ = plant.conduction()
    decays = np.sort(-np.linalg.eigvals(flows[: plant.LAYERS, : plant.LAYERS]).real)[:3]
    inner = plant._JOINT_W_PER_K / plant._COIL_W_PER_K
    outer = plant._GAP_W_PER_K / plant._COIL_W_PER_K

    def condition(z):
        return (z * z - inner * outer) * math.sin(z) - z * (inner + outer) * math.cos(z)

    grid = np.linspace(0.05, 12.0, 4000)
    crossed = [k for k in range(3999) if condition(grid[k]) * condition(grid[k + 1]) < 0.0]
    roots = [brentq(condition, grid[k], grid[k + 1]) for k in crossed[:3]]
    time_s = plant._COIL_J_PER_K / plant._COIL_W_PER_K
    np.testing.assert_allclose(decays, np.square(roots) / time_s, rtol=0.01)


def test_heat_leaves_in_series():
    """What the electronics give passes the housing's film and its foot, and a little of it the coil."""
    bodies = plant.chambered(np.full(20_000, 40.0), 0.3, cold_start=True)
    air, housing, hub, coil = (bodies[name][-2000:].mean() for name in ("air", "housing", "hub", "coil"))
    assert air == pytest.approx(40.0, abs=0.05)
    out = plant._FILM_W_PER_K * (housing - air) + plant._TABLE_W_PER_K * (housing - plant.ROOM_C)
    assert out == pytest.approx(plant._ELECTRONICS_W, abs=0.02)
    through = 1.0 / (1.0 / plant._JOINT_W_PER_K + 1.0 / plant._COIL_W_PER_K + 1.0 / plant._GAP_W_PER_K)
    both = through + plant._HUB_TO_HOUSING_W_PER_K
    assert hub - housing == pytest.approx(plant._ELECTRONICS_W / both, rel=1e-3)
    # half the ring and the joint lie between its mean and the hub
    ring = through * (1.0 / plant._JOINT_W_PER_K + 0.5 / plant._COIL_W_PER_K)
    assert hub - coil == pytest.approx(ring * (hub - housing), rel=2e-3)


def test_nitrogen_overshoots_and_settles_while_the_valve_pulses():
    wanted = np.concatenate((np.full(600, 25.0), np.full(2400, -25.0)))
    bodies = plant.chambered(wanted, 0.0, cold_start=True)
    assert -30.0 < bodies["air"].min() < -25.5
    assert bodies["air"][-300:].mean() == pytest.approx(-25.0, abs=0.4)
    valve = bodies["valve"]
    assert set(np.unique(valve)) == {0.0, 1.0} and valve[:500].mean() < 0.05
    assert 0.1 < valve[-600:].mean() < 0.9


def test_the_winding_weighs_as_shupes_integral_over_the_fibre():
    """The integral of dT/dt (L - 2 z) dz along a fibre wound from its middle in turn from both ends."""
    halves = {
        +1: [j for j in range(plant.LAYERS) if j % 4 in (0, 3)],
        -1: [j for j in range(plant.LAYERS) if j % 4 in (1, 2)],
    }
    warming = np.random.default_rng(3).normal(size=plant.LAYERS)
    fine, total = 1000, 0.0
    for side, layers in halves.items():
        # distance from the middle, in layers
        away = (np.arange(len(layers) * fine) + 0.5) / fine
        total += side * float(np.sum(np.repeat(warming[layers], fine) * away)) / fine
    assert plant.wound_weights() @ warming * (plant.LAYERS / 2) == pytest.approx(total, rel=1e-9)
    assert plant.wound_weights().sum() == pytest.approx(0.0, abs=1e-12)
    # a gradient of one K a layer: one for every four layers
    assert plant.wound_weights() @ np.arange(plant.LAYERS) == pytest.approx(0.5)


def test_the_table_sticks_until_the_oil_has_yielded_and_slips_as_its_equation_says():
    step_s = 0.1
    speed = 1.0 / 30.0
    demand = speed * np.arange(3001) * step_s
    table = plant.hydraulic(demand, step_s)
    moves = np.diff(table)
    first = int(np.argmax(moves > 0.0))
    assert demand[first] == pytest.approx(plant.STATIC_DEG, abs=1.5 * speed * step_s)
    # one slip, integrated on its own from where the oil gives way
    spring, static, kinetic = plant._SPRING_PER_S2, plant.STATIC_DEG, plant.KINETIC_DEG

    def motion(t, state):
        x, v = state
        friction = spring * (kinetic + (static - kinetic) * math.exp(-max(v, 0.0) / plant._STRIBECK_DPS))
        return v, spring * (static + speed * t - x) + plant._VISCOUS_PER_S * (speed - v) - friction

    def stops(t, state):
        return state[1] if t > 0.02 else 1.0

    stops.terminal = True
    found = solve_ivp(motion, (0.0, 2.0), (0.0, 1e-4), events=stops, rtol=1e-9, atol=1e-12)
    slip = float(found.y[0][-1])
    sliding = moves > 1e-9
    starts = np.flatnonzero(sliding & ~np.concatenate(([False], sliding[:-1])))
    slips = np.diff(table[starts[3:]])
    assert len(slips) > 100 and np.mean(slips) == pytest.approx(slip, rel=0.15)
    assert 0.2 < sliding.mean() < 0.6
    assert np.abs(demand - table).max() < 1.2 * static


def test_a_fast_table_lags_by_its_sliding_friction():
    demand = 20.0 * np.arange(200) * 0.1
    assert demand[-1] - plant.hydraulic(demand, 0.1)[-1] == pytest.approx(plant.KINETIC_DEG, rel=1e-3)
    assert demand[-1] + plant.hydraulic(-demand, 0.1)[-1] == pytest.approx(plant.KINETIC_DEG, rel=1e-3)


def test_glue_tends_to_its_limits_and_does_not_care_how_fast():
    once = np.concatenate((np.linspace(0.0, 80.0, 4001), np.linspace(80.0, 0.0, 4001)[1:]))
    held = wrong.loop(once)
    limit = (1.0 - wrong._LOOP_INNER) / wrong._LOOP_PER_K
    assert once[4000] - held[4000] == pytest.approx(
        limit * (1.0 - math.exp(-80.0 * wrong._LOOP_PER_K)), rel=1e-9
    )
    assert once[-1] - held[-1] == pytest.approx(-limit, rel=0.02)
    assert (held[1] - held[0]) / 0.02 == pytest.approx(wrong._LOOP_INNER, rel=0.01)
    np.testing.assert_allclose(wrong.loop(np.repeat(once, 3))[::3], held, atol=1e-9)


def test_noise_is_white_flicker_walk_and_counts():
    taus = np.array([0.4, 6.4, 102.4, 819.2])
    found = deviations(STRAPDOWN, taus, 60_000, 0.1)
    sheet = lab.SHEET
    white = 0.995**2 * 3600.0 * sheet.arw_deg_per_sqrt_h**2 / taus
    flicker = 2.0 * math.log(2.0) / math.pi * sheet.bias_instability_dph**2
    walk = sheet.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    counts = 3.0 * sheet.quantum_arcsec**2 / 12.0 / taus**2
    np.testing.assert_allclose(found, np.sqrt(white + flicker + walk + counts), rtol=0.12)
    n = 30_000
    coarse = draw_unit(STRAPDOWN, 1, {"coarse_counts": 20.0})
    output = (
        lab.rows(coarse, still(n, 0.1), np.zeros(n), drawn(1, "noise")) * 0.1 / (20.0 * sheet.quantum_arcsec)
    )
    np.testing.assert_allclose(output, np.round(output), atol=1e-6)
    frozen = draw_unit(STRAPDOWN, 1, {"frozen_words": 0.04, "coarse_counts": 0.01})
    output = lab.rows(frozen, still(n, 0.1), np.zeros(n), drawn(1, "noise"))
    assert np.mean(np.diff(output) == 0.0) == pytest.approx(0.04, abs=0.006)


def test_a_null_case_is_the_nominal_model_and_noise(tmp_path):
    left = null_residual(STRAPDOWN, tmp_path, 4242)
    assert left.var() == pytest.approx(1.0, abs=0.08)
    assert abs(stats.kurtosis(left)) < 0.4 and np.abs(left).max() < 5.0


def test_campaign_limits_masks_and_gaps(stages):
    assert len(stages) == 27 and len({stage.key for stage in stages}) == len({s.run_id for s in stages}) == 27
    assert sorted(stage.number for stage in stages) == list(range(27))
    shown = {stage.profile for stage in stages if not stage.held_out}
    assert {stage.profile for stage in stages} - shown == {"day of work"}
    air = np.concatenate([stage.body("air") for stage in stages])
    assert air.min() < -39.0 and air.max() > 62.0
    rates = np.concatenate([stage.axis_dps for stage in stages])
    assert np.abs(rates).max() == pytest.approx(150.0, rel=0.01)
    for stage in stages:
        assert stage.kept.all() and stage.valid.mean() > 0.88
        moving = stage.in_rows(np.abs(stage.rate_dps)) > 0.05
        if stage.code == "PS":
            assert moving.any() and not (moving & stage.valid).any()
    gaps = sum(not stage.valid.all() for stage in stages if stage.code != "PS")
    assert gaps > 12


def test_logs_are_parquet_at_ten_hertz_in_kelvin_and_radian_with_nan_over_moves(stages, tmp_path):
    for code in ("PS", "WE"):
        stage = next(stage for stage in stages if stage.code == code)
        rate = stage.in_rows(sensed_dph(stage, STRAPDOWN.latitude_deg))
        write_case(tmp_path, STRAPDOWN, [Logged(stage, rate, *lab.read(UNIT, stage, drawn(0)))])
        raw = pyarrow.parquet.read_table(tmp_path / f"{code}_1.parquet").to_pandas()
        assert list(raw) == ["time_s", "gyro_z", "piston", "t_in", "t_out", "elevation"]
        np.testing.assert_allclose(np.diff(raw.time_s), 0.1, atol=1e-9)
        np.testing.assert_array_equal(np.isnan(raw.gyro_z[1:]), ~stage.valid)
        np.testing.assert_allclose(raw.gyro_z[1:][stage.valid], rate[stage.valid] / 3600.0, rtol=1e-12)
        np.testing.assert_allclose(np.degrees(raw.piston), stage.angle_deg, atol=2e-6)
        apart = raw.t_in[1:].to_numpy() - 273.15 - stage.t_in_c
        assert abs(apart.mean()) < 0.4 and apart.std() == pytest.approx(0.015, rel=0.1)
        mapping = read_mapping(tmp_path / "runs.toml")
        log = read_log(tmp_path / mapping.run[0].file, mapping)
        np.testing.assert_allclose(3600.0 * log.columns["output"][1:], np.where(stage.valid, rate, np.nan))


def test_the_true_rate_is_what_the_catalogue_expects_of_the_log(stages):
    for stage in stages[::3]:
        if stage.code in ("CY", "PL", "ON", "RE", "WE"):
            mine = stage.in_seconds(sensed_dph(stage, STRAPDOWN.latitude_deg))
            np.testing.assert_allclose(mine, stimulus(STRAPDOWN, stage).input_rate_dph, rtol=1e-6, atol=0.02)


def test_true_values_are_those_of_the_catalogues_own_columns(stages):
    stated = [name for name, effect in EFFECTS.items() if effect.truth and name != "connector"]
    for name in stated:
        share = share_of_the_column(STRAPDOWN, UNIT, stages, name)
        # a swing that turns within a second of the column's is not resolved by it
        rough = 0.12 if name in ("latency", "slow_clock") else 0.08
        assert share == pytest.approx(1.0, abs=rough), name
    assert len(stated) == 6
    c = wrong._connector_c(UNIT)
    stage = still(2, bodies_c={"hub": np.array([c - 5.0, c + 5.0])})
    np.testing.assert_allclose(EFFECTS["connector"].signal(UNIT, stage, 0.7), (0.0, 0.7), atol=1e-9)


def quiet(n, step_s=1.0, **changed):
    bodies = {name: np.full(n, 25.0) for name in plant.BODIES} | {"valve": np.zeros(n)}
    return still(n, step_s, **{"bodies_c": bodies, "power_on_s": 9e6, **changed})


def warmed(values, **changed):
    """A run whose hub has some temperatures, the housing warmer by a tenth, the coil colder by a tenth."""
    bodies = {
        "air": values,
        "housing": 1.1 * values,
        "hub": values,
        "coil": 0.9 * values,
        "wound": 0.01 * values**2,
    }
    return still(
        len(values), 1.0, **{"bodies_c": bodies | {"valve": 0.0 * values}, "power_on_s": 9e6, **changed}
    )


def test_each_effect_needs_its_own_cause():
    """Temperature, turning, place in the field, light just switched on, the valve."""
    n = 7000
    turned = np.concatenate((np.zeros(1000), np.cumsum(30.0 * np.sin(np.arange(n - 999) / 300.0))))
    up = np.full(n, 90.0)
    causes = {
        "warm": warmed(-35.0 + 95.0 * np.linspace(0.0, 1.0, n) ** 2),
        "turn": quiet(n, angle_deg=turned, elevation_deg=up),
        "heading": quiet(n, angle_deg=np.linspace(0.0, 360.0, n + 1)),
        "fresh": quiet(n, power_on_s=0.0),
        "valve": quiet(n),
    }
    causes["valve"].bodies_c["valve"][:] = np.arange(n) // 100 % 2
    expected = {
        "warm": "trimmed_coil quadrupole thermo_optic glassy_potting pigtails late_coil shield_heat glue_loops "
        "connector polarised_light cooler_spent",
        "turn": "finite_gain flyback",
        "heading": "coupled_modulator",
        "fresh": "source_settles",
        "valve": "valve_coil",
    }
    for cause, names in expected.items():
        for name in names.split():
            varies = {
                key: float(np.std(EFFECTS[name].signal(UNIT, stage, 1.0))) for key, stage in causes.items()
            }
            others = [value for key, value in varies.items() if key != cause]
            # Earth rate changes by 11 deg/h as the axis turns level
            assert varies[cause] > 1e-5 and max(others) < 0.05 * varies[cause], (name, varies)
    both = warmed(np.linspace(-35.0, 60.0, n), angle_deg=turned, elevation_deg=up)
    rate = sensed_dph(both, lab.LATITUDE_DEG)
    np.testing.assert_allclose(
        EFFECTS["wavelength"].signal(UNIT, both, 3.0),
        3e-6 * (np.linspace(-35.0, 60.0, n) - 25.0) * rate,
        atol=1e-9,
    )
    assert np.abs(EFFECTS["wider_coil"].signal(UNIT, causes["turn"], 3.0)).max() < 1e-9
    fresh = quiet(n, angle_deg=turned, elevation_deg=up, power_on_s=0.0)
    warming = EFFECTS["warming_source"].signal(UNIT, fresh, 10.0) / sensed_dph(fresh, lab.LATITUDE_DEG)
    assert warming[0] == pytest.approx(1e-5, rel=0.01) and warming[-1] < 1e-8
    for number, share in ((0, -0.5), (26, 0.5)):
        aged = EFFECTS["ageing_source"].signal(
            UNIT, quiet(n, angle_deg=turned, elevation_deg=up, number=number), 10.0
        )
        np.testing.assert_allclose(
            aged, share * 1e-5 * sensed_dph(causes["turn"], lab.LATITUDE_DEG), atol=1e-9
        )


def test_warming_by_a_kelvin_a_minute_is_the_unit():
    n = 3000
    minutes = (np.arange(n) + 0.5) / 60.0
    stage = warmed(10.0 + minutes / 0.9)  # the coil by 1 K a minute
    middle = slice(5, -5)
    np.testing.assert_allclose(EFFECTS["trimmed_coil"].signal(UNIT, stage, 0.7)[middle], 0.7, rtol=1e-6)
    coil = stage.body("coil")[middle]
    cross = EFFECTS["thermo_optic"].signal(UNIT, stage, 0.7)[middle]
    np.testing.assert_allclose(cross, 0.7 * (coil - 25.0) / 50.0, rtol=1e-6)
    cold = warmed((-60.0 + minutes) / 0.9)
    glassy = EFFECTS["glassy_potting"].signal(UNIT, cold, 0.7)
    assert glassy[10] == pytest.approx(0.7, rel=1e-3)
    assert np.abs(EFFECTS["glassy_potting"].signal(UNIT, warmed(25.0 + minutes), 0.7)).max() < 1e-2


def test_parity_in_the_rate():
    n = 4000
    turned = np.cumsum(np.append(0.0, 60.0 * np.sin(np.arange(n) / 300.0)))
    there, back = (
        warmed(np.linspace(0.0, 50.0, n), angle_deg=sign * turned, elevation_deg=np.full(n, 90.0))
        for sign in (1.0, -1.0)
    )
    parities = {"wavelength": -1, "wider_coil": -1, "finite_gain": -1, "ageing_source": -1, "flyback": 1}
    for name, parity in parities.items():
        one, other = (EFFECTS[name].signal(UNIT, stage, 1.0) for stage in (there, back))
        # the Earth adds 10 deg/h to 60 deg/s
        np.testing.assert_allclose(one, parity * other, atol=1e-3 * np.abs(one).max())


def test_memory_in_temperature():
    """Passed twice as slowly the same temperatures give the same, half as much, or what has a memory."""
    legs = ((25, 60, 3000), (60, -40, 8000), (-40, 25, 5000))
    way = np.concatenate([np.linspace(a, b, k, endpoint=False) for a, b, k in legs])
    fast, slow = warmed(way), warmed(np.repeat(way, 2))
    for name in ("pigtails", "connector", "polarised_light", "cooler_spent", "shield_heat", "glue_loops"):
        signal = EFFECTS[name].signal
        one, two = signal(UNIT, fast, 1.0), signal(UNIT, slow, 1.0)[::2]
        np.testing.assert_allclose(one, two, atol=1e-6 * np.ptp(one), err_msg=name)
        opens = np.abs(one[:3000] - np.interp(way[:3000], way[10999:3000:-1], one[10999:3000:-1])).max()
        assert (opens > 0.1 * np.ptp(one)) == (name == "glue_loops"), name
    for name in ("trimmed_coil", "thermo_optic", "glassy_potting", "quadrupole"):
        steady = slice(100, 2900)
        one, two = EFFECTS[name].signal(UNIT, fast, 1.0), EFFECTS[name].signal(UNIT, warmed_slowly(way), 1.0)
        np.testing.assert_allclose(two[::2][steady], 0.5 * one[steady], rtol=0.02, atol=1e-6, err_msg=name)


def warmed_slowly(way):
    n = len(way)
    return warmed(np.interp(np.arange(2 * n) / 2.0, np.arange(n), way))


def test_the_field_turns_with_the_case():
    """The same by rotating the case: a radius that shows up when level, and the axis, north at zero."""
    psi = 2.0 * math.pi * UNIT.draw["lean"]
    field = np.array([22.0, -6.0, -41.0]) / 50.0
    turns, elevations = np.radians([0.0, 40.0, 200.0]), np.radians([0.0, 90.0, -90.0])
    # level: axis along x, radii up and to the left; then raised about the left radius
    sensitive = np.array([0.2, math.sin(psi), math.cos(psi)])
    expected = [
        field @ (Rotation.from_euler("z", turn) * Rotation.from_euler("y", -raised)).apply(sensitive)
        for turn, raised in zip(turns, elevations, strict=True)
    ]
    np.testing.assert_allclose(wrong._faraday(turns, elevations, UNIT), expected, atol=1e-12)


def test_the_loop_holds_still_below_its_threshold_and_nowhere_else():
    stage = quiet(3600, angle_deg=np.linspace(60.0, 120.0, 3601))
    rate = sensed_dph(stage, lab.LATITUDE_DEG)
    left = rate + EFFECTS["coupled_modulator"].signal(UNIT, stage, 0.8)
    assert np.all(left[np.abs(rate) < 0.8] == 0.0) and np.all(
        left[np.abs(rate) > 0.8] == rate[np.abs(rate) > 0.8]
    )
    # level: 15.04 cos(latitude) cos(heading)
    still_for = np.degrees(2.0 * np.arcsin(0.8 / (15.041067 * math.cos(math.radians(43.6)))))
    assert np.mean(left == 0.0) * 60.0 == pytest.approx(still_for, rel=0.01)


def test_two_modulators_meet_at_one_temperature():
    meet = 10.0 + 25.0 * UNIT.draw["g1"]
    for off in (0.0, 4.0):
        bodies = {"hub": np.full(20_000, meet + off)}
        beat = EFFECTS["zero_beat"].signal(UNIT, still(20_000, 0.1, bodies_c=bodies), 1.0)
        turns = np.count_nonzero(np.diff(np.sign(beat))) / 2.0
        assert turns == pytest.approx(wrong._BEAT_HZ_PER_K * off * 2000.0, abs=1.0)


def test_every_effect_acts_and_only_those_called_so_change(stages):
    for name, effect in EFFECTS.items():
        apart, whole = repeats_apart(STRAPDOWN, UNIT, stages, name)
        assert whole > 0.0, name
        assert (apart > 0.2) == effect.changing, (name, apart)


def test_a_case_has_the_ratio_planned_and_comes_out_the_same_again(tmp_path):
    prepare_folder(STRAPDOWN, tmp_path)
    what = Plan("pair_1", "pair", 9, (("quadrupole", 4.0), ("coupled_modulator", 2.0)))
    make_case(STRAPDOWN, tmp_path, what)
    seal = read_seal(tmp_path / "sealed" / "pair_1.json")
    assert dict(seal.snr) == pytest.approx({"quadrupole": 4.0, "coupled_modulator": 2.0}, rel=0.05)
    assert seal.names["quadrupole"] == ("shupe",) and seal.left_out == ("DY|0",)
    first = (tmp_path / "cases" / "pair_1" / "WE_2.parquet").read_bytes()
    make_case(STRAPDOWN, tmp_path, what)
    assert (tmp_path / "cases" / "pair_1" / "WE_2.parquet").read_bytes() == first
