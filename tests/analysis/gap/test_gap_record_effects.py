"""Effects that a record shows by itself: limits, dead bands, impulses, lines; and the table's tilt.

The plants here are other implementations than the catalogue's: loops, rotation matrices, a flicker of counts.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import fftconvolve

from bench.analysis.gap import (
    Diagnosis,
    Model,
    closed_model,
    diagnose,
    model_text,
    parse_model,
)
from bench.analysis.gap._close import shrinkage
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._disturbed import without_disturbances
from simulators.effects import SlowRates, Stimulus
from simulators.effects._limits import _edge_dph
from tests.analysis.gap.conftest import effect, made_run, stimulus

RATES_DPS = (0.0, 0.01, -0.01, 0.03, -0.03, 0.1, -0.1, 1.0, -1.0, 10.0, -10.0, 50.0, -50.0, 100.0, -100.0)


def _steps(rates_dps: tuple[float, ...] = RATES_DPS, each_s: int = 120) -> Stimulus:
    rates = np.tile(np.repeat(rates_dps, each_s), 2)
    angle = np.concatenate(([5.0], 5.0 + np.cumsum(rates)))
    return replace(stimulus(len(rates), cold=False), angle_deg=angle)


def _rates_runs(seed: int, response: object, names: str = "ab", s: Stimulus | None = None) -> list[GapRun]:
    rng = np.random.default_rng(seed)
    runs = []
    for name in names:
        own = s or _steps()
        clean = made_run(name, own, rng)
        rate = own.input_rate_dph
        runs.append(
            replace(
                clean, output_dph=clean.output_dph - rate + np.array([response(r) for r in rate.tolist()])
            )
        )
    return runs


def _named(found: Diagnosis) -> list[str]:
    return [cause.name for cause in found.causes]


def test_saturation_is_found_with_its_limit_and_shrinks_a_held_out_run(nominal: Model) -> None:
    def response(rate_dph: float) -> float:
        full = 71.0 * 3600.0
        return full if rate_dph > full else -full if rate_dph < -full else rate_dph

    found = diagnose(_rates_runs(1, response), nominal)
    assert _named(found) == ["saturation"]
    assert found.causes[0].term.variant.shape["limit_dps"] == pytest.approx(71.0, rel=0.002)
    assert found.causes[0].term.values[0] == pytest.approx(1.0, abs=0.02)
    closed = parse_model(model_text(closed_model(found)), "closed")
    assert shrinkage(found.model, closed, _rates_runs(2, response, "c"), found.rate.floor).share > 0.99


@pytest.mark.parametrize("upper", [93.0, 140.0])
def test_an_output_that_stops_at_other_rates_in_both_senses_is_saturation_alone(
    nominal: Model, upper: float
) -> None:
    """A cut of one sense more than of the other is even in the rate, too: no rectification stands beside it."""

    def response(rate_dph: float) -> float:
        return min(max(rate_dph, -97.0 * 3600.0), upper * 3600.0)

    found = diagnose(_rates_runs(1, response), nominal)
    assert _named(found) == ["saturation"]
    closed = parse_model(model_text(closed_model(found)), "closed")
    assert shrinkage(found.model, closed, _rates_runs(2, response, "c"), found.rate.floor).share > 0.99
    rate = np.array([-120.0, -97.5, -96.0, 0.0, 96.0, 102.0, 105.0])
    s = replace(stimulus(len(rate), cold=False), angle_deg=np.concatenate(([0.0], np.cumsum(rate))))
    s = replace(s, latitude_deg=0.0)
    cut = effect("saturation").columns(s, {"limit_dps": 100.0, "softness": 0.0, "lean": 0.03})[0] / 3600.0
    assert cut == pytest.approx([23.0, 0.5, 0.0, 0.0, 0.0, 0.0, -2.0], abs=1e-4)


@pytest.mark.parametrize("power", [0.5, 0.8])
def test_a_bias_that_settles_by_a_power_of_time_is_a_warm_up(nominal: Model, power: float) -> None:
    """As charge that soaks into a capacitor; no single time constant does so."""
    s, rng = stimulus(9000, cold=False), np.random.default_rng(2)

    def settling(name: str) -> GapRun:
        run = made_run(name, s, rng)
        return replace(run, output_dph=run.output_dph + 2.0 * (1.0 + s.time_s / 40.0) ** -power)

    found = diagnose([settling("a"), settling("b")], nominal)
    assert (found.verdict, _named(found)) == ("explained", ["warm_up"])
    assert found.causes[0].term.variant.shape["stretch"] < 0.8
    assert effect("warm_up").columns(s, {"time_constant_s": 400.0, "stretch": 0.5})[0, 1599] == pytest.approx(
        math.exp(-2.0), abs=1e-3
    )


@pytest.mark.parametrize("power", [0.3, 0.6])
def test_creep_by_a_power_of_time_is_something_late_and_no_rate_of_change(
    nominal: Model, power: float
) -> None:
    """A cement between thermometer and case, by superposition of what each second's change does (Boltzmann)."""
    s, rng = stimulus(9000), np.random.default_rng(5)
    cement_c = 0.5 * (s.t_in_c + s.t_out_c)
    still_to_come = (1.0 + np.arange(9000.0) / 150.0) ** -power
    creep = fftconvolve(np.diff(cement_c, prepend=cement_c[0]), still_to_come)[:9000]

    found = diagnose([made_run(name, s, rng, 0.8 * creep) for name in "ab"], nominal)
    assert found.verdict == "explained" and len(found.causes) == 1
    cause = found.causes[0]
    assert {cause.name, *cause.one_of} & {"relaxation", "thermal_lag"}
    assert cause.name != "shupe" or cause.probability < 0.8
    closed = parse_model(model_text(closed_model(found)), "closed")
    again = [made_run(name, s, rng, 0.8 * creep) for name in "cd"]
    assert shrinkage(found.model, closed, again, found.rate.floor).share > 0.98


