"""The hemispherical-resonator family against closed forms: heat, the two modes of the shell, loops, belt, noise,
its nulls; what makes each effect act, its parity and its memory.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.special import gamma

from bench.record.exchange import read_log, read_mapping
from benchmarks.gap_exam import _hemispherical as lab
from benchmarks.gap_exam import _hemispherical_bench as plant
from benchmarks.gap_exam import _hemispherical_effects as wrong
from benchmarks.gap_exam._campaign import motor_deg
from benchmarks.gap_exam._files import Logged, read_seal, write_case
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._hemispherical import HEMISPHERICAL
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, prepare_folder
from benchmarks.gap_exam._signals import drawn
from tests.gap_families import deviations, null_residual, repeats_apart, share_of_the_column, still, stimulus

UNIT = draw_unit(HEMISPHERICAL, 5, {})
BODIES = dict.fromkeys(plant.BODIES, 25.0)


@pytest.fixture(scope="module")
def stages():
    return HEMISPHERICAL.campaign(UNIT)


def test_the_chamber_balances_heat():
    step_s, n = 1.0, 20_000
    fan = plant.Fan(300.0, 0.2)
    air, can, flange, shell, running = plant.chambered(
        np.full(n, 45.0), step_s, fan, cold_start=True
    ).values()
    late = slice(n - 6000, None)  # twenty whole periods of the fan
    film = np.where(running > 0.5, plant._FILM_W_PER_K[1], plant._FILM_W_PER_K[0])
    inward = np.mean((film * (air - can))[late])
    assert np.mean(air[late]) == pytest.approx(45.0, abs=0.01)
    # what comes in by the film and from the electronics leaves by the bracket
    assert inward + plant._ELECTRONICS_W == pytest.approx(
        plant._BRACKET_W_PER_K * np.mean(flange[late] - plant.ROOM_C), abs=0.02
    )
    # the shell: conduction along the stem against radiation between two bodies, Stefan-Boltzmann
    wall, own = np.mean(can[late]) + 273.15, np.mean(shell[late]) + 273.15
    radiated = (wall**4 - own**4) / (4.0 * 298.15**3) / 2400.0
    assert radiated == pytest.approx((own - 273.15 - np.mean(flange[late])) / 900.0, rel=0.02)


def test_the_chamber_cools_slower_than_it_heats_and_stops_where_its_pump_is_spent():
    n = 12_000
    up, down = (
        plant.chambered(
            np.concatenate((np.full(60, 22.0), np.full(n, goal))), 1.0, plant.Fan(300.0, 0.0), cold_start=True
        )["air"]
        for goal in (52.0, -8.0)
    )
    assert np.argmax(down < -5.0) > 1.5 * np.argmax(up > 49.0)
    spent = plant.chambered(
        np.concatenate((np.full(60, 22.0), np.full(n, -60.0))), 1.0, plant.Fan(300.0, 0.0), cold_start=True
    )["air"]
    # leak and pump meet: (less + leak) d = cools, the bracket brings a little more
    alone = plant.ROOM_C - plant._COOLS_W / (plant._LESS_W_PER_K + plant._LEAK_W_PER_K)
    assert alone < spent[-1] < alone + 4.0


def two_modes(turn_rad_s, mismatch_per_s, start_rad, seconds, omega=2.0 * math.pi * 40.0):
    """Integrate the two modes of n = 2 and return how far their pattern turned on the shell, rad.

    x'' = omega^2 and damping, coupled by the turn of the case; the mode's plane is twice the shell's angle.
    """
    mean = 0.3
    gyration = 4.0 * wrong.BRYAN * turn_rad_s

    def motion(_, state):
        x, y, vx, vy = state
        return (
            vx, vy,
            -omega**2 * x - (mean + mismatch_per_s) * vx + gyration * vy,
            -omega**2 * y - (mean - mismatch_per_s) * vy - gyration * vx,
        )  # fmt: skip

    plane = 2.0 * start_rad
    begin = (math.cos(plane), math.sin(plane), 0.0, 0.0)
    whole = round(seconds * omega / (2.0 * math.pi)) * 2.0 * math.pi / omega
    found = solve_ivp(motion, (0.0, whole), begin, method="DOP853", rtol=1e-10, atol=1e-12)
    times = np.linspace(whole - 2.0 * math.pi / omega, whole, 60)
    late = solve_ivp(motion, (0.0, whole), begin, method="DOP853", rtol=1e-10, atol=1e-12, t_eval=times).y[:2]
    assert found.success
    # the long axis of the ellipse, on the shell half of that in the plane of the modes
    axis = 0.5 * math.atan2(2.0 * np.mean(late[0] * late[1]), np.mean(late[0] ** 2 - late[1] ** 2))
    turned = (axis - plane + math.pi / 2.0) % math.pi - math.pi / 2.0
    return turned / 2.0


def test_the_pattern_lags_by_bryans_factor():
    assert two_modes(0.5, 0.0, 0.0, 1.0) == pytest.approx(-wrong.BRYAN * 0.5, rel=0.02)
    n = 1000
    stage = still(n, 0.1, angle_deg=np.linspace(0.0, 200.0, n + 1), elevation_deg=np.full(n, 90.0))
    middle = 0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1])
    earth = 15.041067 * math.sin(math.radians(52.2)) * stage.time_s / 3600.0
    np.testing.assert_allclose(wrong.pattern_rad(stage), -wrong.BRYAN * np.radians(middle + earth), atol=2e-4)


def test_a_mismatch_of_damping_drifts_with_four_times_the_patterns_angle():
    """Both modes damped alike by the mean; their difference turns the pattern towards the one less damped."""
    places = np.radians([5.0, 11.25, 22.5, 33.75, 45.0, 60.0, 67.5])
    drift = np.array([two_modes(0.0, 0.02, place, 1.0) for place in places])
    # read in the middle of the last of 40 swings
    np.testing.assert_allclose(drift, (1.0 - 0.5 / 40.0) * 0.02 / 4.0 * np.sin(4.0 * places), atol=4e-5)
    n = 3000
    stage = still(n, 0.1, angle_deg=np.linspace(0.0, 500.0, n + 1), elevation_deg=np.full(n, 90.0))
    pattern = wrong.pattern_rad(stage)
    np.testing.assert_allclose(wrong.anisotropy(stage, 4, 0.1), np.sin(4.0 * (pattern - 0.1)))
    wave = wrong._damping_wave(UNIT, stage)
    assert wave[0] == pytest.approx(0.0, abs=1e-3)
    assert np.ptp(wave) == pytest.approx(2.0, abs=1e-3)
    # the same again after a quarter of the shell, 90 / 0.2775 degrees of the table
    apart = round(90.0 / wrong.BRYAN / (500.0 / n))
    np.testing.assert_allclose(wave[apart:], wave[:-apart], atol=0.02)


def test_loops_have_the_area_of_parallelograms_and_do_not_care_how_fast():
    reach = 30.0
    once = np.concatenate((np.linspace(0, reach, 3001), np.linspace(reach, -reach, 6001)[1:]))
    loop = np.concatenate((once, np.linspace(-reach, reach, 6001)[1:], np.linspace(reach, -reach, 6001)[1:]))
    held = wrong.plays(loop, wrong._PLAYS_K)
    area = abs(np.trapezoid(held[-12000:], loop[-12000:]))
    assert area == pytest.approx(np.mean([4.0 * r * (reach - r) for r in wrong._PLAYS_K]), rel=2e-3)
    np.testing.assert_allclose(wrong.plays(np.repeat(loop, 3), wrong._PLAYS_K)[::3], held, atol=1e-12)


def test_charges_spread_as_kohlrausch_says():
    """The integral of exp(-(t/T)^b) is T Gamma(1 + 1/b)."""
    seconds = (np.arange(2_000_000) + 0.5) * 0.05
    assert wrong.stretched(seconds, 900.0, 0.8).sum() * 0.05 == pytest.approx(
        900.0 * gamma(1.0 + 1.0 / 0.8), rel=1e-3
    )


def test_losses_grow_by_their_activation():
    """ln of the ratio over the difference of 1 / T is the activation energy over k."""
    warm, cold = (float(wrong.losses(np.array([c]))[0]) + 1.0 for c in (40.0, -5.0))
    assert math.log(warm / cold) / (1.0 / 268.15 - 1.0 / 313.15) == pytest.approx(3500.0, rel=1e-9)


def test_the_motor_turns_as_far_as_its_rates_say_and_the_belt_follows():
    step_s = 0.005
    edges = np.arange(0.0, 60.0, step_s)
    motor = motor_deg([(5.0, 20.0), (15.0, 0.0), (30.0, -5.0), (40.0, 0.0)], edges, 7.0, 300.0)
    assert motor[-1] == pytest.approx(7.0 + 200.0 - 50.0, abs=1e-9)
    assert np.abs(np.diff(motor, 2)).max() / step_s**2 <= 300.0 * (1.0 + 1e-6)
    table = plant.belted(motor, step_s)
    turn = math.radians(plant.PULLEYS * 157.0)
    toothed = plant._ECCENTRIC_DEG * math.sin(turn) + plant._TOOTH_DEG * math.sin(20 * turn)
    assert table[-1] == pytest.approx(157.0 + toothed, abs=1e-6)
    # it rings after the stop at 15 s
    ringing = table[round(15.2 / step_s) : round(17.0 / step_s)] - table[round(29.0 / step_s)]
    crossings = np.flatnonzero(np.diff(np.sign(ringing)))[:7]
    damped = plant._BELT_HZ * math.sqrt(1.0 - plant._BELT_DAMPING**2)
    assert np.mean(np.diff(crossings)) * step_s == pytest.approx(0.5 / damped, rel=0.03)


def test_noise_is_white_flicker_walk_and_counts():
    step_s = 16.0 / 15.0
    taus = step_s * np.array([2.0, 16.0, 128.0, 1024.0])
    found = deviations(HEMISPHERICAL, taus, 20_000, step_s)
    sheet = lab.SHEET
    # the units are 0 to 7 % better than the sheet
    white = 0.965**2 * 3600.0 * sheet.arw_deg_per_sqrt_h**2 / taus
    flicker = 2.0 * math.log(2.0) / math.pi * sheet.bias_instability_dph**2
    walk = sheet.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    np.testing.assert_allclose(found, np.sqrt(white + flicker + walk), rtol=0.12)
    counting = draw_unit(HEMISPHERICAL, 1, {"counter": 50.0})
    n = 40_000
    output = lab.rows(counting, still(n, step_s), np.zeros(n), drawn(1, "noise"))
    counts = output * step_s / (50.0 * sheet.quantum_arcsec)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    held = draw_unit(HEMISPHERICAL, 1, {"held_words": 0.05})
    output = lab.rows(held, still(n, step_s), np.zeros(n), drawn(1, "noise"))
    plain = lab.rows(draw_unit(HEMISPHERICAL, 1, {}), still(n, step_s), np.zeros(n), drawn(1, "noise"))
    again = np.mean(np.diff(output) == 0.0) - np.mean(np.diff(plain) == 0.0)
    assert again == pytest.approx(0.05, abs=0.006)


def test_a_null_case_is_the_nominal_model_and_noise(tmp_path):
    left = null_residual(HEMISPHERICAL, tmp_path, 4242)
    assert left.var() == pytest.approx(0.95, abs=0.07)
    assert abs(stats.kurtosis(left)) < 0.4 and np.abs(left).max() < 5.0


def test_campaign_limits_masks_and_losses(stages):
    assert len(stages) == 27 and len({stage.key for stage in stages}) == len({s.run_id for s in stages}) == 27
    assert sorted(stage.number for stage in stages) == list(range(27))
    shown = {stage.profile for stage in stages if not stage.held_out}
    assert {stage.profile for stage in stages} - shown == {"mixed shift"}
    t_in = np.concatenate([stage.t_in_c for stage in stages])
    assert t_in.min() < -3.0 and t_in.max() > 50.0
    rates = np.concatenate([stage.axis_dps for stage in stages])
    assert np.quantile(rates, 0.999) == pytest.approx(90.0, rel=0.02)
    for stage in stages:
        # the cable: three turns from its middle
        assert np.abs(stage.angle_deg).max() < 1085.0
        assert 0.97 < stage.kept.mean() <= 1.0 and stage.kept[-1]
        moving = stage.in_rows(np.abs(stage.rate_dps)) > 0.05
        if stage.code == "PO":
            assert moving.any() and not (moving & stage.valid).any() and stage.valid.mean() > 0.85
        else:
            assert stage.valid.all()
    assert sum(not stage.kept.all() for stage in stages) > 15
    periods = {round(1.0 / float(np.diff(stage.edges_s[:2])[0]), 3) for stage in stages}
    assert periods == {37.5, 0.938}


def test_logs_have_date_times_and_words_of_twelve_bits(stages, tmp_path):
    for code in ("PO", "RT"):
        stage = next(stage for stage in stages if stage.code == code)
        rate = stage.in_rows(sensed_dph(stage, HEMISPHERICAL.latitude_deg))
        logged = Logged(stage, rate, *lab.read(UNIT, stage, drawn(0)))
        write_case(tmp_path, HEMISPHERICAL, [logged])
        text = (tmp_path / f"{code}_1.csv").read_text().splitlines()
        assert text[0] == '"stamp","hrg_rate","table","t_in","t_out","elevation"'
        assert text[1].startswith(f"2026-03-{2 + (6.5 + 8 * stage.number) // 24:02.0f} ")
        words = np.array([[int(word) for word in line.split(",")[3:5]] for line in text[1:]])
        assert words.min() >= -2048 and words.max() <= 2047
        mapping = read_mapping(tmp_path / "runs.toml")
        log = read_log(tmp_path / mapping.run[0].file, mapping)
        np.testing.assert_allclose(
            log.time_s - log.time_s[0], np.append(0.0, stage.edges_s[1:][stage.kept]), atol=1e-6
        )
        expected = np.where(stage.valid, rate, np.nan)[stage.kept]
        np.testing.assert_allclose(3600.0 * log.columns["output"][1:], expected, rtol=1e-9, atol=1e-9)
        true = stage.in_rows(stage.t_in_c)[stage.kept]
        assert np.std(log.columns["t_in"][1:] - true) == pytest.approx(
            math.hypot(0.02, 0.03125 / math.sqrt(12.0)), rel=0.1
        )


def test_the_true_rate_is_what_the_catalogue_expects_of_the_log(stages):
    for stage in stages[::3]:
        if stage.code in ("TR", "ST", "WU", "LR", "SP"):
            mine = stage.in_seconds(sensed_dph(stage, HEMISPHERICAL.latitude_deg))
            theirs = stimulus(HEMISPHERICAL, stage).input_rate_dph
            np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=0.2)


def test_true_values_are_those_of_the_catalogues_own_columns(stages):
    stated = [name for name, effect in HEMISPHERICAL.effects.items() if effect.truth and name != "washer"]
    for name in stated:
        share = share_of_the_column(HEMISPHERICAL, UNIT, stages, name)
        assert share == pytest.approx(1.0, abs=0.08), name
    assert len(stated) == 12
    # the step of the washer, well below and well above its temperature
    c = wrong._seat_c(UNIT)
    stage = still(2, bodies_c={**BODIES, "flange": np.array([c - 5.0, c + 5.0])})
    np.testing.assert_allclose(
        HEMISPHERICAL.effects["washer"].signal(UNIT, stage, 0.7), (0.0, 0.7), atol=1e-9
    )


def warmed(n=7000, step_s=1.0, **changed):
    """A run that warms from 0 to 50 degC at rest."""
    flange = np.linspace(0.0, 50.0, n)
    bodies = {"air": flange, "can": 1.1 * flange, "flange": flange, "shell": 0.9 * flange, "fan": np.zeros(n)}
    return still(n, step_s, **{"bodies_c": bodies, "t_in_c": flange, "power_on_s": 9e6, **changed})


def constant(n, **changed):
    bodies = {name: np.full(n, 25.0) for name in plant.BODIES}
    return {"bodies_c": bodies, "power_on_s": 9e6, **changed}


def test_each_effect_needs_its_own_cause():
    """Temperature, turning, gravity, fan: which of them makes an effect vary."""
    n = 7000
    turned = np.concatenate((np.zeros(1000), np.linspace(0.0, 50_000.0, n - 999)))
    up = np.full(n, 90.0)
    causes = {
        "warm": warmed(n),
        "turn": still(n, 1.0, **constant(n, angle_deg=turned, elevation_deg=up)),
        "tumble": still(n, 1.0, **constant(n, elevation_deg=np.linspace(-90.0, 90.0, n))),
        "fan": still(n, 1.0, **constant(n)),
    }
    causes["fan"].bodies_c["fan"][:] = np.arange(n) // 100 % 2
    expected = {
        "warm": "damping_mismatch quadrature_leak late_shell stem_glue stem_heat solder_loops washer "
        "mode_crossing spent_getter",
        "turn": "belt_shake centrifugal damping_wave pick_off_wave quadrature_windup eccentric_pulley",
        "tumble": "sagging_shell soft_electrodes",
        "fan": "fan_shake",
    }
    for cause, names in expected.items():
        for name in names.split():
            signal = HEMISPHERICAL.effects[name].signal
            varies = {key: float(np.std(signal(UNIT, stage, 1.0))) for key, stage in causes.items()}
            others = [value for key, value in varies.items() if key != cause]
            # the Earth turns the pattern a little in every run
            assert varies[cause] > 1e-5 and max(others) < 0.1 * varies[cause], (name, varies)
    hours = HEMISPHERICAL.effects["leaking_charge"].signal(UNIT, causes["fan"], 0.5)
    assert np.polyfit(causes["fan"].time_s / 3600.0, hours, 1)[0] == pytest.approx(0.5)
    fresh = replace(causes["fan"], power_on_s=0.0)
    charge = HEMISPHERICAL.effects["charging"].signal(UNIT, fresh, 0.5)
    assert charge[0] == pytest.approx(0.5, abs=0.01) and 0.0 < charge[-1] < 0.05
    # rate times temperature
    both = warmed(n, angle_deg=turned, elevation_deg=up)
    for name in ("crystal", "thick_shell"):
        signal = HEMISPHERICAL.effects[name].signal
        ends = signal(UNIT, both, 2.0)[[1000, -1]]
        assert ends[0] < 0.0 < ends[1] and np.abs(signal(UNIT, causes["turn"], 2.0)).max() < 1e-9
    assert HEMISPHERICAL.effects["crystal"].signal(UNIT, both, 2.0)[-1] == pytest.approx(
        2e-6 * 25.0 * sensed_dph(both, lab.LATITUDE_DEG)[-1]
    )


def test_parity_in_the_rate():
    n = 4000
    turned = 60.0 * np.cumsum(np.append(0.0, np.sin(np.arange(n) / 300.0)))
    there, back = (warmed(n, angle_deg=sign * turned, elevation_deg=np.full(n, 90.0)) for sign in (1.0, -1.0))
    odd = {"crystal": 1.0, "thick_shell": 1.0, "centrifugal": 1.0}
    even = {"belt_shake": 1.0, "quadrature_windup": 1.0}
    for parity, names in ((-1.0, odd), (1.0, even)):
        for name, size in names.items():
            signal = HEMISPHERICAL.effects[name].signal
            one, other = signal(UNIT, there, size), signal(UNIT, back, size)
            # the Earth adds 12 deg/h to 60 deg/s
            np.testing.assert_allclose(one, parity * other, atol=1e-3 * np.abs(one).max())


def test_memory_in_temperature():
    """Passed twice as slowly the same temperatures give the same, unless something lags."""
    loop = np.concatenate(
        (np.linspace(25, 50, 2000), np.linspace(50, 0, 4000)[1:], np.linspace(0, 25, 2000)[1:])
    )

    def run(values):
        bodies = {
            "air": values,
            "can": values,
            "flange": values,
            "shell": values,
            "fan": np.zeros(len(values)),
        }
        return still(len(values), 1.0, bodies_c=bodies)

    fast, slow = run(loop), run(np.repeat(loop, 2))
    without = ("damping_mismatch", "quadrature_leak", "washer", "mode_crossing")
    for name in (*without, "solder_loops", "stem_glue"):
        signal = HEMISPHERICAL.effects[name].signal
        one, two = signal(UNIT, fast, 1.0), signal(UNIT, slow, 1.0)[::2]
        tells = np.abs(one - two).max() / np.ptp(one)
        up, down = one[:2000], one[1999:3999][::-1]
        opens = np.abs(up - down).max() / np.ptp(one)
        # of the twelve degrees an hour by which the Earth turns the pattern a little is seen
        assert (tells > 0.1) == (name == "stem_glue"), (name, tells)
        assert (opens > 0.1) == (name in ("solder_loops", "stem_glue")), (name, opens)


def test_every_effect_acts_and_only_those_called_so_change(stages):
    for name, effect in HEMISPHERICAL.effects.items():
        apart, whole = repeats_apart(HEMISPHERICAL, UNIT, stages, name)
        assert whole > 0.0, name
        # they follow the table's angle, which is not the same again to a degree
        if name not in ("sparks",):
            assert (apart > 0.2) == effect.changing, (name, apart)


def test_a_case_has_the_ratio_planned_and_comes_out_the_same_again(tmp_path):
    prepare_folder(HEMISPHERICAL, tmp_path)
    what = Plan("pair_1", "pair", 9, (("solder_loops", 4.0), ("charging", 2.0)))
    make_case(HEMISPHERICAL, tmp_path, what)
    seal = read_seal(tmp_path / "sealed" / "pair_1.json")
    assert dict(seal.snr) == pytest.approx({"solder_loops": 4.0, "charging": 2.0}, rel=0.02)
    assert seal.names["solder_loops"] == ("hysteresis",) and seal.left_out == ("MX|0",)
    first = (tmp_path / "cases" / "pair_1" / "SW_2.csv").read_bytes()
    make_case(HEMISPHERICAL, tmp_path, what)
    assert (tmp_path / "cases" / "pair_1" / "SW_2.csv").read_bytes() == first
