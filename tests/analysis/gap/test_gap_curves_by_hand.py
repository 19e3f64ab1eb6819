"""Free curves, learned forms, foretold runs and expected information against closed forms and numpy's own."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, Outlook, Term, outlook
from bench.analysis.gap._describe import _curve_part, _differing_part, _line_part, shaken_part
from bench.analysis.gap._designs import _scale_factor, _stimulus, _zero_bias, other_equipment, usual_designs
from bench.analysis.gap._findings import Cause
from bench.analysis.gap._fit import DIRECTIONS, MISFIT
from bench.analysis.gap._generic import absorbed, free_curves, grid_points
from bench.analysis.gap._information import Foretold, expected_information
from bench.analysis.gap._learn import _ranges
from bench.analysis.gap._learned_forms import candidates_for, span_of
from bench.analysis.gap._lines import SpectralLine
from bench.analysis.gap._outlook import UNKNOWN, _named
from bench.analysis.gap._response import _slow_rates, proposed_variants
from simulators.effects import Input
from tests.analysis.gap.conftest import effect, made_run, stimulus

RNG = np.random.default_rng(1)
COLD = made_run("cold", stimulus(3000), RNG)
TURNING = made_run("turning", stimulus(3000, rate_dps=5.0), RNG)
STILL = made_run("still", stimulus(3000, cold=False), RNG)
PREFIX = "free curve: "


def curves(*runs):
    found = {}
    for variant in free_curves(list(runs)):
        found.setdefault(variant.effect.name.removeprefix(PREFIX), []).append(variant)
    return found


def test_every_point_of_a_free_curves_grid_is_counted():
    for runs in ((COLD,), (TURNING, STILL)):
        for name, variants in curves(*runs).items():
            for variant in variants:
                assert grid_points(variant.effect) == len(variants), name
    assert grid_points(effect("warm_up")) == len(effect("warm_up").shapes)


@pytest.mark.parametrize(
    ("name", "values", "scale"),
    [
        ("bias over T_in", lambda s: s.warm_k, lambda s: 1.0),
        ("bias over dT_in/dt", lambda s: s.warming_k_per_min, lambda s: 1.0),
        ("scale factor over T_in - T_out", lambda s: s.gradient_k, lambda s: 1e-6 * s.input_rate_dph),
        ("bias over time since power-on", lambda s: np.log1p(s.time_s / 300.0), lambda s: 1.0),
    ],
)
def test_a_free_curve_is_a_linear_spline_over_the_whole_span_that_is_zero_at_its_first_node(
    name, values, scale
):
    s = TURNING.stimulus
    variants, at = curves(TURNING)[name], values(s)
    finest = max(len(each.effect.nodes) for each in variants)
    assert finest >= 8 and min(len(each.effect.nodes) for each in variants) == 1
    for variant in variants:
        nodes = np.array([at.min(), *variant.effect.nodes])
        assert nodes[-1] == pytest.approx(at.max()) and np.diff(nodes) == pytest.approx(
            np.full(len(nodes) - 1, np.diff(nodes)[0])
        )
        late = s.lagged(at, variant.shape["lag_s"])
        size = np.arange(1.0, len(nodes)) ** 2
        expected = np.interp(late, nodes, np.append(0.0, size)) * scale(s)
        assert size @ variant.columns(s) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
        assert not variant.effect.local and len(variant.effect.parameters) == len(size)
        drawn = variant.effect.drawn(variant.shape, size)
        assert drawn[0].tolist() == list(variant.effect.nodes) and drawn[1].tolist() == size.tolist()


def test_a_resonance_has_two_quadratures_about_places_four_kelvin_apart():
    variants = curves(COLD)["resonance over T_in"]
    warm_k = COLD.stimulus.warm_k
    places = sorted({each.shape["at"] for each in variants})
    assert (places[0], places[-1]) == (warm_k.min(), warm_k.max())
    assert 0.8 * 4.0 < np.diff(places).max() <= 4.0
    one = next(each for each in variants if each.shape["at"] == places[3] and not each.shape["lag_s"])
    x = (warm_k - places[3]) / one.shape["width"]
    even, odd = one.columns(COLD.stimulus)
    assert even == pytest.approx(1.0 / (1.0 + x * x)) and odd == pytest.approx(2.0 * x / (1.0 + x * x))
    assert np.abs(odd).max() <= 1.0 and one.effect.local
    inputs, curve = one.effect.drawn(one.shape, [3.0, -2.0])
    x = (inputs - one.shape["at"]) / one.shape["width"]
    assert curve == pytest.approx((3.0 - 4.0 * x) / (1.0 + x * x))
    assert inputs.mean() == pytest.approx(places[3]) and x[0] == -x[-1] == -4.0


def test_harmonics_are_means_of_waves_of_the_tables_angle():
    s = TURNING.stimulus
    both = curves(TURNING)
    (bias,), (rate,) = both["bias over table angle"], both["rate over table angle"]
    fine = np.radians(s.angle_deg[:-1, None] + np.diff(s.angle_deg)[:, None] * (np.arange(50) + 0.5) / 50)
    for k in range(1, 5):
        waves = np.stack([np.cos(k * fine).mean(axis=1), np.sin(k * fine).mean(axis=1)])
        assert bias.columns(s)[2 * k - 2 : 2 * k] == pytest.approx(waves, abs=1e-3)
        assert rate.columns(s)[2 * k - 2 : 2 * k] == pytest.approx(waves * 1e-6 * s.input_rate_dph, abs=1e-3)
    assert bias.effect.orders == rate.effect.orders == (1, 1, 2, 2, 3, 3, 4, 4)
    assert "rate over table angle" not in curves(COLD)


def test_a_curve_over_an_effects_very_input_absorbs_it_and_a_resonance_does_not():
    both = curves(TURNING)
    over = {name: variants[0].effect for name, variants in both.items()}
    assert absorbed(effect("bias_linear"), [over["bias over T_in"]])
    # what follows a temperature lies between the sensors: of the outer one, late, it is the same curve
    assert absorbed(effect("bias_linear"), [over["bias over T_out"]])
    assert not absorbed(effect("bias_linear"), [over["scale factor over T_out"]])
    assert absorbed(
        effect("scale_factor_temperature"), [over["bias over T_in"], over["scale factor over T_in"]]
    )
    for name, curve in (
        ("bias_linear", "scale factor over T_in"), ("bias_linear", "resonance over T_in"),
        ("shupe", "bias over T_in"), ("bias_linear", "bias over T_in - T_out"), ("warm_up", "bias over T_in"),
    ):  # fmt: skip
        assert not absorbed(effect(name), [over[curve]])
    assert not absorbed(effect("bias_linear"), [])


def test_what_is_unknown_is_told_by_its_input_its_largest_value_and_its_lag():
    both = curves(TURNING)
    late = next(
        each
        for each in both["bias over T_in"]
        if len(each.effect.nodes) == 2 and each.shape["lag_s"] == 150.0
    )
    found = _curve_part(late, [0.5, -2.345])
    nodes = [round(25.0 + node, 2) for node in late.effect.nodes]
    assert (found.follows, found.unit, found.lag_s, found.at) == ("T_in", "deg/h", 150.0, tuple(nodes))
    assert found.sentence == (
        "Bias follows T_in, 150 s late, by a curve that no effect of the catalogue has; largest, -2.35 deg/h, at "
        f"{nodes[1]:.3g} degC."
    )
    assert (
        found.curve == (0.5, -2.345) and found.term.values == found.curve and found.term.sigmas == (0.0, 0.0)
    )
    scale = next(each for each in both["scale factor over dT_in/dt"] if len(each.effect.nodes) == 2)
    told = _curve_part(scale, [-7.0, 2.0]).sentence
    assert told.startswith("Scale factor follows dT_in/dt, by a curve") and "largest, -7 ppm of rate" in told
    wide = next(each for each in both["bias over T_in"] if len(each.effect.nodes) == 4)
    reached = _curve_part(wide, [0.5, -2.0, 1.0, -4e6], [0.1, 0.2, 0.1, 3e6])
    assert reached.curve == (0.5, -2.0, 1.0) and "largest, -2 deg/h" in reached.sentence
    assert reached.term.values == (0.5, -2.0, 1.0, -4e6) and len(reached.at) == 3
    settling = both["bias over time since power-on"][0]
    assert _curve_part(settling, [1.0]).at == (round(TURNING.stimulus.time_s[-1], 2),)
    angle = _curve_part(both["rate over table angle"][0], [0.1, 0.2, 0.0, -9.0, 0.3, 0.0, 1.0, 0.0])
    assert (angle.follows, angle.harmonic, angle.at) == ("table angle", 2, ())
    assert "proportional to rate; strongest is harmonic 2 " in angle.sentence
    bias = _curve_part(both["bias over table angle"][0], [0.0] * 7 + [0.1])
    assert "at any rate; strongest is harmonic 4 " in bias.sentence
    with pytest.raises(TypeError, match="no free curve"):
        _curve_part(effect("warm_up").variants()[0], [1.0])
    line = _line_part(SpectralLine("shock", 40.0, 0.1234, 9.0, 0.5))
    assert (line.frequency_hz, line.harmonic) == (0.025, 2)
    assert (
        "0.123 deg/h at 0.025 Hz" in line.sentence
        and "(period 40 s) in runs of shock, harmonic 2 of" in line.sentence
    )
    assert "not bound to the table's angle" in _line_part(SpectralLine("shock", 40.0, 0.1, 9.0, 0.0)).sentence
    swung = _line_part(SpectralLine("sector", 8.0, 0.1, 9.0, 0.0, "table rate"))
    assert (swung.follows, swung.frequency_hz) == ("table rate", 0.125)
    assert "periodic as table rate is: 0.1 deg/h at 0.125 Hz (period 8 s) in runs of sector" in swung.sentence
    noise = Noise(0.004, quantum_arcsec=1.234, correlated_dph=0.5678, correlation_time_s=61.7)
    assert (
        "0.568 deg/h rms, changing within 62 s or so; most in r about 2 min"
        in _differing_part(noise, "r", 95.0).sentence
    )
    assert (
        "in steps of 1.23 arcsec; the log has steps of 0.012 arcsec" in shaken_part(noise, 0.01234).sentence
    )


def forms(*runs):
    found = {}
    for candidate in candidates_for(list(runs)):
        found.setdefault(candidate.form.name, []).append(candidate)
    return found


def test_learned_forms_are_over_what_changes():
    still, cold, turning = forms(STILL), forms(COLD), forms(TURNING)
    assert set(still) == {"time since power-on"}
    assert {"memory of T_in", "memory of T_out", "bias over T_in and dT_in/dt", "loops of T_in"} <= set(cold)
    words = ("scale factor", "bias over rate", "rate over", "heat of", "response", "bias over table")
    assert set(turning) - set(cold) == {name for name in turning if name.startswith(words)}
    assert len(set(turning) - set(cold)) == 10
    tilted = replace(STILL, stimulus=replace(STILL.stimulus, elevation_deg=np.linspace(0.0, 2.0, 3000)))
    assert {"bias over direction", "memory of direction"} <= set(forms(tilted))
    s = tilted.stimulus
    elevation, north = np.radians(s.elevation_deg), np.radians(10.0)
    pulls = [np.cos(elevation) * np.cos(north), np.cos(elevation) * np.sin(north), np.sin(elevation)]
    (direction,) = forms(tilted)["bias over direction"]
    assert direction.variant.columns(s) == pytest.approx(np.stack((*pulls, pulls[2] ** 2)))
    (memory,) = forms(tilted)["memory of direction"]
    late = [pull - s.lagged(pull, lag_s) for lag_s in (30.0, 100.0, 300.0) for pull in pulls]
    assert memory.variant.columns(s) == pytest.approx(np.stack(late))
    level = replace(STILL, stimulus=replace(STILL.stimulus, elevation_deg=np.zeros(3000)))
    assert "bias over direction" in forms(STILL, level) and "memory of direction" not in forms(STILL, level)
    one = replace(COLD, stimulus=replace(COLD.stimulus, t_out_c=COLD.stimulus.t_in_c))
    assert not any("T_out" in name for name in forms(one)) and "bias over T_in and dT_in/dt" in forms(one)


def test_nodes_of_learned_curves_span_what_was_seen_a_kelvin_and_a_half_apart():
    found = forms(COLD)
    for name, over in (("bias over T_in", Input.T_IN), ("bias over T_out", Input.T_OUT)):
        low, high = span_of([COLD, STILL], over)
        every = [
            run.stimulus.warm_k if over is Input.T_IN else run.stimulus.case_warm_k for run in (COLD, STILL)
        ]
        assert (low, high) == (np.concatenate(every).min(), np.concatenate(every).max())
        for candidate in found[name]:
            (nodes,) = candidate.nodes
            assert (nodes[0], nodes[-1]) == span_of([COLD], over)
            assert np.diff(nodes) == pytest.approx(np.full(len(nodes) - 1, 1.5), rel=0.1)
    assert len({candidate.variant.shape.get("late_s", 0.0) for candidate in found["bias over T_in"]}) == 3
    small = replace(COLD.stimulus, t_in_c=25.0 + (COLD.stimulus.t_in_c - 25.0) / 6.0)
    assert len(forms(replace(COLD, stimulus=small))["bias over T_in"][0].nodes[0]) == 8
    both = found["bias over T_in and dT_in/dt"][0].nodes
    assert [(own[0], own[-1]) for own in both] == [
        span_of([COLD], each) for each in (Input.T_IN, Input.WARMING)
    ]
    rates = forms(TURNING)["bias over rate"][0].variant.shape
    nodes = [rates[key] for key in rates]
    assert nodes == sorted(nodes) and nodes[-1] == pytest.approx(5.0) and nodes[0] == pytest.approx(-5.0)
    assert nodes == pytest.approx([-each for each in reversed(nodes)])
    assert found["bias over T_in"][0].slow and not forms(TURNING)["scale factor over T_in"][0].slow
    assert not forms(TURNING)["bias over table angle"][0].slow and found["time since power-on"][0].slow
    assert found["memory of T_in"][0].priors == () and found["memory of T_in"][0].basis is None


def test_learned_terms_are_valid_where_they_were_fitted():
    """From the coldest to the warmest and from the slowest to the fastest, over all runs."""
    back = replace(TURNING, stimulus=replace(TURNING.stimulus, angle_deg=-0.5 * TURNING.stimulus.angle_deg))
    found = _ranges([TURNING, back, STILL])
    s = TURNING.stimulus
    assert found["T_in, degC"] == pytest.approx((25.0 + s.warm_k.min(), 25.0 + max(s.warm_k.max(), 0.0)))
    assert found["dT_in/dt, K/min"] == (s.warming_k_per_min.min(), s.warming_k_per_min.max())
    assert found["rate, deg/s"] == pytest.approx((-2.5, 5.0))
    assert all(low < high for low, high in found.values()) and len(found) == 3


def test_a_foretold_unit_follows_the_air_case_first_and_warms_itself():
    """In a ramp of 1 K/min the case is a minute behind, the inside twenty more, 6 K above what it would be."""
    s = _stimulus(39.1, [(10.0, 25.0), (200.0, -175.0)], rate_dps=-2.0, angle_deg=30.0, elevation_deg=0.0)
    assert s.time_s.tolist() == list(range(1, 12_601))
    air = np.interp(s.time_s, [0.0, 600.0, 12_600.0], [25.0, 25.0, -175.0])
    assert s.t_out_c[:600].tolist() == [25.0] * 600
    assert (s.t_out_c - air)[-1] == pytest.approx(1.0, rel=0.02)
    inside = s.t_in_c - 6.0 * (1.0 - np.exp(-s.time_s / 1500.0))
    assert inside[:600] == pytest.approx(np.full(600, 25.0)) and inside[-1] - air[-1] == pytest.approx(
        21.0, rel=0.01
    )
    assert s.angle_deg[[0, 1, -1]].tolist() == [30.0, 28.0, 30.0 - 2.0 * 12_600]
    assert set(s.elevation_deg.tolist()) == {0.0} and s.latitude_deg == 39.1


def test_foretold_shocks_go_to_minus_45_degc_and_back_as_their_procedures_do():
    design = _zero_bias(39.1, soak_min=40.0, hold_min=20.0)
    (s,) = design.stimuli.values()
    way = 60.0 * 70.0 / 12.0
    assert len(s) == 1200 + way + 2400 + way + 4800
    assert (s.angle_deg[0], s.angle_deg[-1], s.elevation_deg[0]) == (90.0, 90.0, 0.0)
    assert s.t_out_c[:1200].tolist() == [25.0] * 1200 and s.t_out_c.min() == pytest.approx(-45.0, abs=0.01)
    # a lag of 60 s makes 12 K of 12 K/min, of which one is left ln(12) minutes after the air is there
    cold = np.flatnonzero(s.t_out_c < -44.0)
    assert cold[0] == pytest.approx(1200 + way + 60 * math.log(12.0), abs=10) and cold[-1] == pytest.approx(
        1200 + way + 2400, abs=60
    )
    assert design.settings == {"soak_min": 40.0, "hold_min": 20.0} and list(design.stimuli) == ["90 deg"]
    three = _scale_factor(39.1, rate_dps=7.0, soak_min=40.0, hold_min=20.0)
    assert list(three.stimuli) == ["+7", "-7", "+0"]
    assert [s.table_rate_dps[5] for s in three.stimuli.values()] == pytest.approx([7.0, -7.0, 0.0])
    assert all(s.elevation_deg[0] == 90.0 for s in three.stimuli.values())
    runs = three.runs()
    assert [run.condition for run in runs] == ["+7", "-7", "+0"] and len({run.run_id for run in runs}) == 3
    assert {run.profile for run in runs} == {three.text} and not any(run.missing.any() for run in runs)


def test_other_equipment_turns_over_or_turns_fast():
    (_, over), (_, fast) = other_equipment(10.0)
    (s,) = over.stimuli.values()
    assert (
        s.elevation_deg.tolist() == [90.0] * 1200 + [0.0] * 1200 + [-90.0] * 1200
        and not s.table_rate_dps.any()
    )
    (s,) = fast.stimuli.values()
    assert s.table_rate_dps[150::300] == pytest.approx([0.0, 200.0, -200.0, 400.0, -400.0])
    assert len(s) == 1500 and s.t_out_c.tolist() == [25.0] * 1500 and s.latitude_deg == 10.0


def test_slow_rates_are_means_of_twenty_samples_at_one_rate():
    """Steady is what changes by a thousandth of the rate, or by half a degree an hour."""
    n = 110
    rate_dps = np.repeat([0.0, 10.0, 10.0, 10.0, 0.0, 3.0], [20, 20, 20, 20, 20, 10])
    rate_dps[45], rate_dps[65], rate_dps[85] = 10.009, 10.011, 0.6 / 3600.0
    angle = np.concatenate(([5.0], 5.0 + np.cumsum(rate_dps)))
    s = replace(stimulus(n, cold=False), angle_deg=angle)
    run = replace(made_run("a", s, RNG), output_dph=np.arange(float(n)))
    lost = replace(run, output_dph=np.where(np.arange(n) == 39, np.nan, run.output_dph))
    found = _slow_rates([run, lost])
    assert found.output.tolist() == [9.5, 29.5, 49.5, 9.5, 49.5] and found.run.tolist() == [0, 0, 0, 1, 1]
    mean = s.input_rate_dph[:100].reshape(5, 20).mean(axis=1)
    assert found.rate.tolist() == mean[[0, 1, 2, 0, 2]].tolist()
    assert [len(records) for records in found.records] == [2, 2]
    assert found.records[0][1].tolist() == (run.output_dph - s.input_rate_dph).tolist()
    asked = []

    def propose(rates):
        asked.append(rates.output.tolist())
        return [{"limit_dps": 7.0}, {"limit_dps": 8.0}]

    own = replace(effect("saturation"), propose=propose)
    variants = proposed_variants([effect("warm_up"), own], [run])
    assert [variant.shape for variant in variants] == [{"limit_dps": 7.0}, {"limit_dps": 8.0}]
    assert asked == [[9.5, 29.5, 49.5]] and proposed_variants([effect("warm_up")], [run]) == []


def test_expected_information_follows_from_the_distances_of_the_predictions():
    """Both distances of Gaussians of four samples; means apart as far as a formula's misfit leaves them."""
    rng = np.random.default_rng(6)
    columns = rng.normal(size=(4, 3))
    explanations = [
        Foretold(0.2, np.array([0.3, 0.0, -0.5]), np.diag([0.5, 0.0, 2.0])),
        Foretold(0.7, np.array([0.0, 0.9, 0.0]), np.array([[0.0], [1.0], [0.4]])),
        Foretold(0.6, np.array([-1.0, 0.2, 1.5]), np.zeros((3, 0))),
    ]
    weights = np.array([0.2, 0.7, 0.6]) / 1.5
    spreads = [np.eye(4) + columns @ each.root @ each.root.T @ columns.T for each in explanations]
    near, farther = np.eye(3), np.eye(3)
    for i in range(3):
        for j in range(3):
            middle = 0.5 * (spreads[i] + spreads[j])
            apart = columns @ (explanations[i].mean - explanations[j].mean)
            square = float(apart @ np.linalg.solve(middle, apart))
            square /= 1.0 + MISFIT**2 * square / DIRECTIONS
            volumes = [math.log(np.linalg.det(each)) for each in (middle, spreads[i], spreads[j])]
            near[i, j] = math.exp(-(square / 8.0 + 0.5 * (volumes[0] - 0.5 * (volumes[1] + volumes[2]))))
            own = float(apart @ np.linalg.solve(spreads[j], apart))
            own /= 1.0 + MISFIT**2 * own / DIRECTIONS
            spread = float(np.trace(np.linalg.solve(spreads[j], spreads[i]))) - 4.0
            farther[i, j] = math.exp(-0.5 * (spread + own + volumes[2] - volumes[1]))
    bounds = [
        -sum(w * math.log(float(row @ weights)) for w, row in zip(weights, each, strict=True))
        for each in (near, farther)
    ]
    expected = 0.5 * sum(bounds)
    assert expected_information(columns.T @ columns, explanations) == pytest.approx(expected, rel=1e-9)


