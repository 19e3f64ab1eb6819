"""Resonant fibre gyro: heat, table, effects and noise against closed forms, files against the data sheet."""

import math
from itertools import product

import allantools
import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from pytest import approx
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import erfc

from benchmarks.gap_exam import _resonant_fibre_bench as bench
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._resonant_fibre import RESONANT_FIBRE
from simulators.effects import catalogue
from tests.gap_families import null_residual, repeats_apart, run, share_of_the_column, still

UNIT = draw_unit(RESONANT_FIBRE, 5, {})
DRAW, EFFECTS = UNIT.draw, RESONANT_FIBRE.effects
PHASE = 2.0 * math.pi * DRAW["phase"]
RADII, PER_LOG = 0.05075 + 0.0015 * np.arange(8), 2.0 * math.pi * 0.40 * 0.020
NORTH, UP = 15.041 * math.cos(math.radians(52.2)), 15.041 * math.sin(math.radians(52.2))


@pytest.fixture(scope="module")
def stages():
    return RESONANT_FIBRE.campaign(UNIT)


def signal(stage, name, size=1.0):
    return EFFECTS[name].signal(UNIT, stage, size)


def turning(rate_dps, n=4, step_s=0.1, up_deg=90.0, **bodies):
    """A run that feels given rates (n,), of table and Earth, with its axis up."""
    angle = np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, n) - UP / 3600.0) * step_s))
    return still(n, step_s, angle_deg=angle, elevation_deg=np.full(n, up_deg), bodies_c=bodies)


def warm(ring_c, step_s=1.0, **bodies):
    """A run whose shells have given temperatures (n,) or (8, n), and as the first of them hub and board."""
    rows = np.broadcast_to(ring_c, (8, np.shape(ring_c)[-1]))
    alike = {"hub": rows[0], "board": rows[0], **{str(k): row for k, row in enumerate(rows)}}
    return still(rows.shape[1], step_s, bodies_c=alike | bodies)


def by_hand(ring, air_c, fluid_c, fluid_w_per_k, at_s):
    """Return plate, base, can, board, hub, coupler and shells at times, (14, n), by an ODE solver."""
    into = 1.0 / (1.0 / ring.hub_w_per_k + math.log(RADII[0] / 0.050) / PER_LOG)
    out = 1.0 / (1.0 / 0.6 + math.log(0.062 / RADII[-1]) / PER_LOG)
    links = [(0, 1, ring.plate_w_per_k), (1, 2, 1.1), (1, 3, 0.5), (1, 4, 1.4), (4, 5, 0.11), (2, 5, 0.02)]
    links += [(6 + k, 7 + k, PER_LOG / math.log(RADII[k + 1] / RADII[k])) for k in range(7)]
    shells = 1.8e6 * 2.0 * math.pi * RADII * 0.0015 * 0.020
    capacity, flows = np.array([1900.0, 380.0, 230.0, 95.0, 150.0, 62.0, *shells]), np.zeros((14, 14))
    for a, b, w in [*links, (4, 6, into), (2, 13, out)]:
        flows[a, b] = flows[b, a] = w
    inputs = np.zeros((14, 3))
    inputs[:3, 0], inputs[0, 1], inputs[3, 2] = (3.2, 0.6, 1.6), fluid_w_per_k, 3.8
    flows -= np.diag(flows.sum(axis=1) + inputs[:, :2].sum(axis=1))
    return solve_ivp(
        lambda t, now_c: (flows @ now_c + inputs @ (air_c(t), fluid_c(t), 1.0)) / capacity,
        (0.0, at_s[-1]), np.full(14, air_c(0.0)), "LSODA", at_s, rtol=1e-7, atol=1e-6, max_step=20.0,
    ).y  # fmt: skip


