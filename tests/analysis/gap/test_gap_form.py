"""What counts as the form of an effect, on sets whose energies are given by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model, diagnose
from bench.analysis.gap._candidates import candidate_variants
from bench.analysis.gap._causes import _nameable, _one_of
from bench.analysis.gap._cells import Cell
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._judged import Judged, correcting, less_forms, told_by_form
from bench.analysis.gap._unknown import Remainder
from drivers.base.arrays import Array
from simulators.effects import Effect
from tests.analysis.gap.conftest import effect, made_run, stimulus

_EFFECTS = {
    name: effect(name)
    for name in (
        "bias_cubic",
        "bias_linear",
        "gradient",
        "hysteresis",
        "shupe",
        "thermal_lag",
        "warm_up",
        "bias_ramp",
        "scale_factor_temperature",
        "table_tilt",
        "heading_sensitivity",
        "saturation",
    )
}
_NOTHING = Solution(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)))


def _judged(energy: float, *names: str, evidence: float = 0.0, rest: float = 0.0) -> Judged:
    left = Remainder(np.array([rest]), 0.0, np.zeros(1), np.zeros(1))
    return Judged(
        frozenset(names), frozenset(), evidence, _NOTHING, np.array([energy]), left, _NOTHING, _NOTHING
    )


def _less(sets: list[Judged], without: Mapping[frozenset[str], float]) -> dict[frozenset[str], Judged]:
    """Sets less forms; `without` has the energy that is left when a set loses names."""

    def left(one: Judged, gone: frozenset[str]) -> Array:
        return np.array([without[one.names - gone]])

    return {one.names: one for one in less_forms(sets, left, _EFFECTS)}


def _energies(sets: list[Judged]) -> dict[frozenset[str], float]:
    return {one.names: float(one.left.sum()) for one in sets}


def test_two_thermal_names_beside_the_true_one_are_its_form() -> None:
    sets = [
        _judged(1000.0, evidence=-500.0),
        _judged(60.0, "shupe", evidence=-260.0, rest=9.0),
        _judged(300.0, "gradient", evidence=-300.0),
        _judged(340.0, "thermal_lag", evidence=-310.0),
        _judged(50.0, "shupe", "gradient", evidence=-200.0),
        _judged(10.0, "shupe", "gradient", "thermal_lag"),
    ]
    kept = _less(sets, _energies(sets))
    shupe = kept[frozenset({"shupe"})]
    assert frozenset({"shupe", "gradient", "thermal_lag"}) not in kept
    assert frozenset({"shupe", "gradient"}) not in kept
    # it is as probable as what it stands for, and what that explains is not left without a name
    assert shupe.log_evidence == 0.0
    assert shupe.rest.total == 0.0
    assert not shupe.remains


@pytest.mark.parametrize(("alone", "stays"), [(122.0, False), (123.0, True)])
def test_a_third_of_the_amplitude_is_form_and_more_is_a_cause(alone: float, stays: bool) -> None:
    # 0.35 squared of what the gradient takes away, 1000 - alone
    sets = [
        _judged(1000.0 + alone, evidence=-99.0),
        _judged(alone, "gradient"),
        _judged(0.0, "gradient", "shupe"),
    ]
    kept = _less(sets, _energies(sets))
    assert (frozenset({"gradient", "shupe"}) in kept) == stays


@pytest.mark.parametrize("names", [("gradient", "scale_factor_temperature"), ("gradient", "bias_ramp")])
def test_what_adds_otherwise_or_follows_another_driver_is_no_form(names: tuple[str, str]) -> None:
    sets = [_judged(1000.0), _judged(50.0, names[0]), _judged(960.0, names[1]), _judged(0.0, *names)]
    assert frozenset(names) in _less(sets, _energies(sets))


def test_time_corrects_time() -> None:
    sets = [_judged(1000.0), _judged(90.0, "warm_up"), _judged(600.0, "bias_ramp")]
    sets.append(_judged(0.0, "warm_up", "bias_ramp", evidence=9.0))
    kept = _less(sets, _energies(sets))
    assert frozenset({"warm_up", "bias_ramp"}) not in kept
    assert kept[frozenset({"warm_up"})].log_evidence == 9.0


def test_a_field_may_miss_less_than_a_temperature() -> None:
    whole = frozenset({"heading_sensitivity", "table_tilt"})
    for energy, stays in ((20.0, False), (40.0, True)):
        sets = [_judged(1000.0), _judged(energy, "heading_sensitivity"), _judged(700.0, "table_tilt")]
        sets.append(_judged(0.0, *whole))
        assert (whole in _less(sets, _energies(sets))) == stays


def test_fewest_members_go_first_and_one_always_stays() -> None:
    gone = list(correcting(frozenset({"gradient", "shupe", "saturation"}), _EFFECTS))
    assert gone == [frozenset({"gradient"}), frozenset({"shupe"})]


def _told(sets: list[Judged], without_best: list[float], counts: list[float]) -> dict[str, float]:
    """Log evidence by the one name of a set; `without_best` is the energy by cell that nothing explains."""
    cells = [_cell(count) for count in counts]

    def left(one: Judged, gone: frozenset[str]) -> Array:
        return np.array(without_best)

    return {next(iter(one.names)): one.log_evidence for one in told_by_form(sets, left, cells, _EFFECTS)}


def _cell(count: float) -> Cell:
    return Cell("shock", "common", True, 0, count, 1, np.arange(1), np.ones((1, 1)), 1.0, 1)


def _of_cells(name: str, evidence: float, *energies: float) -> Judged:
    return replace(_judged(0.0, name, evidence=evidence), left=np.array(energies))


def test_akin_effects_are_told_by_students_likelihood() -> None:
    sets = [
        _of_cells("gradient", 0.0, 200.0),
        _of_cells("thermal_lag", -80.0, 210.0),
        _of_cells("shupe", -80.0, 200.0),
        _of_cells("saturation", -80.0, 200.0),
    ]
    told = _told(sets, [10_100.0], [100.0])
    assert told["gradient"] == 0.0
    # fifty parts. The gradient takes 9900 away, and 99 % of what is left above the noise, 100, is its formula's,
    # as of the 10 that the other leaves more; nobody trusts one to leave less than 10 + 0.003 of what it takes
    assert told["thermal_lag"] == pytest.approx(-25.0 * math.log1p(9.9 / (10.0 + 29.7 + 99.0)))
    # as good, with one parameter more, for which the gradient has one more shape: lag and share against a lag
    assert told["shupe"] == -0.1
    assert told["saturation"] == -80.0


def test_a_parameter_more_counts_half_of_ln_51_unless_shapes_make_up_for_it() -> None:
    for best, behind in (("bias_linear", 0.5 * math.log(51.0)), ("bias_cubic", 0.5 * math.log(51.0))):
        told = _told([_of_cells(best, 0.0, 200.0), _of_cells("shupe", -80.0, 200.0)], [10_100.0], [100.0])
        assert told["shupe"] == pytest.approx(-behind), best
    assert (effect("bias_cubic").moving, effect("shupe").moving) == (("lag_s",), ("lag_s",))
    for name, shapes in (("thermal_lag", 4), ("gradient", 2), ("hysteresis", 4)):
        assert len(effect(name).moving) == shapes
        told = _told([_of_cells(name, 0.0, 200.0), _of_cells("shupe", -80.0, 200.0)], [10_100.0], [100.0])
        assert told["shupe"] == -0.1, name
    fewer = _told(
        [_of_cells("shupe", 0.0, 200.0), _of_cells("bias_cubic", -80.0, 220.0)], [10_100.0], [100.0]
    )
    whole = _told(
        [_of_cells("gradient", 0.0, 200.0), _of_cells("bias_cubic", -80.0, 220.0)], [10_100.0], [100.0]
    )
    assert fewer["bias_cubic"] == pytest.approx(whole["bias_cubic"] + 0.5 * math.log(51.0))


def test_what_is_left_where_another_effect_acts_is_not_the_formulas() -> None:
    alone = _told([_of_cells("gradient", 0.0, 0.0), _of_cells("thermal_lag", -80.0, 90.0)], [1000.0], [0.0])
    sets = [_of_cells("gradient", 0.0, 0.0, 5000.0), _of_cells("thermal_lag", -80.0, 90.0, 5000.0)]
    assert _told(sets, [1000.0, 5000.0], [0.0, 0.0]) == alone


def test_what_many_faint_cells_tell_is_not_forgiven() -> None:
    # in no cell a clear gap: 40 of 100 above the noise, everywhere
    sets = [_of_cells("gradient", 0.0, *[100.0] * 10), _of_cells("thermal_lag", -190.0, *[140.0] * 10)]
    told = _told(sets, [140.0] * 10, [100.0] * 10)
    assert told["thermal_lag"] == pytest.approx(-25.0 * math.log1p(400.0 / (10.0 + 0.003 * 400.0)))


def test_nothing_becomes_less_probable() -> None:
    sets = [_of_cells("gradient", 0.0, 1.0), _of_cells("shupe", -1.0, 1e6)]
    assert _told(sets, [2e6], [0.0]) == {"gradient": 0.0, "shupe": -1.0}


def test_a_set_grows_until_one_of_it_surely_acts() -> None:
    weights = {
        frozenset({"gradient"}): (0.5, 0.0),
        frozenset({"shupe"}): (0.3, 0.0),
        frozenset({"thermal_lag"}): (0.15, 0.0),
        frozenset({"warm_up"}): (0.05, 0.0),
    }
    rivals = {"shupe": 0.3, "thermal_lag": 0.15, "warm_up": 0.05}
    assert _one_of("gradient", rivals, weights) == ("gradient", "shupe", "thermal_lag")
    sure = {frozenset({"gradient"}): (0.95, 0.0), frozenset({"shupe"}): (0.05, 0.0)}
    assert _one_of("gradient", {"shupe": 0.05}, sure) == ("gradient",)


def test_a_name_is_stated_from_odds_of_four_to_one_and_for_four_effects_at_most() -> None:
    """What stands beside a sure cause in two sets of three only is as likely a misfit of its formula."""
    weights = {
        frozenset({"thermal_lag", "vibration_rectification"}): (0.55, 0.0),
        frozenset({"thermal_lag"}): (0.35, 0.0),
        frozenset({"thermal_lag", "scale_factor_asymmetry"}): (0.1, 0.0),
    }
    assert _nameable(("thermal_lag",), weights)
    assert not _nameable(("vibration_rectification", "scale_factor_asymmetry"), weights)
    sure = {
        frozenset({"thermal_lag", "vibration_rectification"}): (0.8, 0.05),
        frozenset({"thermal_lag"}): (0.15, 0.0),
    }
    assert _nameable(("vibration_rectification",), sure)
    assert not _nameable(("vibration_rectification", "shupe", "gradient", "warm_up", "bias_ramp"), sure)


def test_effects_of_the_catalogue_are_what_these_tests_take_them_for() -> None:
    assert all(isinstance(each, Effect) for each in _EFFECTS.values())
    assert len(_EFFECTS["shupe"].parameters) == len(_EFFECTS["gradient"].parameters) + 1


def test_even_functions_of_rate_are_akin_and_odd_ones_not_to_them() -> None:
    parity = {
        name: effect(name).parity
        for name in (
            "scale_factor_asymmetry",
            "vibration_rectification",
            "scale_factor_nonlinearity",
            "saturation",
            "dead_zone",
            "scale_factor_temperature",
            "table_wobble_once",
        )
    }
    assert list(parity.values()) == [1, 1, -1, -1, None, None, None]


def test_what_a_generator_of_asymmetry_leaves_is_no_vibration() -> None:
    effects = {name: effect(name) for name in ("scale_factor_asymmetry", "vibration_rectification")}
    sets = [
        _judged(1000.0, evidence=-500.0),
        _judged(60.0, "scale_factor_asymmetry", evidence=-260.0),
        _judged(400.0, "vibration_rectification", evidence=-300.0),
        _judged(10.0, "scale_factor_asymmetry", "vibration_rectification"),
    ]
    without = _energies(sets)
    left = less_forms(sets, lambda one, gone: np.array([without[one.names - gone]]), effects)
    assert frozenset(effects) not in {one.names for one in left}


def test_curves_over_time_since_power_on_resolve_its_beginning() -> None:
    """A scale factor that settles within ten minutes of three hours is drawn to a hundredth."""
    s = stimulus(10800, cold=False, rate_dps=20.0)
    settling = np.exp(-s.time_s / 600.0)
    curves = [
        variant
        for variant in free_curves([made_run("a", s, np.random.default_rng(1))])
        if variant.effect.name.endswith("scale factor over time since power-on")
    ]
    rows = np.concatenate((curves[-1].columns(s), s.input_rate_dph[None]))
    wanted = 1e-6 * s.input_rate_dph * settling
    fit = np.linalg.lstsq(rows.T, wanted, rcond=None)[0]
    assert np.linalg.norm(wanted - fit @ rows) < 0.02 * np.linalg.norm(wanted)


def test_what_a_stronger_effect_leaves_elsewhere_does_not_make_up_for_what_is_left_here() -> None:
    """Both sets have the effect that acts in the second cell; tolerances let them leave 350 and 20 there."""
    sets = [_of_cells("gradient", 0.0, 10.0, 350.0), _of_cells("bias_cubic", -80.0, 300.0, 20.0)]
    told = _told(sets, [1000.0, 100.0], [0.0, 0.0])
    formula = 10.0 + 0.003 * 990.0 + 0.99 * 10.0
    assert told["bias_cubic"] == pytest.approx(-25.0 * math.log1p(0.99 * 290.0 / formula))


def test_what_grows_in_the_warm_alone_is_a_bend_and_nothing_late(nominal: Model) -> None:
    """A hinge. A slow follower of a bent temperature takes an hour and more to follow, and imitates it."""
    rng = np.random.default_rng(4)
    runs = []
    for name, n in (("short", 4000), ("long", 9000)):
        base = stimulus(n)
        air_c = np.interp(base.time_s, [0, n // 4, n // 2, n], [25.0, -40.0, 60.0, 25.0])
        s = replace(base, t_in_c=base.lagged(air_c, 120.0), t_out_c=air_c)
        hinge = 0.7 * np.log1p(np.exp((s.t_in_c - 40.0) / 15.0))
        runs += [made_run(f"{name} {repeat}", s, rng, hinge, profile=name) for repeat in range(2)]
    found = diagnose(runs, nominal).rate
    assert [cause.name for cause in found.causes] == ["bias_quadratic"]
    assert found.verdict == "explained"


def test_a_bend_with_a_slope_in_it_is_tried_where_the_model_has_the_slope(nominal: Model) -> None:
    s = stimulus(4000)
    runs = [made_run("r", s, np.random.default_rng(1))]

    def growths(model: Model) -> set[float]:
        tried = candidate_variants(model, runs)
        return {each.shape["growth"] for each in tried if each.effect.name == "bias_quadratic"}

    assert growths(nominal) == {-4.0, -2.0, 0.0, 2.0, 4.0}
    assert growths(Model("without a slope", (), nominal.noise)) == {0.0}