def cause(name, rivals=(), size=50.0):
    def term(own):
        variant = effect(own).variants()[0]
        return Term(
            variant, (size,) * len(variant.effect.parameters), (0.5,) * len(variant.effect.parameters)
        )

    return Cause(name, "", 0.9, term(name), {}, {each: term(each) for each in rivals})


def told(causes, sets, unknown=0.05, resembles=(), parts=(), learned=None, noise=()):
    return SimpleNamespace(
        causes=causes,
        resembles=resembles,
        set_probabilities={frozenset(k): v for k, v in sets.items()},
        unknown_probability=unknown,
        unknown_parts=parts,
        learned=learned,
        stochastic=dict.fromkeys(noise, 0.95),
        nominal=Model("m", (), Noise(0.004)),
    )


def test_explanations_are_the_sets_that_a_diagnosis_holds_possible():
    shupe, warm = cause("shupe", ["thermal_lag"]), cause("warm_up")
    sets = {
        ("shupe",): 0.7,
        ("thermal_lag",): 0.2,
        ("warm_up", "shupe"): 0.0995,
        ("gradient",): 0.3,
        (): 5e-4,
    }
    found = {each.label: each for each in _named(told((shupe,), sets, resembles=(warm,)))}
    assert {tuple(sorted(label)): each.probability for label, each in found.items()} == {
        ("shupe",): 0.7, ("thermal_lag",): 0.2, ("shupe", "warm_up"): 0.0995,
    }  # fmt: skip
    assert found[frozenset({"shupe", "warm_up"})].terms == (shupe.term, warm.term)
    assert found[frozenset({"thermal_lag"})].terms == (shupe.rivals["thermal_lag"],)
    curve = SimpleNamespace(term=cause("bias_cubic").term)
    beside = {
        each.label: each
        for each in _named(told((shupe,), sets, 0.4, parts=(curve, SimpleNamespace(term=None))))
    }
    assert beside[frozenset({"shupe"})].probability == pytest.approx(0.6 * 0.7)
    unknown = beside[frozenset({UNKNOWN, "shupe"})]
    assert unknown.probability == 0.4 and unknown.terms == (shupe.term, curve.term)
    learned = SimpleNamespace(terms=(cause("bias_ramp").term,))
    without = _named(told((), {(): 1.0}, 0.4, learned=learned))[-1]
    assert without.label == {UNKNOWN} and without.terms == learned.terms
    assert [each.label for each in _named(told((), {}, 0.05))] == [frozenset()]
    # what is named of noise acts in each, with something unknown beside as well
    noisy = _named(told((shupe,), {("shupe",): 0.9, (): 0.1}, 0.4, noise=["quantisation"]))
    labels = [each.label for each in noisy]
    assert labels == [{"shupe", "quantisation"}, {"quantisation"}, {UNKNOWN, "shupe", "quantisation"}]
    assert [each.label for each in _named(told((), {}, 0.05, noise=["quantisation"]))] == [{"quantisation"}]


