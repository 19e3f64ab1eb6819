"""The parts of the standard test by hand: which intervals a figure is made of, and what is refused."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval, noise_exponents
from bench.analysis.common.allan_noise import NoiseCoefficients, _intervals, fit_noise
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.figures import Figure, _record
from bench.analysis.figures import _parts as figures_parts
from bench.analysis.figures._bias import bias_figures, warm_up_time_s
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._from_run import figures_of_record
from bench.analysis.figures._parts import PARTS, noise_figures, noise_of
from bench.analysis.figures._record import Record
from bench.analysis.figures._scale_factor import fit_rate_sequence
from bench.record.events.run import Interval
from benchmarks.metrology import certificate
from drivers.base.errors import ConfigurationError

WHITE = NoiseCoefficients(0.0, 0.003, 0.0, 0.0, 0.0)
NORTH_DPH = 15.041067 * math.cos(math.radians(40.0))


class Rows:
    """Intervals at 40 degrees of latitude, with what gyro and table did in each by its start."""

    latitude_deg = 40.0

    def __init__(self, *rows, azimuth=60.0, **of):
        self.rows, self.azimuth, self.of = rows, azimuth, of

    def needed(self, test):
        if found := self.intervals(test):
            return found
        raise ConfigurationError(f"no {test}")

    def intervals(self, test):
        return [row for row in self.rows if row.test == test]

    def seconds_dph(self, row):
        return self.of["seconds"][row.start_s]

    def samples_dph(self, row):
        return self.of["seconds"][row.start_s], self.of["rate_hz"]

    def mean_dps(self, row):
        return self.of["means"][row.start_s]

    def true_rate_dps(self, row):
        return 1.01 * (row.rate_dps or 0.0)

    def azimuth_deg(self, row):
        return self.azimuth


def rest(start, length=600.0, test="bias", **own):
    return Interval(test, start, start + length, **own)


def test_a_bias_is_that_of_the_first_power_on_and_its_repeatability_that_of_all():
    rng = np.random.default_rng(1)
    level = {0.0: 20.0, 700.0: 21.0, 1400.0: 24.0}
    seconds = {start: own + rng.normal(0.0, 0.1, 600) for start, own in level.items()}
    bias, ten, hundred, repeat = PARTS["bias"](Rows(*map(rest, seconds), seconds=seconds), WHITE)
    expected = bias_figures(seconds[0.0], 0.5 * NORTH_DPH, WHITE)
    assert (bias.name, bias.value) == ("bias", pytest.approx(seconds[0.0].mean() - 0.5 * NORTH_DPH, rel=1e-6))
    assert (ten.value, hundred.value) == (expected.stability_10s_dph.value, expected.stability_100s_dph.value)
    assert ten.name.endswith("10 s averages") and hundred.name.endswith("100 s averages")
    means = [own.mean() for own in seconds.values()]
    noise = 0.003**2 / (600.0 / 3600.0)
    assert repeat.value == pytest.approx(math.sqrt(np.var(means, ddof=1) - noise), rel=1e-6)
    assert "3 power-ons" in repeat.source
    assert len(PARTS["bias"](Rows(rest(0.0), seconds=seconds), WHITE)) == 3
    two = PARTS["bias"](Rows(rest(0.0), rest(700.0), seconds=seconds), WHITE)
    assert "2 power-ons" in two[-1].source
    with pytest.raises(ConfigurationError, match="noise is not known"):
        PARTS["bias"](Rows(rest(0.0), seconds=seconds), None)


def test_a_warm_up_is_the_first_one_and_ends_within_three_times_the_first_bias_stability():
    rng = np.random.default_rng(2)
    step = np.where(np.arange(1200) < 300, 2.0, 0.0)
    seconds = {0.0: step + 9.0, 5000.0: np.zeros(1200), 2000.0: 9.0 + rng.normal(0.0, 0.1, 900),
               7000.0: 9.0 + rng.normal(0.0, 900.0, 900)}  # fmt: skip
    rows = [
        rest(0.0, 1200.0, "warm_up"),
        rest(5000.0, 1200.0, "warm_up"),
        rest(2000.0, 900.0),
        rest(7000.0, 900.0),
    ]
    (found,) = PARTS["warm-up time"](
        Rows(*rows, seconds=seconds), NoiseCoefficients(0.0, 1e-4, 0.0, 0.0, 0.0)
    )
    tolerance = 3.0 * np.std(seconds[2000.0].reshape(9, 100).mean(axis=1), ddof=1)
    assert (found.value, found.low, found.high, found.unit) == (300.0, 250.0, 350.0, "s")
    assert found.source.endswith(f"to {tolerance:.3g} deg/h") and found.seen


def test_a_unit_that_is_warm_from_the_first_second_has_no_time_below_zero():
    found = warm_up_time_s(np.full(800, 3.0), 0.1, NoiseCoefficients(0.0, 1e-6, 0.0, 0.0, 0.0))
    assert (found.value, found.low, found.high, found.seen) == (0.0, 0.0, 50.0, False)
    with pytest.raises(ConfigurationError, match="no warm-up time") as refused:
        warm_up_time_s(np.full(399, 3.0), 0.1, WHITE)
    assert refused.value.found.startswith("3 blocks of 100 s, 0 of them")
    with pytest.raises(ConfigurationError, match="no warm-up time") as refused:
        warm_up_time_s(np.concatenate((np.full(400, 3.0), np.full(200, np.nan))), 0.1, WHITE)
    assert refused.value.found == "6 blocks of 100 s, 2 of them without data"
    with pytest.raises(ConfigurationError, match="still warming up") as refused:
        warm_up_time_s(np.repeat([8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 0.0], 100), 0.9, WHITE)
    assert refused.value.found == "a course of 8 deg/h"


def test_a_misalignment_is_the_arc_sine_of_the_output_over_the_rate_of_the_table():
    """Two senses of turn with a bias of 0.01 deg/s; the axis leans by 0.3 deg."""
    lean = math.sin(math.radians(0.3))
    rows = [
        rest(1000.0 * k, test="misalignment", rate_dps=rate) for k, rate in enumerate((50.0, -50.0, 10.0))
    ]
    means = {row.start_s: 0.01 + 1.01 * row.rate_dps * lean for row in rows}
    found, raised = PARTS["misalignment"](Rows(*rows, means=means), WHITE)
    assert (raised.value, raised.low, raised.high) == (found.value, found.low, found.high)
    assert found.value == pytest.approx(0.3, rel=1e-9) and found.unit == "deg" and found.seen
    # white noise of N makes means of 600 s scatter by N sqrt(6) deg/h
    rates = 1.01 * np.array([50.0, -50.0, 10.0])
    error = 0.003 * math.sqrt(6.0) / 3600.0 / np.linalg.norm(rates - rates.mean())
    half = math.degrees(1.96 * error / math.cos(math.radians(0.3)))
    assert (found.high - found.value, found.value - found.low) == pytest.approx((half, half), rel=0.1)
    over = {start: 3.0 * mean / lean for start, mean in means.items()}
    most, _ = PARTS["misalignment"](Rows(*rows, means=over), WHITE)
    assert (most.low, most.value, most.high) == (90.0, 90.0, 90.0)
    least = {start: -mean for start, mean in over.items()}
    assert PARTS["misalignment"](Rows(*rows, means=least), WHITE)[0].value == -90.0
    with pytest.raises(ConfigurationError, match="one side only"):
        PARTS["misalignment"](Rows(*rows[:1], means=means), WHITE)


class Steps(Rows):
    def output_dph(self, row):
        return np.full(600, self.of["outputs"][row.start_s])


@pytest.mark.parametrize("rows", [3, 4, 5, 6])
def test_an_input_that_a_stopped_run_did_not_take_away_again_does_not_count(rows):
    """Zero, input, zero, input, zero: of 0.4 deg/h all of it, then half of it, on a drift of 1 deg/h an hour."""
    inputs, answers = (0.0, 0.4, 0.0, 0.4, 0.0, 0.4), (0.0, 0.4, 0.0, 0.2, 0.0, 9.0)
    steps = [rest(3600.0 * k, test="threshold", step=0, input_dph=-size) for k, size in enumerate(inputs)]
    outputs = {row.start_s: -answer + k for k, (row, answer) in enumerate(zip(steps, answers, strict=True))}
    seen = []
    original = figures_parts.threshold

    def noted(given):
        seen.extend(given)
        return original(given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures_parts, "threshold", noted)
        PARTS["threshold"](Steps(*steps[:rows], outputs=outputs), WHITE)
    (step,) = seen
    assert step.input_dph == -0.4
    assert step.output_dph == pytest.approx(-0.4 if rows < 5 else -0.3)


def turned_over(*rolls_deg, fixture_deg=0.2, to_next_deg=-0.05, to_last_deg=0.03):
    """Return rows and means of a unit turned about its axis in a fixture that raises it.

    Turned right-handed by r the next axis points sin(r) upwards and the last one cos(r), as a drawing shows.
    """
    upwards = {0.0: (0.0, 1.0), 90.0: (1.0, 0.0), 180.0: (0.0, -1.0), 270.0: (-1.0, 0.0)}
    rows, means = [], {}
    for number, roll in enumerate(rolls_deg):
        next_up, last_up = upwards[roll]
        sine = sum(
            math.sin(math.radians(angle)) * part
            for angle, part in ((fixture_deg, 1.0), (to_next_deg, next_up), (to_last_deg, last_up))
        )
        for side, rate in enumerate((50.0, -50.0)):
            rows.append(rest(1000.0 * (2 * number + side), test="misalignment", rate_dps=rate, roll_deg=roll))
            means[rows[-1].start_s] = 0.01 + 1.01 * rate * sine
    return Rows(*rows, means=means)


def test_turned_over_in_its_fixture_a_unit_shows_its_own_misalignment():
    """Both components without the fixture's 0.2 deg; the noise of half a difference is a slope's over sqrt(2)."""
    found = {each.name: each for each in PARTS["misalignment"](turned_over(0.0, 180.0, 90.0, 270.0), WHITE)}
    along, across = (f"input-axis misalignment, component {way} the table" for way in ("along", "across"))
    raised = "input-axis elevation, unit in its fixture"
    assert set(found) == {along, across, raised}
    assert found[along].value == pytest.approx(0.03, rel=1e-6) and found[across].value == pytest.approx(
        -0.05, rel=1e-6
    )
    assert found[raised].value == pytest.approx(0.23, rel=1e-5)
    halves = [found[name].high - found[name].value for name in (along, across, raised)]
    assert halves == pytest.approx([halves[2] / math.sqrt(2.0)] * 2 + [halves[2]], rel=0.1)
    assert all("4 positions" in found[name].source for name in (along, across))
    half = {each.name: each.value for each in PARTS["misalignment"](turned_over(0.0, 180.0, 90.0), WHITE)}
    assert set(half) == {along, raised} and half[along] == pytest.approx(0.03, rel=1e-6)
    one = {each.name: each.value for each in PARTS["misalignment"](turned_over(0.0), WHITE)}
    assert one[along] == one[raised] == pytest.approx(0.23, rel=1e-5)


def test_a_scale_factor_is_of_sequences_kept_apart_at_the_tables_own_rates():
    nominal = [0.0, 10.0, 20.0, 10.0, 0.0, -10.0, -20.0, -10.0]
    rows = [rest(1000.0 * (8 * s + k), test="scale_factor", rate_dps=rate, sequence=s + 1)
            for s in range(2) for k, rate in enumerate(nominal)]  # fmt: skip
    means = {row.start_s: (2.0 if row.sequence == 1 else 2.002) * 1.01 * row.rate_dps + 0.3 for row in rows}
    quiet = NoiseCoefficients(0.0, 1e-6, 0.0, 0.0, 0.0)
    found = {each.name: each for each in PARTS["scale factor"](Rows(*rows, means=means), quiet)}
    assert list(found) == [
        "scale factor",
        "scale-factor nonlinearity",
        "scale-factor asymmetry",
        "scale-factor repeatability",
        "scale-factor hysteresis, rising and falling",
    ]
    assert (found["scale factor"].value, found["scale factor"].unit) == (pytest.approx(2.001), "")
    assert found["scale-factor repeatability"].value == pytest.approx(
        1e6 * 0.002 / math.sqrt(2) / 2.001, rel=1e-3
    )
    assert found["scale-factor repeatability"].unit == "ppm"
    for name in ("nonlinearity", "asymmetry", "hysteresis, rising and falling"):
        assert found[f"scale-factor {name}"].value == pytest.approx(0.0, abs=0.01)
    alone = PARTS["scale factor"](Rows(*rows[:8], means=means), quiet)
    assert "scale-factor repeatability" not in [each.name for each in alone] and alone[
        0
    ].value == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("rates", "output", "said"),
    [
        ([0.0, 5.0, 5.0], [0.0, 1.0, 1.0], "2 different rates, 0 outputs missing"),
        ([0.0, 5.0, 9.0], [0.0, 1.0], "3 different rates, 0 outputs missing"),
        ([0.0, 5.0, 9.0], [0.0, 1.0, 2.0, 3.0], "3 different rates, 0 outputs missing"),
        ([0.0, 5.0, 9.0, 9.0], [0.0, math.nan, 2.0, math.inf], "3 different rates, 2 outputs missing"),
    ],
)
def test_a_line_needs_three_rates_with_an_output_each(rates, output, said):
    with pytest.raises(ConfigurationError, match="give no scale factor") as refused:
        fit_rate_sequence(rates, output)
    assert refused.value.found == said


def test_a_line_through_three_rates_is_numpys():
    found = fit_rate_sequence([-3.0, 1.0, 7.0], [5.0, 1.0, 2.0])
    slope, offset = np.polyfit([-3.0, 1.0, 7.0], [5.0, 1.0, 2.0], 1)
    assert (found.scale_factor, found.offset) == pytest.approx((slope, offset))
    assert found.residual == pytest.approx(
        [5.0 + 3.0 * slope - offset, 1.0 - slope - offset, 2.0 - 7.0 * slope - offset]
    )


def test_noise_is_of_the_first_interval_and_a_minimum_that_of_the_fitted_curve():
    rng = np.random.default_rng(3)
    seconds = {
        0.0: rng.normal(0.0, 1.0, 20_000) + np.cumsum(rng.normal(0.0, 0.02, 20_000)),
        9.0: np.zeros(400),
    }
    rows = [rest(0.0, 1.0, "noise"), rest(9.0, 1.0, "noise")]
    allan, noise = noise_of(Rows(*rows, seconds=seconds, rate_hz=4.0), "noise")
    assert (allan.rate_hz, allan.record_s) == (4.0, 5000.0)
    assert allan.deviation.tolist() == allan_deviation(seconds[0.0], 4.0).deviation.tolist()
    found = noise_figures(allan, noise)
    assert [each.name for each in found] == [
        "quantisation",
        "angle random walk",
        "bias instability",
        "rate random walk",
        "rate ramp",
        "Allan deviation, minimum",
    ]
    assert [each.unit for each in found] == [
        "deg",
        "deg/sqrt(h)",
        "deg/h",
        "deg/h/sqrt(h)",
        "deg/h/h",
        "deg/h",
    ]
    assert found[1].value == pytest.approx(math.sqrt(0.25) / 60.0, rel=0.03) and found[1].seen
    assert found[1].source.endswith("at 4 Hz") and not found[0].seen and found[0].low == 0.0
    assert [each.value for each in found[:5]] == [
        getattr(noise.coefficients, name) for name in vars(noise.coefficients)
    ]
    used = np.flatnonzero(allan.tau_s <= 500.0)
    least = min(used, key=lambda k: float(noise.for_errors.deviation(allan.tau_s[k])))
    low, high = confidence_interval(allan)
    assert (found[5].value, found[5].low, found[5].high) == (allan.deviation[least], low[least], high[least])
    assert f"averages of {allan.tau_s[least]:.4g} s" in found[5].source


def test_an_allan_curve_of_one_averaging_time_is_taken_for_white():
    one = SimpleNamespace(tau_s=np.array([1.0]), deviation=np.array([2.0]))
    assert noise_exponents(one).tolist() == [0]
    assert noise_exponents(SimpleNamespace(tau_s=np.empty(0), deviation=np.empty(0))).tolist() == []
    drift = SimpleNamespace(tau_s=np.array([1.0, 2.0, 4.0]), deviation=np.array([1.0, 2.0, 4.0]))
    assert noise_exponents(drift).tolist() == [-2, -2, -2]
    ramp = SimpleNamespace(tau_s=np.array([1.0, 2.0]), deviation=np.array([4.0, 2.0]))
    assert noise_exponents(ramp).tolist() == [2, 2]


def test_a_coefficient_whose_scatter_grows_as_fast_as_itself_has_no_upper_end():
    """Var(estimate | x) = a + q x^2: the ends are where z times its root is the distance; none for z^2 q >= 1."""
    basis = np.eye(5) + 0.0

    def scatter(q):
        return SimpleNamespace(basis=basis, variance_of=lambda weights, squares, index: (0.04, 0.0, q))

    variance, z = np.array([1.0, 2.0, 3.0, 4.0, -0.5]), 2.0
    for q in (0.0, 0.1, 0.24):
        low, high = _intervals(scatter(q), np.eye(5), variance, np.ones(5), z)
        for k in range(4):
            own = variance[k]
            roots = np.roots([1.0 - z * z * q, -2.0 * own, own * own - z * z * 0.04])
            assert (low[k], high[k]) == pytest.approx((max(roots.min(), 0.0), roots.max()))
        assert low[4] == 0.0 and high[4] == pytest.approx(z * 0.2 / math.sqrt(1.0 - z * z * q))
    # the same where the variance grows with the coefficient, too
    grows = SimpleNamespace(basis=basis, variance_of=lambda weights, squares, index: (0.04, 0.03, 0.1))
    low, high = _intervals(grows, np.eye(5), variance, np.ones(5), z)
    for k in range(4):
        own = variance[k]
        roots = np.roots([1.0 - z * z * 0.1, -2.0 * own - z * z * 0.03, own * own - z * z * 0.04])
        assert (low[k], high[k]) == pytest.approx((max(roots.min(), 0.0), roots.max()))
    for q in (0.25, 0.3, 0.6):
        low, high = _intervals(scatter(q), np.eye(5), variance, np.ones(5), z)
        assert np.isinf(high).all()
        distance, error = (variance - low)[:4], z * np.sqrt(0.04 + q * low[:4] ** 2)
        assert distance == pytest.approx(error)

    # all scatter by the walk that is given; for the ramp a walk that is a standard error larger
    def by_walk(weights, squares, index):
        return 0.04 + squares[3], 0.0, 0.0

    squares = np.array([0.0, 0.0, 0.0, 0.05, 0.0])
    low, high = _intervals(SimpleNamespace(basis=basis, variance_of=by_walk), np.eye(5), variance, squares, z)
    assert high[:4] - variance[:4] == pytest.approx(np.full(4, z * 0.3))
    assert high[4] == pytest.approx(z * math.sqrt(0.09 + 0.3))


def record_of(time_s, rate, valid=None):
    table = {
        "time_ns": np.rint(1e9 * np.asarray(time_s)).astype(np.int64),
        "rate_dps": np.asarray(rate) / 3600.0,
        "valid": np.ones(len(rate), np.int8) if valid is None else np.asarray(valid, np.int8),
    }
    return Record(SimpleNamespace(gyro=lambda name, columns, start, end: table), "g", 0.0)


@pytest.mark.parametrize("count", [1200, 1201, 1210])
def test_of_too_many_samples_neighbours_are_averaged(monkeypatch, count):
    """At most 400 are kept: threes of 1200, and fours of 1201; what fills no group is left out."""
    monkeypatch.setattr(_record, "MOST_SAMPLES", 400)
    together = math.ceil(count / 400)
    values = np.arange(float(count)) ** 1.5
    samples, rate_hz = record_of(7.0 + 0.01 * np.arange(count), values).samples_dph(rest(0.0))
    kept = count // together
    assert rate_hz == pytest.approx(100.0 / together) and len(samples) == kept
    assert samples == pytest.approx(values[: kept * together].reshape(kept, together).mean(axis=1))


def test_stamps_that_come_twice_lose_nothing_and_a_gap_is_filled():
    time_s = 0.1 * np.delete(np.arange(1000), [500, 501])
    time_s[[300, 700]] = time_s[[299, 699]]
    values = np.delete(np.arange(1000.0), [500, 501])
    samples, rate_hz = record_of(time_s, values).samples_dph(rest(0.0))
    assert len(samples) >= 1000 and rate_hz == pytest.approx(10.0, rel=0.003)
    assert samples[[100, 250, 500]] == pytest.approx([100.0, 250.0, 500.0], abs=1.5)
    few = record_of([0.2, 0.8], [3.0, 5.0]).samples_dph(rest(0.0, 1.0))
    assert (few[0].tolist(), few[1]) == ([pytest.approx(4.0)], 1.0)


def test_what_a_record_lacks_is_missing_and_a_bias_record_stands_in_for_that_of_noise():
    rng = np.random.default_rng(5)
    seconds = {0.0: 9.0 + rng.normal(0.0, 0.5, 3000), 5000.0: rng.normal(0.0, 2.0, 3000)}
    both = Rows(rest(0.0, 3000.0), rest(5000.0, 3000.0, "noise"), seconds=seconds, rate_hz=1.0)
    figures, missing, allan, noise = figures_of_record(both)
    assert noise.coefficients.angle_random_walk_deg_sqrt_h == pytest.approx(2.0 / 60.0, rel=0.05)
    assert [each.name for each in figures][:3] == [each.name for each in PARTS["bias"](both, WHITE)]
    assert len(figures) == 9 and allan.record_s == 3000.0
    names = list(PARTS)[1:]
    assert [what for what, _ in missing] == names and all("no " in why for _, why in missing)
    of_bias, missing, allan, noise = figures_of_record(Rows(rest(0.0, 3000.0), seconds=seconds, rate_hz=1.0))
    assert [what for what, _ in missing] == ["noise", *names] and allan is None and noise is None
    fitted = fit_noise(allan_deviation(seconds[0.0], 1.0)).for_errors
    assert of_bias[0].high == PARTS["bias"](both, fitted)[0].high and len(of_bias) == 3


def test_a_known_error_of_temperature_counts_as_uncertainty_where_the_sign_is_not_known():
    """The sensitivity is a largest magnitude; the chamber shows 0.3 K too much, U = 0.8 K with k = 2."""
    bench = BenchErrors([certificate("unit_temp_c", 0.8, "normal", 0.3)])
    plan = Rows(rest(0.0))
    for name in ("bias", "scale-factor"):
        warm = Figure(f"{name} temperature sensitivity", 0.5, "u", "s", 0.4, 0.6)
        one = Figure(name.replace("-", " "), 2.0, "u", "s", 1.9, 2.1)
        found = with_budgets([one, warm], plan, bench)[0].budget.contributions
        (part,) = [each for each in found if each.source == "unit_temp_c"]
        assert (part.standard, part.estimate, part.origin) == (pytest.approx(0.5), 0.0, "drawn")
    known = bench.of("unit_temp_c", 3.0)
    assert (known.standard, known.estimate, known.sensitivity) == (0.4, 0.3, 3.0)
    apart = bench.of("unit_temp_c", 3.0, difference=True)
    assert (apart.standard, apart.estimate) == (pytest.approx(0.4 * math.sqrt(2.0)), 0.0)


def test_a_figure_is_shown_with_the_digits_of_its_interval():
    known = Figure("f", 1234.5678, "deg/h", "s", 1233.0, 1236.0)
    assert known.shown() == {"f": "1234.57 deg/h", "95 %": "1233 .. 1236"}
    assert Figure("f", 2.0, "", "s", None, 3.0).shown() == {"f": "2"}
    assert known.digits == 5 and known.bound is None
    # two digits of a half of 1.5, of 0.15, of 15 and of 1500, never fewer than two nor more than twelve
    digits = [Figure("f", 1234.5678, "d", "s", -half, half).digits for half in (0.15, 15.0, 1500.0, 1e-12)]
    assert digits == [6, 4, 2, 12]
    assert [Figure("f", value, unit, "s", low, high).digits for value, unit, low, high in (
        (0.0, "d", -1.0, 1.0), (0.0, "", -1.0, 1.0), (5.0, "d", None, None), (5.0, "", 5.0, 5.0),
        (5.0, "d", -math.inf, math.inf),
    )] == [4, 8, 4, 8, 4]  # fmt: skip
    unseen = Figure("f", 1.0, "d", "s", -4.0, 3.0, seen=False)
    assert unseen.bound == 4.0 and unseen.standard_error == pytest.approx(3.5 / norm.ppf(0.975), rel=1e-6)
    assert Figure("f", 1.0, "d", "s", None, 3.0, seen=False).bound is None
    assert Figure("f", 1.0, "d", "s", 0.5, None).standard_error == 0.0


def test_a_fit_needs_five_averaging_times_up_to_a_tenth_of_the_record():
    allan = allan_deviation(np.random.default_rng(1).normal(size=1000), 1.0, [1.0, 2.0, 5.0, 10.0, 100.0])
    assert fit_noise(allan).level == 0.95
    few = allan_deviation(np.random.default_rng(1).normal(size=1000), 1.0, [1.0, 2.0, 5.0, 10.0, 101.0])
    with pytest.raises(ConfigurationError, match="too few averaging times") as refused:
        fit_noise(few)
    assert refused.value.found == "4 up to a tenth of the record of 1000 s"


def test_averaging_times_that_a_record_has_not_are_told_with_those_that_it_has():
    for times in ([0.1], [63.0], []):
        with pytest.raises(ConfigurationError, match="outside the record") as refused:
            allan_deviation(np.random.default_rng(1).normal(size=501), 4.0, times)
        assert refused.value.expected == "0.25..62.5 s"
    assert allan_deviation(np.arange(501.0), 4.0, [0.25, 62.5, 0.26]).tau_s.tolist() == [0.25, 62.5]