def test_bodies_follow_air_and_fluid_as_the_differential_equation_says_and_give_their_heat_to_the_air():
    ring, since_s, names = bench.Ring(1.2, 3.3), np.arange(0.0, 9000.0, 2.0), [*bench._BODIES, *"01234567"]
    asked = 25.0 + np.clip(since_s - 400.0, 0.0, 2400.0) / 60.0
    fluid = 25.0 - np.clip(since_s - 200.0, 0.0, 2400.0) / 60.0
    flowing, at = np.stack((np.nan * fluid, fluid), axis=1), [150, 1300, 2000]
    found = bench.heated(np.stack((asked, asked), axis=1), flowing, np.ones(2), ring)
    for k in (0, 1):
        air_c, fluid_c = (lambda t, v=v: np.interp(t, since_s, v) for v in (found["air"][:, k], fluid))
        exact = by_hand(ring, air_c, fluid_c, 18.0 * k, since_s[at])
        close([found[name][at, k] for name in names], exact, atol=0.05)
    plate, base, can, _, hub, coupler, inner, *_, outer = (found[name][-1, 0] for name in names)
    assert 3.2 * (plate - 65.0) + 0.6 * (base - 65.0) + 1.6 * (can - 65.0) == approx(3.8, rel=2e-3)
    through = PER_LOG * (inner - outer) / math.log(RADII[-1] / RADII[0])
    assert 1.4 * (base - hub) == approx(through + 0.11 * (hub - coupler), rel=0.01)


def test_the_chamber_has_its_fastest_rates_and_a_controller_that_does_not_wind_up():
    since_s, pace = np.arange(0.0, 3000.0, 2.0), np.array([1.0, 1.0, 0.9])
    asked = np.where(since_s[:, None] > 0.0, [2.0, 60.0, -60.0], 0.0)
    air = bench.heated(asked, np.nan * asked, pace, bench.Ring())["air"]
    close((air[100] - air[50])[1:] / 100.0, [6.0 / 60.0, -0.9 * 4.5 / 60.0], rtol=1e-9)
    # e'' + e' / 45 + e / (45 500) = 0, e' = -e / 45 at first
    fast, slow = np.roots([1.0, 1.0 / 45.0, 1.0 / 45.0 / 500.0])
    share = (-1.0 / 45.0 - slow) / (fast - slow)
    error = share * np.exp(fast * since_s) + (1.0 - share) * np.exp(slow * since_s)
    close(2.0 - air[1:, 0], 2.0 * error[:-1], atol=0.06)
    # the limit is left at 45 s times it
    close([(60.0 - air[:, 1].max()) / 4.5, (60.0 + air[:, 2].min()) / 3.0375], error.min(), rtol=0.12)
    close(bench.refined((2.0 * np.arange(20)) ** 3, np.array([7.3, 33.9])), [7.3**3, 33.9**3], rtol=1e-9)


def test_a_log_begins_at_its_time_since_power_on_and_sensors_lag_by_their_time_constants(stages):
    rest, ramp, shock, at = run(stages, "LR"), run(stages, "SR"), run(stages, "CS"), 43 * 60 * 2
    ring = bench.Ring(0.8 + 0.6 * DRAW["c1"], 3.0 + 2.5 * DRAW["c2"])
    exact = by_hand(ring, lambda _: rest.body("air")[0], float, 0.0, 90.25 + np.array([0.0, 500.0, 3000.0]))
    for name, row in (("board", 3), ("hub", 4), ("coupler", 5), ("7", 13)):
        close(rest.body(name)[[0, 1000, 6000]], exact[row], atol=0.02)
    hub, can, coupler = (2.0 * np.diff(ramp.body(name))[at] for name in ("hub", "can", "coupler"))
    assert hub > 0.01 and ramp.body("hub")[at] - ramp.t_in_c[at] == approx(8.0 * hub, rel=0.06)
    assert ramp.body("can")[at] - ramp.t_out_c[at] == approx(5.0 * can, rel=0.08)
    between = (0.11 * ramp.body("hub")[at] + 0.02 * ramp.body("can")[at] - 62.0 * coupler) / 0.13
    assert signal(ramp, "coupler", 2.0)[at] == approx(2.0 * (between - 25.0), abs=0.1)
    assert 480.0 < np.argmax(shock.body("air") < shock.body("air")[0] - 0.5) * shock.step_s < 500.0
    assert shock.phases[:3] == (("air 25", 0.0), ("air 25", 480.0), ("air -32", 486.0))