@pytest.fixture(scope="module")
def seen() -> Outlook:
    """Three designs, and a diagnosis that has named a warm-up."""
    designs = [
        each for each in usual_designs(39.1) if each.procedure in ("constant-rotation", "standard-test")
    ]
    shock = _zero_bias(39.1, soak_min=20.0, hold_min=10.0)
    found = told((cause("warm_up", size=0.02),), {("warm_up",): 0.9, (): 0.1})
    return outlook(found, found.nominal, [], [*designs, shock])


def test_beside_what_is_named_one_more_effect_acts_in_one_case_of_five(seen):
    assert sum(seen.probabilities.values()) == pytest.approx(1.0)
    assert seen.leading.label == {"warm_up"}
    hidden = [each for each in seen.explanations if each.hidden]
    assert all(each.label == {"warm_up", each.hidden} and each.terms == seen.leading.terms for each in hidden)
    # odds of a quarter beside the best explanation of 0.9, shared by all that the bench can show
    named = sum(each.probability for each in seen.explanations if not each.hidden)
    share = 0.25 * 0.9 * len(hidden) / len(seen.energies)
    assert (1.0 - named) / named == pytest.approx(share, rel=0.01)
    assert set(seen.energies) >= {each.hidden for each in hidden} and not set(seen.energies) & set(
        seen.hidden_from_bench
    )