def test_a_field_that_stands_up_ten_times_as_much_as_it_follows_the_heading_is_none(
    nominal: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A field on a unit in eight attitudes; what of it a limit does not allow is gravity's."""
    possible = effect("heading_sensitivity").possible
    assert possible(np.array((0.06, -0.08, 0.6, 0.79)), np.zeros((4, 4)))
    assert not possible(np.array((0.06, -0.08, 0.6, 0.81)), np.zeros((4, 4)))
    # only the difference of the two that stand is known, as of a unit that was upright and level
    apart = np.diag((0.0, 0.0, 1e4, 1e4)) + np.pad(1e4 * np.eye(2)[::-1], ((2, 0), (2, 0)))
    assert possible(np.array((0.06, -0.08, 70.0, 69.0)), apart)
    assert not possible(np.array((0.06, -0.08, 70.0, 68.0)), apart)
    elevation = np.repeat((90.0, 90.0, 90.0, 90.0, 0.0, 0.0, 0.0, 0.0), 150)
    heading_deg = np.repeat(np.tile((0.0, 90.0, 180.0, 270.0), 2), 150)
    flat = stimulus(len(elevation), cold=False)
    s = replace(flat, angle_deg=np.append(heading_deg, heading_deg[-1]), elevation_deg=elevation)
    field = 0.3 * np.cos(np.radians(heading_deg - 20.0)) + 0.6 * np.sin(np.radians(elevation))
    field[np.diff(s.angle_deg) != 0.0] = np.nan  # a move of 90 deg within a second is no reading
    rng = np.random.default_rng(6)
    runs = [made_run(name, s, rng, field) for name in "abc"]
    assert _named(diagnose(runs, nominal)) == ["heading_sensitivity"]
    monkeypatch.setattr("simulators.effects._motion._STEEPEST", 1.0)
    (level, *others) = diagnose(runs, nominal).causes
    north, west, up, along = level.term.values
    assert (level.name, len(others)) == ("heading_sensitivity", 1)
    assert others[0].name in ("acceleration_sensitivity", "acceleration_squared")
    assert math.hypot(up, along) <= math.hypot(north, west) == pytest.approx(0.3, abs=0.03)


def test_a_field_is_named_where_no_run_changes_the_attitude(nominal: Model) -> None:
    """There what of a field stands up is a bias, so that no fit knows how large it is."""
    rates_dps = np.repeat((2.0, -2.0, 6.0, -6.0), 500)
    angle_deg = np.concatenate(([10.0], 10.0 + np.cumsum(rates_dps)))
    flat = stimulus(len(rates_dps), cold=False)
    turned = replace(flat, angle_deg=angle_deg)
    stays = [replace(turned, elevation_deg=np.full(len(flat), each)) for each in (90.0, 90.0, 0.0)]
    middle_deg = (angle_deg[1:] + angle_deg[:-1]) / 2.0
    blur = np.sinc(rates_dps / 360.0)  # a mean over 1 s
    field = 8.0 * np.cos(np.radians(middle_deg - 20.0)) * blur + 0.2
    field.reshape(-1, 100)[:, 40:45] = np.nan
    rng = np.random.default_rng(6)
    found = diagnose([made_run(name, s, rng, field) for name, s in zip("abc", stays, strict=True)], nominal)
    assert _named(found) == ["heading_sensitivity"]
    north, west, *standing = found.causes[0].term.values
    assert math.hypot(north, west) == pytest.approx(8.0, abs=0.1) and standing == [0.0, 0.0]


def test_dead_zone_is_found_with_its_band(nominal: Model) -> None:
    found = diagnose(_rates_runs(3, lambda rate: 0.0 if -60.0 < rate < 60.0 else rate), nominal)
    assert _named(found) == ["dead_zone"]
    # Earth's 9.5 and +-0.01 deg/s (36 deg/h) are inside, 0.03 deg/s (108) is outside
    assert 45.5 < found.causes[0].term.variant.shape["band_dph"] < 98.5


def test_the_edge_of_a_dead_zone_is_found_between_two_samples() -> None:
    """Levels of 1.9 and 8 deg/h, two passes of the edge at 5.39 deg/h, noise of 0.4 and a bias of 3."""
    rng = np.random.default_rng(4)
    passes = np.concatenate((np.linspace(-8.0, 8.0, 400), np.linspace(8.0, -8.0, 400)))
    rate_dph = np.concatenate((np.full(300, 1.9), passes, np.full(300, -8.0)))
    angle = np.concatenate(([0.0], np.cumsum(rate_dph / 3600.0)))
    s = replace(stimulus(len(rate_dph), cold=False), angle_deg=angle, latitude_deg=0.0)
    rate = s.input_rate_dph
    rest = np.where(np.abs(rate) < 5.39, -rate, 0.0) + 3.0 + rng.normal(0.0, 0.4, len(s))
    rest[700:720] = np.nan
    none = np.zeros(0)
    rates = SlowRates(none, none, none.astype(np.int64), [(s, rest)])
    for guess in (2.5, 5.0, 6.5):
        assert _edge_dph(rates, guess) == pytest.approx(5.39, abs=0.03)
    alive = SlowRates(none, none, none.astype(np.int64), [(s, rng.normal(0.0, 0.1, len(s)))])
    assert _edge_dph(alive, 2.5) == 2.5


def test_lock_in_is_told_from_a_dead_zone(nominal: Model) -> None:
    def beat(rate: float) -> float:
        """Mean frequency of d psi/dt = rate + b sin psi over whole turns, by quadrature of the time for one."""
        b = 80.0
        if abs(rate) <= b:
            return 0.0
        psi = (np.arange(720) + 0.5) * math.pi / 360.0
        return math.copysign(1.0, rate) / float(np.mean(1.0 / np.abs(rate + b * np.sin(psi))))

    found = diagnose(_rates_runs(4, beat), nominal)
    assert _named(found) == ["lock_in"]
    assert found.causes[0].term.variant.shape["lock_dph"] == pytest.approx(80.0, rel=0.05)


def _positions(seed: int, names: str, tilt_deg: tuple[float, float]) -> list[GapRun]:
    """Eight positions of 300 s, level and upright, the whole table turned about north and east by matrices."""
    rng = np.random.default_rng(seed)
    places = [(0, 0), (90, 0), (180, 0), (270, 0), (45, 0), (0, 90), (0, -90), (225, 0)]
    psi, level = np.repeat(np.array(places, dtype=float), 300, axis=0).T
    earth = 15.041067 * np.array([0.0, math.cos(math.radians(39.1)), math.sin(math.radians(39.1))])
    north, east = (math.radians(each) for each in tilt_deg)
    about_north = np.array(
        [[math.cos(north), 0, math.sin(north)], [0, 1, 0], [-math.sin(north), 0, math.cos(north)]]
    )
    about_east = np.array(
        [[1, 0, 0], [0, math.cos(east), -math.sin(east)], [0, math.sin(east), math.cos(east)]]
    )
    turn = about_north @ about_east
    runs = []
    for name in names:
        s = stimulus(len(psi), cold=False)
        s = replace(s, angle_deg=np.append(psi[:1], psi), elevation_deg=level)
        # no turn between two positions is part of a sample
        s = replace(s, angle_deg=np.append(psi, psi[-1]))
        axis = np.stack(
            (
                -np.sin(np.radians(psi)) * np.cos(np.radians(level)),
                np.cos(np.radians(psi)) * np.cos(np.radians(level)),
                np.sin(np.radians(level)),
            )
        )
        run = made_run(name, s, rng, profile="positions", condition="eight")
        added = earth @ (turn @ axis) - earth @ axis
        added[np.diff(s.angle_deg) != 0.0] = np.nan
        runs.append(replace(run, output_dph=run.output_dph + added))
    return runs


def test_tilt_of_the_table_is_found_in_both_directions(nominal: Model) -> None:
    found = diagnose(_positions(5, "ab", (0.6, -0.9)), nominal)
    assert _named(found) == ["table_tilt"]
    assert found.causes[0].term.values == pytest.approx((0.6, -0.9), abs=0.08)


def test_vibration_that_is_rectified_follows_the_square_of_rate(nominal: Model) -> None:
    s = _steps((0.0, 20.0, -20.0, 60.0, -60.0, 100.0, -100.0, 140.0, -140.0))
    found = diagnose(_rates_runs(6, lambda rate: rate + 3.0 * abs(rate / 360e3) ** 2, s=s), nominal)
    assert _named(found) == ["vibration_rectification"]
    assert found.causes[0].term.values[0] == pytest.approx(3.0, abs=0.5)


def _with_impulses(run: GapRun, rng: np.random.Generator) -> GapRun:
    output = run.output_dph.copy()
    for at in {"a": (501, 1702, 2903), "b": (712, 1913, 3114)}[run.run_id]:
        share = rng.uniform(0.2, 1.0)
        output[at] += 6.0 * share
        output[at + 1] += 6.0 * (1.0 - share)
    return replace(run, output_dph=output)


def test_what_comes_at_the_same_times_of_every_repeat_is_no_impulse(nominal: Model) -> None:
    rng = np.random.default_rng(9)
    s = stimulus(4000, cold=False)

    def run(name: str, at: np.ndarray) -> GapRun:
        kicks = np.zeros(len(s))
        kicks[at] = 40.0
        return made_run(name, s, rng, kicks)

    places = np.array([410, 900, 1500, 2100, 2800, 3300])
    same = [run(f"same {k}", places + k) for k in range(3)]
    assert "impulses" not in diagnose(same, nominal).rate.stochastic
    apart = [run(f"apart {k}", (places + 137 * k) % 3900 + 20) for k in range(3)]
    assert "impulses" in diagnose(apart, nominal).rate.stochastic


def test_what_comes_only_while_the_table_turns_fast_is_no_impulse(nominal: Model) -> None:
    """Turning takes a tenth of the time: that all of five come in it is no chance."""
    rng = np.random.default_rng(10)
    s = stimulus(4000, cold=False)
    angle = np.interp(np.arange(4001.0), [0.0, 1800.0, 2200.0, 4000.0], [0.0, 0.0, 8000.0, 8000.0])
    turning = replace(s, angle_deg=angle)

    def runs(places: list[int]) -> list[GapRun]:
        made = []
        for k in range(3):
            kicks = np.zeros(len(s))
            kicks[[place + 37 * k for place in places]] = 40.0
            made.append(made_run(f"run {k}", turning, rng, kicks))
        return made

    def named(places: list[int]) -> bool:
        return "impulses" in without_disturbances(runs(places), nominal).probabilities

    assert not named([1830, 1900, 1960, 2010, 2090])
    assert named([430, 1900, 1960, 2010, 3090])


@pytest.mark.parametrize("per_turn", [2, 0])
def test_what_comes_at_one_angle_of_a_turning_table_is_no_impulse(nominal: Model, per_turn: int) -> None:
    """At 60 deg/s half a turn has three samples: a wobble of two a turn that grows lifts one of them."""
    rng = np.random.default_rng(14)
    s = stimulus(4000, cold=False)
    angle = np.interp(np.arange(4001.0), [0.0, 1500.0, 2500.0, 4000.0], [0.0, 0.0, 60_000.0, 60_000.0])
    turning = replace(s, angle_deg=angle)
    runs, number = [], 0
    for k in range(3):
        kicks = np.zeros(len(s))
        for at in (1560, 1711, 1822, 1993, 2074, 2165, 2236, 2317, 2398):
            place = at + 37 * k
            kicks[place - (place % 3 if per_turn else int(rng.integers(3)))] = 40.0
        number += int(np.count_nonzero(kicks))
        kicks[[430 + 37 * k, 3090 - 41 * k]] = 40.0
        runs.append(made_run(f"run {k}", turning, rng, kicks))
    found = without_disturbances(runs, nominal)
    (term,) = found.terms
    assert term.name == "impulses"
    hours = 3 * 4000 / 3600.0
    # those at rest are the gyro's, whatever the table does when it turns
    assert term.values[0] * hours == pytest.approx(6 if per_turn else 6 + number, abs=0.5)


def test_one_sample_in_hours_is_no_process(nominal: Model) -> None:
    rng = np.random.default_rng(12)
    s = stimulus(4000, cold=False)
    kicks = np.zeros(len(s))
    kicks[1234] = 40.0
    once = [made_run("a", s, rng, kicks), made_run("b", s, rng)]
    assert "impulses" not in without_disturbances(once, nominal).probabilities


def test_small_impulses_are_told_where_chance_has_none_so_many_and_a_few_are_not(nominal: Model) -> None:
    """Of 8 standard deviations, 6.5 of the difference to the neighbours' mean: 8 in 40,000 samples, or 2."""

    def named(count: int) -> bool:
        rng = np.random.default_rng(count)
        runs = []
        for name in "abcdefgh":
            s = stimulus(5000, cold=False)
            run = made_run(name, s, rng)
            kicks = np.zeros(len(s))
            if len(runs) < count:
                kicks[int(rng.integers(100, 4900))] = 8.0 * float(np.std(np.diff(run.output_dph))) / 2.0**0.5
            runs.append(replace(run, output_dph=run.output_dph + kicks))
        return "impulses" in without_disturbances(runs, nominal).probabilities

    assert named(8) and not named(2)


def test_angles_read_in_coarse_steps_are_no_impulses_and_lost_counts_are(nominal: Model) -> None:
    """An angle that is read wrong by a step comes back with the next sample; a count that is lost does not."""

    def named(comes_back: bool) -> bool:
        rng = np.random.default_rng(31)
        runs = []
        for name in "abcdefgh":
            run = made_run(name, stimulus(5000, cold=False), rng)
            step = 12.0 * float(np.std(np.diff(run.output_dph)))
            kicks = np.zeros(5000)
            for at in rng.integers(100, 4900, 6).tolist():
                kicks[at : at + 2] += (step, -step) if comes_back else (0.5 * step, 0.5 * step)
            runs.append(replace(run, output_dph=run.output_dph + kicks))
        return "impulses" in without_disturbances(runs, nominal).probabilities

    assert named(comes_back=False) and not named(comes_back=True)


def test_noise_with_somewhat_heavier_tails_has_no_impulses(nominal: Model) -> None:
    """Student's t with 12 degrees of freedom: some hundred times as often beyond five standard deviations."""
    rng = np.random.default_rng(2)
    runs = []
    for name in "abcdefgh":
        run = made_run(name, stimulus(5000, cold=False), rng)
        heavy = rng.standard_t(12, 5000) / rng.standard_normal(5000).std() * float(np.std(run.output_dph))
        runs.append(replace(run, output_dph=run.output_dph.mean() + heavy))
    assert "impulses" not in without_disturbances(runs, nominal).probabilities


def test_impulses_are_counted_measured_and_left_out(nominal: Model) -> None:
    rng = np.random.default_rng(7)
    runs = [
        _with_impulses(made_run(name, s, rng, 0.4 * (s.warm_k / 50.0) ** 3), rng)
        for name in "ab"
        for s in [stimulus(6000)]
    ]
    found = diagnose(runs, nominal)
    assert set(found.rate.stochastic) == {"impulses"}
    assert _named(found) == ["bias_cubic"]
    (term,) = found.rate.disturbed.terms
    hours = 2 * 6000 / 3600.0
    assert term.values == pytest.approx((6.0 / hours, 6.0), rel=0.15)
    assert "6 in 3.3 h" in found.rate.size_of("impulses")
    text = model_text(closed_model(found))
    assert parse_model(text, "closed").disturbances[0].values == term.values


def test_a_line_is_named_with_amplitude_and_frequency_and_taken_out(nominal: Model) -> None:
    """50.027 Hz sampled once a second without a mean: an alias at 0.027 Hz, its phase another in every run."""
    rng = np.random.default_rng(8)
    runs = []
    for name in "abc":
        s = stimulus(6000)
        wave = 0.12 * np.sin(2.0 * math.pi * (50.027 * s.time_s) + rng.uniform(0.0, 6.0))
        runs.append(made_run(name, s, rng, wave + 0.4 * (s.warm_k / 50.0) ** 3))
    found = diagnose(runs, nominal)
    assert _named(found) == ["bias_cubic"]
    assert set(found.rate.stochastic) == {"vibration_or_mains_line"}
    (term,) = found.rate.disturbed.terms
    assert term.values[0] == pytest.approx(0.12, abs=0.015)
    assert term.values[1] == pytest.approx(0.027, abs=2e-5)
    again = diagnose(runs, replace(nominal, disturbances=found.rate.disturbed.terms))
    assert not again.rate.stochastic


def test_a_line_is_taken_out_of_runs_too_in_which_the_table_moves(nominal: Model) -> None:
    """A table that stops between rates hides no vibration: the line has the same size there, its own phase."""
    rng = np.random.default_rng(11)
    still, moving = stimulus(4000, cold=False), _steps()
    runs = [
        made_run("still", still, rng, 1.5 * np.sin(2.0 * np.pi * 0.137 * still.time_s)),
        made_run("moving", moving, rng, 1.5 * np.sin(2.0 * np.pi * 0.137 * moving.time_s + 1.0)),
        made_run("without", moving, rng),
    ]
    left = without_disturbances(runs, nominal).runs
    for run in left:
        rest = run.output_dph - nominal.predict(run.stimulus)
        turn = 2.0 * np.pi * 0.137 * run.stimulus.time_s
        amplitude = 2.0 * abs(np.mean((rest - rest.mean()) * np.exp(1j * turn)))
        assert amplitude < 0.05  # noise of 0.24 deg/h in 3600 samples: 0.006 in the mean
    assert np.array_equal(left[2].output_dph, runs[2].output_dph)


@pytest.mark.parametrize("seed", range(3))
def test_quiet_records_name_nothing(nominal: Model, seed: int) -> None:
    rng = np.random.default_rng((11, seed))
    runs = [made_run(name, stimulus(5000), rng) for name in "ab"]
    runs += _rates_runs(100 + seed, lambda rate: rate, "cd")
    runs += _positions(200 + seed, "ef", (0.0, 0.0))
    turning = stimulus(5000, rate_dps=20.0, cold=False)
    runs += [made_run(name, turning, rng, profile="turning", condition="+20") for name in "gh"]
    found = diagnose(runs, nominal)
    assert found.verdict == "no gap", (found.causes, found.rate.stochastic)


def test_what_is_switched_is_no_steady_line(nominal: Model) -> None:
    """A compressor of 40 s that runs in the cold only: not a steady line, whatever else it is called."""
    rng = np.random.default_rng(9)
    runs = []
    for name in "ab":
        s = stimulus(6000)
        on = np.sin(2.0 * math.pi * s.time_s / 40.0 + rng.uniform(0.0, 6.0)) * (s.t_out_c < 0.0)
        runs.append(made_run(name, s, rng, 0.15 * on))
    assert not diagnose(runs, nominal).rate.disturbed.terms


def test_tilt_column_is_the_derivative_of_the_projection() -> None:
    s = stimulus(300, elevation_deg=30.0)
    columns = effect("table_tilt").columns(s, {})
    psi, level, phi = math.radians(10.0), math.radians(30.0), math.radians(39.1)
    axis = np.array([-math.sin(psi) * math.cos(level), math.cos(psi) * math.cos(level), math.sin(level)])
    earth = 15.041067 * np.array([0.0, math.cos(phi), math.sin(phi)])
    for column, about in zip(columns, ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)), strict=True):
        expected = float(earth @ np.cross(about, axis)) * math.radians(1.0)
        assert column[5] == pytest.approx(expected, abs=1e-9)