def test_the_table_is_a_servo_of_second_order(stages):
    time_s, w = 0.002 * np.arange(1000), 2.0 * math.pi * 1.6
    wd = w * math.sqrt(1.0 - 0.81)
    wave = np.exp(-0.9 * w * time_s) * (np.cos(wd * time_s) + 0.9 * w / wd * np.sin(wd * time_s))
    close(bench.servo(7.0 + (np.arange(1001) > 0.0), 0.002)[1:], 8.0 - wave, atol=0.012)
    angle, moving = bench.turned(((5.0, 10.0), (20.0, 0.0)), np.arange(0.0, 40.05, 0.1), 3.0, 20.0)
    close(angle[[150, -1]], [3.0 + 10.0 * (10.0 - 0.25 - 1.8 / w), 3.0 + 150.0], rtol=1e-8)
    assert np.flatnonzero(moving).tolist() == [*range(50, 75), *range(200, 225)]
    sine = run(stages, "SI")
    # first and last second, cycles, the greatest rate and at which frequency
    for row in ((30, 190, 8, 50, 0.05), (210, 360, 30, 40, 0.2), (380, 677, 80, 75, 0.5)):
        rate, ratio = sine.rate_dps[row[0] * 20 : row[1] * 20], row[4] / 1.6
        assert np.abs(rate).max() == approx(row[3] / math.hypot(1.0 - ratio**2, 1.8 * ratio), rel=0.01)
        assert np.sum(rate[1:] * rate[:-1] < 0.0) == approx(2 * row[2], abs=3)
    close(sine.angle_deg[[300, 4000, 7400, -1]], 120.0, atol=1e-6)


def test_positions_and_rates_are_reached_in_turn_and_rows_of_moves_do_not_count(stages):
    headings, tilts = [0, 90, 180, 270, 45, 225, 135, 315], [90, 60, 30, 0, -30, -60, -90, -45, 45]
    places = [(h, e) for e in (0, 90, -90) for h in headings[: 4 if e else 8]]
    for code, stay_s, wanted in (("MP", 200.0, places), ("TB", 160.0, [*product((20, 110), tilts)])):
        stage, ends_s = run(stages, code), np.arange(1, len(wanted) + 1) * stay_s - 1.0
        at = (ends_s / stage.step_s).astype(int)
        close(np.stack((stage.angle_deg[at], stage.elevation_deg[at]), axis=1), wanted, atol=1e-6)
        tumbling = np.abs(np.diff(stage.elevation_deg, prepend=stage.elevation_deg[0])) / stage.step_s
        assert tumbling.max() == approx(12.0, rel=1e-6)
        assert stage.in_rows(np.abs(stage.rate_dps) + tumbling)[stage.valid].max() < 1e-6
    steps = np.kron([0.004, 0.012, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 25.0, 50.0, 80.0, 120.0], [1.0, -1.0])
    steady, fast = np.resize([60.0, -60.0], 136), np.resize([20.0, -20.0, 45.0, -45.0, 80.0, -80.0], 144)
    for code, begin_s, stay_s, rates in (("ST", 60, 60, steady), ("FR", 20, 4, fast), ("RS", 60, 48, steps)):
        stage, ends_s = run(stages, code), begin_s + stay_s * np.arange(1, len(rates) + 1) - 0.5
        close(stage.rate_dps[(ends_s / stage.step_s).astype(int)], rates, atol=0.02 if code == "FR" else 5e-6)
    assert run(stages, "TB").elevation_deg[639:641] == approx([90.0, 88.5])
    # a ramp at 60 deg/s^2, two seconds and six more are blanked
    blanked = np.abs(np.diff(steps, prepend=0.0, append=0.0)) / 60.0 + 8.0
    assert np.sum(~stage.valid) * 0.5 == approx(blanked.sum(), abs=0.5 * 25)


