"""Grids, intervals and settings of the diagnosis as they are meant: known numbers, on both sides of each."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import Noise
from bench.analysis.gap._aliases import in_rows
from bench.analysis.gap._cells import BANDS, band_slices
from bench.analysis.gap._designs import designs_for, usual_designs
from bench.analysis.gap._examination import SHARES, case_kinds
from bench.analysis.gap._generic import INPUTS, free_curves
from bench.analysis.gap._learned_forms import candidates_for
from bench.analysis.gap._noise import FLICKER_TIMES_S, Periodogram, fit_noise, periodogram, unit_spectra
from bench.analysis.gap._refine import _moved, _spacing
from bench.analysis.gap._stochastic import _starts
from bench.analysis.gap._where import REGIMES
from bench.record.benchfile import load_bench_file
from simulators.effects import Input, Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.safety.test_takeover import DEMO

RNG = np.random.default_rng(1)
COLD = made_run("cold", stimulus(3000), RNG)
TURNING = made_run("turning", stimulus(3000, rate_dps=5.0), RNG)
EDGES_S = (3500.0, 1400.0, 560.0, 300.0, 150.0, 75.0, 38.0, 20.0, 10.0, 5.0)


@pytest.mark.parametrize(("n", "period_s"), [(700_000, 1.0), (70_000, 0.25), (20_003, 2.0)])
def test_bands_end_at_their_periods(n, period_s):
    """Coefficient k has a period of 2 n / k samples; those of the very edge belong to the slower band."""
    parts = band_slices(n, period_s)
    assert len(parts) == len(BANDS) == 11
    periods_s = 2.0 * n * period_s / np.arange(1, n)
    band = np.searchsorted(-np.array(EDGES_S), -periods_s, side="left")
    assert [part.stop - part.start for part in parts] == np.bincount(band, minlength=11).tolist()
    assert parts[0].start == 0 and parts[-1].stop == n - 1
    assert all(one.stop == other.start for one, other in pairwise(parts))


def test_bands_are_called_after_their_periods():
    """In whole minutes from 5 min on, rounded down."""

    def told(low_s, high_s):
        if low_s >= 300.0:
            return f"{low_s // 60:.0f}..{high_s // 60:.0f} min"
        return f"{low_s:g}..{high_s:g} s"

    middle = [told(low, high) for high, low in pairwise(EDGES_S)]
    assert ("over 58 min", *middle, "under 5 s") == BANDS and EDGES_S[0] // 60 == 58


@pytest.mark.parametrize(
    ("of", "edges"),
    [
        ("T_in", (-60.0, -50.0, -40.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)),
        ("dT_in/dt", (-20.0, -8.0, -4.0, -2.0, -1.0, -0.3, 0.3, 1.0, 2.0, 4.0, 8.0, 20.0)),
        ("table rate", (-500.0, -60.0, -30.0, -7.0, -0.5, 0.5, 7.0, 30.0, 60.0, 500.0)),
        (
            "input rate",
            (-2e6, -2e5, -2e4, -1e3, -12.0, -6.0, -2.0, 2.0, 6.0, 12.0, 1e3, 2e4, 2e5, 2e6),
        ),
        ("table angle", tuple(30.0 * k for k in range(13))),
    ],
)  # fmt: skip
def test_an_input_is_cut_at_these_values(of, edges):
    """A value of the very edge belongs to the interval above; what is beyond the ends to the last ones."""
    (regime,) = (each for each in REGIMES if each.of == of)
    for k, edge in enumerate(edges):
        for value, row in ((edge, k), (np.nextafter(edge, -np.inf), k - 1)):
            made = replace(regime, values=lambda s, value=value: np.array([value]))
            run = SimpleNamespace(stimulus=None)
            assert made.rows(run).tolist() == [min(max(row, 0), len(edges) - 2)]
    assert len(regime.edges) == len(edges)


def test_inputs_of_intervals_are_in_their_units():
    s = TURNING.stimulus
    own = {regime.of: (regime.unit, regime.values(s)) for regime in REGIMES}
    middle = (10.0 + 5.0 * (np.arange(3000) + 0.5)) % 360.0
    for of, unit, values in (
        ("T_in", "degC", s.warm_k + 25.0),
        ("dT_in/dt", "K/min", s.warming_k_per_min),
        ("table rate", "deg/s", np.full(3000, 5.0)),
        ("input rate", "deg/h", s.input_rate_dph),
        ("table angle", "deg", middle),
    ):
        assert own[of][0] == unit and own[of][1] == pytest.approx(values, abs=1e-6)


# learned forms and free curves


def shapes_of(name, *runs):
    return [each for each in candidates_for(list(runs)) if each.form.name == name]


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("scale factor over T_in", (17,)),
        ("bias over dT_in/dt", (17,)),
        ("scale factor over dT_in/dt", (9,)),
        ("bias over T_in and dT_in/dt", (17, 9)),
        ("bias over T_out and dT_in/dt", (17, 9)),
        ("bias over T_in - T_out", (17,)),
        ("scale factor over T_in - T_out", (9,)),
        ("bias over T_in and T_in - T_out", (13, 9)),
        ("response to changes of rate", (61,)),
    ],
)
def test_learned_curves_have_so_many_nodes(name, counts):
    found = shapes_of(name, TURNING)
    assert found
    for each in found:
        assert tuple(len(nodes) for nodes in each.nodes) == counts
        # a curve is zero at its first node, as the run's bias is free
        parameters = len(each.variant.effect.parameters)
        assert parameters in {math.prod(counts), math.prod(counts) - 1}
    if name.startswith("response"):
        assert found[0].nodes[0].tolist() == [2.0 * k for k in range(61)]


@pytest.mark.parametrize(
    ("span_k", "count"), [(10.1, 8), (12.1, 8), (13.4, 8), (13.6, 9), (60.1, 40), (96.1, 64), (120.0, 64)]
)
def test_nodes_are_eight_to_64_a_kelvin_and_a_half_apart(span_k, count):
    s = COLD.stimulus
    t_in = 25.0 - span_k * (s.t_in_c.max() - s.t_in_c) / np.ptp(s.t_in_c)
    run = replace(COLD, stimulus=replace(s, t_in_c=t_in))
    for each in shapes_of("bias over T_in", run):
        assert len(each.nodes[0]) == count


@pytest.mark.parametrize(
    ("name", "late_s"),
    [
        ("bias over T_in", [0.0, 60.0, 400.0]),
        ("bias over T_out", [0.0, 60.0, 400.0]),
        ("bias over dT_in/dt", [0.0, 60.0, 400.0]),
        ("bias over T_in - T_out", [0.0, 60.0, 400.0]),
        ("scale factor over T_in", [0.0, 400.0]),
        ("scale factor over dT_in/dt", [0.0]),
        ("scale factor over T_in - T_out", [0.0]),
        ("bias over T_in and dT_in/dt", [60.0]),
        ("bias over T_out and dT_in/dt", [60.0]),
        ("bias over T_in and T_in - T_out", [0.0]),
    ],
)
def test_learned_curves_follow_their_input_so_late(name, late_s):
    """Values over the nodes are those of the input so many seconds ago."""
    found = shapes_of(name, TURNING)
    assert [each.variant.shape.get("late_s", 0.0) for each in found] == late_s
    if name == "bias over T_in":
        s = TURNING.stimulus
        for each, own_s in zip(found, late_s, strict=True):
            size = (each.nodes[0] - each.nodes[0][0])[1:]
            expected = s.lagged(s.warm_k, own_s) - each.nodes[0][0]
            assert size @ each.variant.columns(s) == pytest.approx(expected, abs=1e-6)


LAGS_S, SETTLING_S = [60.0, 200.0, 600.0, 2000.0, 6000.0], [100.0, 300.0, 1000.0, 3000.0, 10000.0]
TILTED = replace(TURNING, stimulus=replace(TURNING.stimulus, elevation_deg=np.linspace(60.0, 90.0, 3000)))


@pytest.mark.parametrize(
    ("name", "at", "second"),
    [
        ("time since power-on", SETTLING_S, []),
        ("scale factor since power-on", SETTLING_S, []),
        ("memory of T_in", LAGS_S, []),
        ("memory of T_out", LAGS_S, []),
        ("scale factor's memory of T_in", LAGS_S, []),
        ("memory of temperature changes", LAGS_S[:4], []),
        ("loops of T_in", [2.0, 5.0, 10.0, 20.0, 35.0], []),
        ("rate over table angle", [k for k in range(1, 37) for _ in "cs"], []),
        ("bias over table angle", [k for k in range(1, 13) for _ in "cs"], []),
        ("heat of turning", [30.0, 100.0, 300.0, 1000.0], []),
        ("bias over direction", [0.0, 1.0, 2.0, 3.0], []),
        ("bias over direction and T_in", [0.0, 1.0, 2.0, 3.0], []),
        ("memory of direction", [30.0, 100.0, 300.0], [0.0, 1.0, 2.0]),
    ],
)
def test_learned_lags_and_orders_are_these(name, at, second):
    (found,) = shapes_of(name, TILTED)
    values = list(found.variant.shape.values())
    assert [float(each) for each in values[: len(at)]] == at and values[
        len(at) : len(at) + len(second)
    ] == second
    assert len(found.variant.effect.parameters) == len(at) * max(len(second), 1)


def test_a_bias_over_the_rate_is_learned_at_parts_of_the_fastest():
    (found,) = shapes_of("bias over rate", TURNING)
    most = np.abs(TURNING.stimulus.axis_rate_dps).max()
    side = np.array([0.005, 0.02, 0.06, 0.15, 0.3, 0.5, 0.7, 0.85, 1.0]) * most
    values = [float(each) for each in found.variant.shape.values()]
    assert values[:19] == pytest.approx([*-side[::-1], 0.0, *side])


@pytest.mark.parametrize(("rate_dps", "turns"), [(0.99, False), (1.01, True), (-1.01, True)])
def test_a_table_turns_from_a_degree_a_second_on(rate_dps, turns):
    """About a horizontal axis, where the Earth adds little; free curves and learned forms alike."""
    s = stimulus(600, rate_dps=rate_dps)
    still = s.axis_rate_dps - s.table_rate_dps
    s = replace(s, angle_deg=np.concatenate(([0.0], np.cumsum(rate_dps - still))))
    run = made_run("r", s, RNG)
    assert bool(shapes_of("heat of turning", run)) is turns
    names = {each.effect.name for each in free_curves([run])}
    assert ("free curve: rate over table angle" in names) is turns


@pytest.mark.parametrize(
    ("over", "span"),
    [(Input.T_IN, 10.0), (Input.T_OUT, 10.0), (Input.WARMING, 0.5), (Input.GRADIENT, 1.0), (Input.TIME, 1.0)],
)
def test_curves_are_drawn_over_inputs_that_change_by_so_much(over, span):
    assert INPUTS[over].least_span == span


def test_free_curves_are_drawn_coarse_and_fine_and_late():
    """Numbers of nodes, the first without a parameter, and lags; five of them are fine over T_in alone."""
    found = {}
    for variant in free_curves([COLD]):
        own = found.setdefault(variant.effect.name.removeprefix("free curve: "), {})
        own.setdefault(len(variant.effect.nodes), []).append(variant.shape.get("lag_s"))
    usual = {k: [0.0, 150.0, 400.0] for k in (1, 2, 4, 8)}
    assert found["bias over T_in"] == usual | {17: [0.0, 250.0]}
    assert found["bias over T_out"] == found["bias over dT_in/dt"] == found["bias over T_in - T_out"] == usual
    assert found["bias over time since power-on"] == {k: [0.0] for k in (1, 2, 4, 8)}
    local = [each for each in free_curves([COLD]) if each.effect.local]
    assert {each.shape["width"] for each in local} == {2.0, 5.0}
    assert {each.shape["lag_s"] for each in local} == {0.0, 250.0}
    inputs, _ = local[0].effect.drawn(local[0].shape, (1.0, 0.0))
    assert inputs == pytest.approx(local[0].shape["at"] + local[0].shape["width"] * np.arange(-4.0, 4.5, 0.5))


# runs that a bench could make


SHORT = {"temperatures": False, "noise_h": 0.5, "bias_min": 10.0, "power_cycles": 0, "warm_up_min": 10.0}
SHORT |= {"step_dwell_s": 60.0, "east_dwell_s": 60.0, "rate_dwell_s": 60.0, "sequences": 2}
SHORT |= {"misalignment": "as_mounted"}


def test_usual_procedures_have_these_settings():
    found = usual_designs(39.1)
    assert [(each.procedure, dict(each.settings)) for each in found] == [
        ("zero-bias-cold-shock", {"soak_min": 75.0, "hold_min": 30.0}),
        ("scale-factor-cold-shock", {"rate_dps": 20.0, "soak_min": 75.0, "hold_min": 30.0}),
        (
            "thermal-ramp",
            {
                "low_c": -40.0,
                "high_c": 60.0,
                "ramp_k_per_min": 1.0 / 3.0,
                "dwell_min": 30.0,
                "both_directions": False,
            },
        ),
        ("constant-rotation", {"rate_dps": 20.0, "turns": 400.0, "reversals": 0}),
        ("standard-test", SHORT | {"max_rate_dps": 100.0, "rates_per_sign": 11, "sequences": 2}),
    ]
    lengths = [[len(s) for s in each.stimuli.values()] for each in found]
    shock = 60 * 30 + 350 + 60 * 75 + 350 + 60 * 80
    rates = 2 * (1 + 2 * 22) * 60  # zero, up and back on both sides, twice
    assert lengths == [[shock], [shock] * 3, [60 * (60 + 30 + 300 + 30) + 1300], [7200], [rates]]
    assert [next(iter(each.stimuli.values())).elevation_deg[0] for each in found] == [
        0.0,
        90.0,
        0.0,
        0.0,
        90.0,
    ]
    (rates,) = found[-1].stimuli.values()
    told = rates.table_rate_dps[30::60]
    up = [100.0 * k / 11.0 for k in range(12)]
    there_and_back = [*up, *up[-2::-1]]
    assert told == pytest.approx(2 * [*there_and_back, *(-rate for rate in there_and_back[1:])])


def test_a_shock_goes_down_and_up_at_twelve_kelvin_a_minute():
    """The case, a minute behind, is at its coldest by a thousandth of a kelvin; nothing of 25 degC before."""
    (s,) = usual_designs(39.1)[0].stimuli.values()
    air = np.interp(
        s.time_s, [0.0, 1800.0, 2150.0, 6650.0, 7000.0, 11800.0], [25.0, 25.0, -45.0, -45.0, 25.0, 25.0]
    )
    assert s.t_out_c == pytest.approx(s.lagged(air, 60.0), abs=1e-9)
    heat = 6.0 * (1.0 - np.exp(-s.time_s / 1500.0))
    assert s.t_in_c == pytest.approx(s.lagged(s.lagged(s.t_out_c, 300.0), 900.0) + heat, abs=1e-9)


def test_a_benchs_grid_has_depths_soaks_rates_and_lengths():
    """The demonstration bench cannot do what is beyond its limits; all that is left is of this grid."""
    soaks = [(20.0, 10.0), (75.0, 30.0)]
    grid = [("zero-bias-cold-shock", soak, hold) for soak, hold in soaks]
    grid += [("scale-factor-cold-shock", 20.0, soak, hold) for soak, hold in soaks]
    grid += [("thermal-ramp", -40.0, 60.0, 1.0 / 3.0, 30.0, False)]
    grid += [("thermal-ramp", -40.0, 60.0, rate, 10.0, False, 10.0, False) for rate in (1.0 / 3.0, 1.0, 3.0)]
    grid += [
        ("constant-rotation", rate, max(round(10.0 * hours * rate), reversals + 1), reversals)
        for rate in (2.0, 20.0)
        for hours in (0.5, 2.0)
        for reversals in (0, 3)
    ]
    # sequences stands where the usual short test has it
    grid += [
        ("standard-test", *(SHORT | {"sequences": n}).values(), 20.0, k) for k, n in ((11, 2), (6, 2), (3, 1))
    ]
    # one sequence at room temperature and on over temperature, or two at room temperature alone
    ramps = [(1.0, 10.0, 1), (3.0, 10.0, 1), (3.0, 30.0, 3), (10.0, 30.0, 1)]
    grid += [
        ("rates-over-temperature", 20.0, each, 60.0, 1, 10.0, -40.0, 60.0, rate, dwell)
        for rate, dwell, each in ramps
    ]
    grid += [("rates-over-temperature", 20.0, each, 60.0, 2, 10.0, False) for each in (3, 6)]
    file = load_bench_file(DEMO)
    found = [(each.procedure, *each.settings.values()) for each in designs_for(file)]
    assert sorted(found) == sorted(grid)


def test_a_benchs_limits_narrow_ramps_and_widen_rates():
    file = load_bench_file(DEMO)
    limits = {"min_temp_c": -10.0, "max_temp_c": 45.0, "max_rate_dps": 60.0}
    narrow = file.model_copy(update={"limits": file.limits.model_copy(update=limits)})
    found = designs_for(narrow)
    ends = {(d.settings["low_c"], d.settings["high_c"]) for d in found if d.procedure == "thermal-ramp"}
    assert ends == {(-10.0, 45.0)}
    assert not any("shock" in d.procedure for d in found)
    most = {d.settings["max_rate_dps"] for d in found if d.procedure == "standard-test"}
    assert most == {20.0, 60.0}
    assert len({d.key for d in found}) == len(found)


# noise


def test_flicker_is_a_sum_of_nine_processes_times_three_apart():
    assert FLICKER_TIMES_S.tolist() == [1.0, 3.0, 9.0, 27.0, 81.0, 243.0, 729.0, 2187.0, 6561.0]
    frequency = np.array([0.01, 0.3, 0.9])
    found = unit_spectra(frequency, 2.0, Noise(0.01))[1]
    lags = np.arange(-200_000, 200_001)
    for at, value in zip(frequency, found, strict=True):
        each = [float((np.exp(-2.0 * np.abs(lags) / time_s) * np.cos(np.pi * at * lags)).sum())
                for time_s in FLICKER_TIMES_S]  # fmt: skip
        assert value == pytest.approx(math.log(3.0) / math.pi * sum(each), rel=1e-6)


@pytest.mark.parametrize("skip", [0, 1])
def test_the_free_bias_is_in_no_spectrum(skip):
    rows = np.concatenate((np.full((3, 1), 1e6), np.ones((3, 100))), axis=1)
    found = periodogram(rows, 2.0, skip=skip)
    assert found.energy.sum() == pytest.approx(300.0) and found.count.sum() == pytest.approx(300.0)
    assert found.frequency[0] == pytest.approx(1.0 / 101.0) and found.period_s == 2.0


def test_a_spectrum_has_eight_bins_an_octave():
    found = periodogram(np.ones((2, 4097)), 1.0, skip=256)
    assert len(found.count) == 8 * 4 + 1  # coefficient 4096 begins the fifth octave
    first = [k for k in range(256, 4097) if math.floor(8.0 * math.log2(k)) == 64]
    assert found.count[0] == 2 * len(first) and found.frequency[0] == pytest.approx(np.mean(first) / 4097)


@pytest.mark.parametrize("name", ["arw_deg_per_sqrt_h", "bias_instability_dph", "correlated_dph"])
def test_a_noise_of_which_nothing_is_known_but_its_power_has_it(name):
    """One coefficient alone with a loose prior: its power is that of the mean of the squares, to the prior."""
    frequency = np.linspace(0.001, 0.9, 40)
    sheet = replace(Noise(1e-9), correlation_time_s=200.0, correlation_order=2.0, **{name: 0.02})
    power = (
        0.05**2
        * unit_spectra(frequency, 0.5, sheet)[
            ["arw_deg_per_sqrt_h", "bias_instability_dph", "", "", "correlated_dph"].index(name)
        ]
    )
    data = Periodogram(frequency, 1000.0 * power, np.full(40, 1000.0), 0.5)
    found = fit_noise([data], sheet, {name: 10.0}).noise
    assert getattr(found, name) == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "sheet", "starts"),
    [
        ("arw_deg_per_sqrt_h", Noise(0.01), [0.015, 0.04, 0.15]),
        ("bias_instability_dph", Noise(0.01, 0.2), [0.3, 0.8, 3.0]),
        ("bias_instability_dph", Noise(0.01), [0.09, 0.24, 0.9]),
        ("rate_random_walk_dph_per_sqrt_h", Noise(0.01, 0.2), [0.3, 0.8, 3.0]),
        ("rate_random_walk_dph_per_sqrt_h", Noise(0.01, 0.2, 0.4), [0.6, 1.6, 6.0]),
        ("quantum_arcsec", Noise(0.01), [0.36, 1.2, 3.6]),
        ("quantum_arcsec", Noise(0.01, quantum_arcsec=1.0), [2.0, 2.0, 3.6]),
    ],
)
def test_a_raised_coefficient_is_looked_for_from_here(name, sheet, starts):
    assert _starts(sheet, name) == pytest.approx(starts)


# shapes that move, kinds of cases, lines


def shaped(name, **shape):
    own = effect(name)
    return Variant(own, {**own.shapes[0], **shape})


def test_shapes_move_by_the_distance_of_the_grids_points_about_them():
    lags = sorted({each["lag_s"] for each in effect("shupe").shapes})
    assert len(lags) == 5
    for k, lag in enumerate(lags):
        low, high = lags[max(k - 1, 0)], lags[min(k + 1, 4)]
        half = 0.5 if 0 < k < 4 else 1.0
        for off in (-0.1, 0.0, 0.1):
            at = lag + off * (high - lag if off > 0.0 else lag - low)
            assert _spacing(shaped("shupe", lag_s=at)) == {"lag_s": pytest.approx(half * (high - low))}
    for part, expected in ((1.0, 3.0), (0.3, 0.9)):
        moved = _moved(shaped("shupe", lag_s=lags[1]), {"lag_s": 3.0}, part)
        assert moved.shape == {"lag_s": pytest.approx(lags[1] + expected)}
    assert _moved(shaped("shupe", lag_s=lags[1]), {"lag_s": 1e9}, 1.0).shape["lag_s"] == lags[-1]
    assert _moved(shaped("shupe", lag_s=lags[1]), {"lag_s": -1e9}, 1.0).shape["lag_s"] == lags[0]


def test_whole_numbers_and_what_has_one_value_do_not_move():
    assert _spacing(shaped("table_rate_ripple")) == {} and _spacing(shaped("bias_linear")) == {}
    own = effect("table_rate_ripple")
    two = replace(own, shapes=({"order": 3.0}, {"order": 7.0}))
    assert _spacing(Variant(two, {"order": 3.0})) == {}
    one = replace(effect("shupe"), shapes=({"lag_s": 60.0},))
    assert _spacing(Variant(one, {"lag_s": 60.0})) == {}
    spline = next(each for each in free_curves([COLD]) if each.effect.nodes)
    local = next(each for each in free_curves([COLD]) if each.effect.local)
    assert _spacing(spline) == {} and set(_spacing(local)) == {"at", "width", "lag_s"}


def test_an_exams_kinds_are_in_these_shares():
    assert sum(SHARES.values()) == pytest.approx(1.0) and SHARES["null"] == 0.25
    found = case_kinds(100, 5)
    assert {kind: found.count(kind) for kind in SHARES} == {
        kind: round(100 * p) for kind, p in SHARES.items()
    }


@pytest.mark.parametrize(
    ("row_s", "at_hz", "shown_hz"), [(0.02, 24.8, 0.2), (0.25, 1.9, 0.1), (0.125, 3.8, 0.2)]
)
def test_a_line_that_folds_from_just_below_half_the_rate_of_the_rows(row_s, at_hz, shown_hz):
    n = 24_000
    time_s = row_s * np.arange(n)
    rows = np.random.default_rng(3).normal(0.0, 0.01, n) + 0.2 * np.sin(2.0 * np.pi * at_hz * time_s)
    run = replace(COLD, rows_dps=rows, row_s=row_s)
    found = in_rows(shown_hz, [run])
    assert found.frequency_hz == pytest.approx(at_hz, abs=1.0 / (n * row_s))
    assert found.amplitude_dph == pytest.approx(720.0, rel=0.2)
    assert "is an alias" in found.sentence