def test_a_line_that_follows_temperature_is_one_line_and_nothing_unknown_beside_it(nominal: Model) -> None:
    """0.08 Hz, and weakly 3 % more where the table moves: there it is not looked for. 9 % is another."""
    rng = np.random.default_rng(7)

    def humming(name: str, s: Stimulus, hz: float, amplitude_dph: float = 0.05) -> GapRun:
        run = made_run(name, s, rng, profile=f"{len(s)}")
        wave = amplitude_dph * np.sin(2.0 * np.pi * hz * np.arange(len(s)) + rng.uniform(0.0, 6.0))
        return replace(run, output_dph=run.output_dph + wave)

    still = [humming(name, stimulus(9000, cold=False), 0.08, 0.2) for name in "abc"]
    found = diagnose([*still, *(humming(name, _steps(), 0.0824) for name in "de")], nominal)
    assert (found.verdict, list(found.rate.stochastic)) == ("explained", ["vibration_or_mains_line"])
    assert found.rate.unknown_probability < 0.2
    found = diagnose([*still, *(humming(name, _steps(), 0.0872) for name in "fg")], nominal)
    assert (found.verdict, list(found.rate.stochastic)) == ("explained in part", ["vibration_or_mains_line"])


def test_an_edge_at_one_rate_of_one_sense_is_a_function_of_rate_without_a_name(nominal: Model) -> None:
    """Turbulence sets in beyond 40 deg/s one way: it takes three formulas of rate, and is none of them."""

    def response(rate_dph: float) -> float:
        over = max(rate_dph / 3600.0 - 40.0, 0.0)
        return rate_dph - 3600.0 * 0.5 * (1.0 - math.exp(-over / 8.0))

    found = diagnose(_rates_runs(1, response), nominal).rate
    assert found.verdict == "unknown" and not found.causes
    assert [part.follows for part in found.unknown_parts] == ["input rate"]
    assert len(found.resembles) >= 3


def test_a_memory_that_no_run_shows_is_not_held_against_what_has_none(nominal: Model) -> None:
    """Rates at three temperatures, each held from the start: when the scale factor comes, nobody sees."""
    rng = np.random.default_rng(9)
    runs = []
    for warm_k in (-40.0, 0.0, 35.0):
        for name in "ab":
            s = _steps((0.0, 20.0, -20.0, 0.0, 60.0, -60.0))
            s = replace(s, t_in_c=np.full(len(s), 25.0 + warm_k), t_out_c=np.full(len(s), 25.0 + warm_k))
            extra = 3e-6 * warm_k * s.input_rate_dph
            runs.append(made_run(f"{warm_k:g} {name}", s, rng, extra, condition=f"{warm_k:g}"))
    found = diagnose(runs, nominal)
    (cause,) = found.causes
    assert cause.one_of == ("scale_factor_temperature",)
    assert "cannot be told from scale_factor_temperature" in found.rate.unidentifiable["scale_factor_lag"]