def test_the_campaign_has_three_rounds_a_profile_never_shown_and_rows_lost(stages):
    assert len({s.run_id for s in stages}) == 29
    assert [(s.number, s.repeat) for s in stages] == [(k, k // 10) for k in range(29)]
    assert {s.profile for s in stages} - {s.profile for s in stages if not s.held_out} == {"day's duty"}
    assert {s.repeat for s in stages if s.held_out and s.code != "DD"} == {2}
    assert {float(s.edges_s[1]) for s in stages} == {0.2, 0.5, 1.0, 2.0}
    assert min(s.t_in_c.min() for s in stages) < -28.0 and max(s.t_in_c.max() for s in stages) > 58.0
    starts, lost = np.array([s.body("air")[0] for s in stages]) - 25.0, []
    assert starts.std() == approx(0.2, abs=0.06) and abs(starts.mean()) < 0.12
    slews = [run(stages, "CS", k).body("air")[[1020, 1620]] @ (1.0, -1.0) / 5.0 / 4.5 for k in range(3)]
    assert 0.005 < np.std(slews) < 0.1 and np.mean(slews) == approx(1.0, abs=0.09)
    # the row after a loss has what the counter missed
    for stage in stages:
        begins, ends = (np.flatnonzero(np.diff(stage.kept.astype(int)) == way) + 1 for way in (-1, 1))
        lost += (ends - begins).tolist()
        assert not stage.valid[ends].any()
        assert stage.code in ("RS", "MP", "TB") or np.sum(~stage.valid) == len(ends)
    assert len(lost) == approx(sum(s.seconds for s in stages) / 6000.0, abs=12.0)
    assert set(lost) >= {1, 2, 3, 4} and np.mean(lost) == approx(2.5, abs=0.7)


def test_delay_and_flange_weigh_the_shells_and_stress_is_that_of_its_differential_equation():
    length, ramp = RADII / RADII.sum(), np.arange(100.0) / 60.0
    for k in (0, 7):
        place = length[:k].sum() + 0.5 * length[k] - 0.15 - 0.2 * DRAW["a"]
        close(signal(warm(np.outer(np.arange(8) == k, ramp)), "delay"), length[k] * (1.0 - 2.0 * place))
    close(signal(warm(ramp), "delay", 3.0), 0.9 + 1.2 * DRAW["a"], rtol=1e-9)
    across = RADII - RADII.mean()
    rows = np.stack((4.0 * across / (RADII[-1] - RADII[0]), 1e5 * across**2, 0.0 * across + 7.0), axis=1)
    close(signal(warm(rows), "bent_flange", 2.0), [8.0, 0.0, 0.0], atol=1e-9)
    rate, glass = np.repeat([0.0, -1.2, 0.0, 2.0], [300, 3000, 600, 2100]), -20.0 + 14.0 * DRAW["c"]
    path = 20.0 + np.cumsum(rate) / 60.0 - rate / 120.0
    keeps = np.clip((100.0 + 90.0 * DRAW["b"]) * np.exp((glass - path) / 25.0), 40.0, 600.0)
    fed, at = rate / (1.0 + np.exp((path - glass) / 4.5)), np.array([1500, 2700, 3250, 3500, 3800, 4500])
    exact = solve_ivp(lambda t, s: ((fed - s) / keeps)[int(t)], (0, 4600), [0], "RK45", at + 0.5, max_step=9)
    close(signal(warm(path), "stiff_resin", 2.0)[at], 2.0 * exact.y[0], atol=0.03)
    close(signal(warm(np.linspace(40.0, 80.0, 600)), "stiff_resin"), 0.0, atol=1e-3)


def test_relaxing_effects_keep_what_is_left_of_a_step():
    jump, since = np.where(np.arange(1000) < 100, 0.0, 1.0), np.arange(1.0, 901.0)
    glue = np.dot((0.25, 0.45, 0.3), np.exp(-5.0 * since / [[700.0], [2200.0], [6000.0]]))
    close(signal(warm(10.0 * jump, 5.0), "creeping_glue", 3.0)[100:], 30.0 * glue, rtol=1e-6)
    sagging = -0.8 * np.exp(-since / 40.0) - 1.2 * np.exp(-since / 220.0)
    close(signal(still(1000, elevation_deg=90.0 - 180.0 * jump), "slow_sag")[100:], sagging, rtol=1e-6)
    warmed = 1.0 - 0.4 * np.exp(-since / (90.0 + 60.0 * DRAW["b"])) - 0.6 * np.exp(-since / 700.0)
    ringing = np.exp(-since / 60.0) * np.sin(2.0 * np.pi * since / (28.0 + 16.0 * DRAW["b"]))
    for way in (60.0, -60.0):
        stage = turning(way * jump + UP / 3600.0, 1000, 1.0)
        close(signal(stage, "shifter_heat", 2.0)[100:], 2.0 * warmed, atol=1e-3)
        close(signal(stage, "levelling", 2.0)[101:], 2.0 * ringing[:-1], atol=1e-6)
    # Carslaw and Jaeger, Conduction of Heat in Solids, 3.3: a slab's insulated face, by a series of images
    stage = still(2000, power_on_s=300.0)
    root = 2.0 * np.sqrt((stage.time_s + 300.0) / (700.0 + 1500.0 * DRAW["c1"]))
    images = sum((-1.0) ** k * erfc((2.0 * k + 1.0) / root) for k in range(6))
    close(signal(stage, "pump", 2.0), 2.0 * (1.0 - 2.0 * images), atol=1e-6)


def test_kerr_expansion_and_eigenmodes_have_their_even_and_odd_parts():
    width, at, x = 75.0 + 40.0 * DRAW["a"], 0.5 + 0.8 * DRAW["c"], np.array([1e-4, 0.3, 0.6])
    up, down = (signal(warm(25.0 + way * width * x), "kerr", 5.0) for way in (1.0, -1.0))
    close(up + down, -10.0 * math.sin(at) * (1.0 - np.cos(x)), atol=1e-8)
    close(up - down, 10.0 * math.cos(at) * (np.sin(x) - x), atol=1e-8)
    bodies = warm(np.array([75.0, -25.0, 25.0, 25.0]), board=np.array([25.0, 25.0, 65.0, 25.0])).bodies_c
    ppm = 1e6 * signal(turning(50.0, **bodies), "expansion", 2.0) / (2.0 * 3600.0 * 50.0)
    bend = 0.15 + 0.15 * DRAW["b"]
    close(ppm, [37.5 * (1.0 + bend), 37.5 * (bend - 1.0), 10.0, 0.0], rtol=1e-4, atol=1e-9)
    turn, span = np.linspace(0.0, 2.0, 2001), 16.0 + 10.0 * DRAW["a"]
    shown = signal(warm(25.0 + span * (turn - DRAW["phase"])), "eigenmodes", 2.0)
    close(shown[[*range(1001), *range(1000, 2001)]], np.append(shown[1000:], -shown[1000::-1]), atol=1e-9)
    # the greatest where the cosine is 2/3
    greatest = [shown.max(), turn[np.argmax(shown[:1000])]]
    close(greatest, [2.0 / math.sqrt(5.0), math.acos(2.0 / 3.0) / 2.0 / math.pi], atol=1e-3)


def test_laser_and_relays_have_loops_of_their_width_that_close():
    path, half, at = np.linspace(-20.0, 30.0, 20_001), 0.5 + 0.5 * DRAW["b"], -8.0 + 26.0 * DRAW["form"]
    shown = signal(warm(board := np.append(path, path[::-1])), "laser_mode", 4.0)
    up, down = np.flatnonzero(np.diff(shown > 2.0))
    close([board[up] - at, board[down] - at, shown[0], shown[20_000]], [half, -half, 0.0, 4.0], atol=0.02)
    assert (4.0 - shown[up + 4]) / (4.0 - shown[up + 1]) == approx(math.exp(-1.0), rel=1e-6)
    assert signal(warm(np.array([at + 0.1])), "laser_mode") == 1.0
    assert EFFECTS["laser_mode"].truth(UNIT, 4.0) == {"bias_step_dph": 4.0}
    # Mayergoyz: minor loops close, and between the same turns they are congruent; all saturates
    after = [np.repeat((start, 10.0, 40.0, 10.0, -150.0), 600) for start in (200.0, -150.0)]
    one, other = (signal(warm(path), "relays", 2.0)[590::600] for path in after)
    close([one[3], one[2] - one[3], other[0]], [one[1], other[2] - other[3], -2.0], atol=1e-4)
    assert one[3] > other[1] + 0.1 and one[0] == approx(2.0) and one[4] == approx(-2.0, abs=1e-4)
    path = np.append(there := np.linspace(-150.0, 150.0, 6001), there[::-1])
    up, down = path[np.flatnonzero(np.diff(signal(warm(path, 10.0), "relays") > 0.0))]
    # the mean of a lognormal; 0.2 K in 40 s
    assert up - down == approx(2.0 * (4.0 + 6.0 * DRAW["c2"]) * math.exp(0.5 * 0.45**2) + 0.4, rel=0.08)
    jump = signal(warm(np.where(np.arange(900) < 500, -150.0, 200.0)), "relays")
    assert up + down == approx(30.0, abs=2.0) and jump[600] == approx(1.0 - 2.0 * math.exp(-2.5), abs=0.04)


def test_curves_over_rate_are_those_of_loop_shifters_limiter_and_beat():
    """Slope of a Lorentzian: x / (1 + x^2)^2; split of resonances: diameter over wavelength and index."""
    rates, hertz = np.array([2.0, 40.0, 110.0, -110.0]), math.radians(0.12 / 1.55e-6 / 1.46)
    width, found = 25e3 + 20e3 * DRAW["c"], signal(turning(rates), "slack_loop", 0.04)
    for asked, shown in zip(rates * hertz / width, found, strict=True):
        beside = brentq(lambda x, asked=asked: 0.04 * (asked - x) - x / (1.0 + x * x) ** 2, -0.5, 0.5)
        assert shown == approx(3600.0 * width / hertz * (1.04 * (asked - beside) - asked), rel=2e-3, abs=0.05)
    blur, limit = 0.1 + 0.3 * DRAW["a"], 120.0 / 1.5
    shown = signal(turning(np.array([60.0, -60.0, blur, 0.0])), "two_shifters", 8.0)
    close(shown, 0.0144 * np.array([60.0, 60.0, blur * math.tanh(1.0), 0.0]), atol=1e-4)
    shown = signal(turning(np.array([120.0, -120.0, 60.0, limit])), "drive_limit", 1.5) / 3600.0
    close(shown, [limit - 120.0, 120.0 - limit, 0.0, -0.015 * limit * math.log(2.0)], atol=1e-4)
    # Adler's beat, its mean over phase noise on a fine grid
    noise, ratios = np.linspace(-8.0, 8.0, 40_001), np.array([0.3, 0.8, 1.1, 1.6, 4.0, -1.1])
    seen = ratios[:, None] + (0.15 + 0.35 * DRAW["c"]) * noise
    beat = np.sign(seen) * np.sqrt(np.maximum(seen**2 - 1.0, 0.0))
    lost = ratios - np.average(beat, axis=1, weights=np.exp(-0.5 * noise**2))
    close(signal(turning(40.0 * ratios / 3600.0, 6), "backscatter", 40.0), -40.0 * lost, atol=1.2)
    far = signal(turning(np.array([1.5, -1.5]), 2), "backscatter", 40.0)
    close(far, [-8.0 / 54.0, 8.0 / 54.0], rtol=1e-4)


def test_field_lean_and_flange_act_by_attitude():
    up_deg, angle = np.random.default_rng(8).uniform(-90.0, 90.0, 40), np.linspace(0.0, 280.0, 41)
    stage = still(40, 500.0, angle_deg=angle, elevation_deg=up_deg, bodies_c={"hub": np.full(40, 75.0)})
    attitude = Rotation.from_euler("ZY", np.stack((angle[1:] - 3.5, -up_deg), axis=1), degrees=True)
    axis, aside, above = (attitude.apply(each) for each in np.eye(3))
    declined, towards = math.radians(20.0 * DRAW["tilt"] - 10.0), 2.0 * math.pi * DRAW["lean"]
    field = np.array([0.42 * math.cos(declined), 0.42 * math.sin(declined), -0.75])
    through = (0.3 * axis + math.cos(PHASE) * aside + math.sin(PHASE) * above) @ field
    close(signal(stage, "faraday", 3.0), 3.0 * (through + 0.1 * through**3), atol=1e-9)
    spin = [NORTH * np.sinc(7.0 / 360.0), 0.0, UP + 3600.0 * 7.0 / stage.step_s]
    leaned = math.radians(0.2) * (math.sin(towards) * aside + math.cos(towards) * above) @ spin
    close(signal(stage, "lean", 0.2), leaned, rtol=1e-4)
    close(signal(stage, "soft_flange", 3.0), 3.0 * axis[:, 2], atol=1e-9)


def test_loop_and_bearing_have_the_gain_of_their_poles_encoder_and_motor_waves_of_angle():
    time_s, w = (np.arange(4000) + 0.5) * 0.005, 2.0 * math.pi * 1.5
    late = (1.0 / (1.0 + 0.5j * w * 0.04) ** 2 - 1.0) * np.exp(1j * w * time_s)
    found = signal(turning(20.0 * np.cos(w * time_s), 4000, 0.005), "loop_lag", 40.0)
    close(found[1000:], 3600.0 * 20.0 * late.real[1000:], atol=0.004 * 3600.0 * 20.0)
    waves, order = np.arange(1, 41), (12, 16, 22)[int(3.0 * DRAW["order"])]
    for rate in (2.0, -60.0, 118.0):
        ratio = 9.0 * waves * abs(rate) / 360.0 / (130.0 + 60.0 * DRAW["g1"])
        power = (
            3e-4 * rate**2 * np.average(np.abs(1.0 - ratio**2 + 0.2j * ratio) ** -2.0, weights=waves**-1.4)
        )
        close(signal(turning(rate), "bearing", 3.0), power, rtol=0.02, atol=1e-3)
    # arcsec of exp(i order angle): a sine is -i
    disc = 5j * np.exp(1j * np.array([1.0, 2.3]) * PHASE) * [1.0, 0.15 + 0.3 * DRAW["c1"]]
    poles = -5j * np.exp(1j * np.array([1.0, 0.7]) * PHASE) * [1.0, 0.35]
    for rate, up_deg, side in ((0.5, 90.0, 1.0), (45.0, -90.0, -1.0), (45.0, 0.0, 0.0)):
        stage = turning(rate + UP / 3600.0, 14_400, 0.05 / rate, up_deg)
        slower = 1.0 + (order * rate / 360.0 / np.array([4.0, 2.0])) ** 2
        for name, base, expected in (("encoder_disc", 1, disc), ("motor_poles", order, poles / slower)):
            waves = np.exp(-1j * base * np.outer((1, 2), np.radians(stage.angle_deg[1:])))
            turned = np.cumsum(signal(stage, name, 5.0)) * stage.step_s
            close(2.0 * np.mean(turned * waves, axis=1), side * expected, atol=0.02)


def test_true_values_are_those_of_the_catalogues_own_columns(stages):
    stated = {name for name, effect in EFFECTS.items() if effect.truth} - {"laser_mode"}
    assert stated == {"two_shifters", "sag", "tilted_table", "loop_lag", "skewed_clock"}
    for name in stated:
        share = share_of_the_column(RESONANT_FIBRE, UNIT, stages[:10], name)
        assert share == approx(1.0, abs=1e-6 if name == "sag" else 0.08), name
    called = {name for effect in EFFECTS.values() for name in (*effect.names, *effect.beside)}
    assert called | {name for _, _, name in RESONANT_FIBRE.noisy.values()} <= set(catalogue())


def test_modes_weather_and_compressor_have_their_times_and_sizes():
    shown = signal(still(400_000), "two_modes", 3.0)
    edges = np.flatnonzero(np.diff(shown)) + 1
    stays, upper = np.diff(edges), shown[edges[:-1]] > 0.0
    assert set(shown) == {0.0, 3.0} and stays.min() >= 20
    assert (stays[upper].mean(), stays[~upper].mean()) == approx((130.0, 280.0), rel=0.1)
    shown = signal(still(300_000, 10.0), "weather", 2.0)
    for lag in (0, 15, 90):
        expected = 4.0 * (math.exp(-lag / 90.0) + 0.16 * math.exp(-lag / 15.0))
        assert np.mean(shown[lag:] * shown[: len(shown) - lag]) == approx(expected, rel=0.1)
    for air_c, share in ((25.0, 0.38), (-25.0, 0.805), (75.0, 0.08), (-60.0, 0.9)):
        shown = signal(still(200_000, bodies_c={"air": np.full(200_000, air_c)}), "compressor", 2.0)
        assert shown.mean() == approx(2.0 * share, rel=0.04)
        begins = np.flatnonzero(np.diff((shown > 1.0).astype(int)) == 1)
        assert np.diff(begins).mean() == approx(260.0, rel=0.03)
        assert 130 < np.diff(begins).min() < 146 and 374 < np.diff(begins).max() < 390
    assert (2.0 - shown[begins[5] + 7]) / (2.0 - shown[begins[5] + 1]) == approx(math.exp(-1.0), rel=0.02)


def test_a_support_comes_loose_turns_slip_and_only_what_is_said_to_change_differs_between_repeats(stages):
    for stage in stages[4:16]:
        loose = 5e-6 * sensed_dph(stage, 52.2) * (stage.number >= 6 + int(9.0 * DRAW["c1"]))
        close(signal(stage, "cracked_splice", 5.0), loose, atol=1e-12)
    hub, jolts = np.append(np.linspace(700.0, 0.0, 20_000), np.zeros(4000)), []
    for repeat in range(4):
        shown = signal(still(24_000, repeat=repeat, bodies_c={"hub": hub}), "slips", 2.0)
        steps = np.diff(shown, prepend=0.0)
        jolts += (own := steps[np.abs(steps) > 0.3].tolist())
        assert shown[-1] == approx(0.5 * sum(own), abs=1.0)
        assert np.diff(np.log(np.abs(shown[[20_300, 20_500]] - shown[-1]))) == approx(-1.0, abs=0.01)
    assert len(jolts) == approx(400, abs=60) and abs(np.mean(np.sign(jolts))) < 0.2
    close(np.quantile(np.abs(jolts), (0.02, 0.5, 0.98)), (0.85, 2.0, 3.15), rtol=0.1)
    for name in RESONANT_FIBRE.foreign:
        apart, whole = repeats_apart(RESONANT_FIBRE, UNIT, stages[:20], name)
        assert whole > 0.0 and (apart > 0.2) == EFFECTS[name].changing, (name, apart)
    twin = still(1, **vars(stages[0]) | {"repeat": 1, "number": 19})
    for name, effect in EFFECTS.items():
        both = [signal(stage, name, min(1.0, effect.sizes[1])) for stage in (stages[0], twin)]
        assert np.ptp(both, axis=0).any() == effect.changing, name


def test_noise_has_the_allan_deviation_of_the_sheet_and_of_its_factors():
    """IEEE Std 952: N^2 / tau, B^2 2 ln 2 / pi, K^2 tau / 3 and, for a quantum q, q^2 / (4 tau^2)."""
    taus, factors = np.array([2.0, 4.0, 64.0, 512.0]), {"": 1.0, "photons": 2.0, "laser_flicker": 8.0}
    for name, factor in (factors | {"ring_walk": 20.0, "coarse_counter": 3.0}).items():
        squares, grows = [], [factor if name == each else 1.0 for each in RESONANT_FIBRE.noisy]
        white, flicker, walk, quantum = np.array([0.009, 0.025, 0.015, 0.49]) * grows
        expected = 3600.0 * white**2 / taus + flicker**2 * 2.0 * math.log(2.0) / math.pi
        expected += walk**2 * taus / 3600.0 / 3.0 + quantum**2 / 4.0 / taus**2
        for seed in range(6):
            unit, rng = draw_unit(RESONANT_FIBRE, seed, {name: factor}), np.random.default_rng(seed)
            output = RESONANT_FIBRE.rows(unit, still(16_000, 0.5), np.full(16_000, 9.0), rng)
            assert output[:100].mean() == approx(9.0, abs=0.7)
            close(counts := output * 0.5 / quantum, np.rint(counts), atol=1e-6)
            squares.append(allantools.oadev(output, rate=2.0, data_type="freq", taus=taus)[1] ** 2)
        apart = np.sqrt(np.mean(squares, axis=0) / expected) - 1.0
        assert (np.abs(apart) < [0.03, 0.03, 0.08, 0.2]).all(), (name, apart)


def test_a_log_has_hundredths_and_codes_and_a_null_the_noise_of_its_sheet(stages, tmp_path):
    ramp, turned, code = run(stages, "SR"), run(stages, "RS"), 360.0 / 2**28
    sensors = RESONANT_FIBRE.read(UNIT, ramp, np.random.default_rng(2))[:2]
    for shown, true in zip(sensors, (ramp.t_in_c, ramp.t_out_c), strict=True):
        assert np.std(shown - ramp.in_rows(true)) == approx(math.hypot(0.008, 0.01 / 12**0.5), rel=0.05)
        close(100.0 * shown, np.rint(100.0 * shown), atol=1e-6)
    off = RESONANT_FIBRE.read(UNIT, turned, np.random.default_rng(2))[2] - turned.at_edges(turned.angle_deg)
    assert np.abs(off).max() < 0.51 * code and off.std() == approx(code / 12**0.5, rel=0.05)
    residual = null_residual(RESONANT_FIBRE, tmp_path, 3)
    assert np.mean(residual**2) == approx(1.0, abs=0.1) and np.abs(residual).max() < 5.5