def test_the_shortest_run_that_shows_an_effect_is_told(seen):
    times = sorted(each.hours for each in seen.designs)
    (size,) = seen.leading.terms[0].values
    by_h = {}
    for design in seen.designs:
        deflections = []
        for s in design.stimuli.values():
            row = size * seen.leading.terms[0].variant.columns(s)[0]
            use = np.isfinite(design.runs()[0].output_dph)
            row = row - row[use].mean()
            deflections.append(float((row[use] ** 2).sum()) / 0.24**2)
        by_h[design.hours] = math.sqrt(sum(deflections))
    least = 0.98 * max(by_h.values())
    expected = min(hours for hours in times if by_h[hours] >= least)
    found = seen.showing(frozenset({"warm_up"}), math.inf, least)
    assert found.design.hours == expected and found.nats == seen.information(found.design) > 0.0
    assert seen.showing(frozenset({"another"}), math.inf, least) == found  # by all that is named
    assert seen.showing(frozenset({"warm_up"}), 0.99 * expected, least) is None
    assert seen.showing(frozenset({"warm_up"}), math.inf, 1.1 * max(by_h.values())) is None
    assert seen.showing(frozenset({"warm_up"}), math.inf, 0.0).design.hours == times[0]
    choices = seen.choices(times[1])
    assert len(choices) == 2 and {each.design.hours for each in choices} == set(times[:2])
