"""Several units at once: whose an effect is, by hand and on made-up runs of three units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model, batch_facts, diagnose_batch
from bench.analysis.gap._batch import _shared
from bench.analysis.gap._data import GapRun
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import made_run, stimulus

NONE, E, F = frozenset[tuple[str, ...]](), frozenset({("e",)}), frozenset({("f",)})
NOTHING_HIDDEN = dict.fromkeys("abc", NONE)
ONE = 0.01


def _runs(sizes: dict[str, float]) -> list[GapRun]:
    """Two runs of each unit, whose bias follows the cube of temperature by so many deg/h."""
    rng = np.random.default_rng(5)
    s = stimulus(6000)
    return [
        replace(made_run(f"{unit}{k}", s, rng, size * (s.warm_k / 50.0) ** 3), unit_id=unit)
        for unit, size in sizes.items()
        for k in range(2)
    ]


@pytest.mark.parametrize(
    ("sizes", "kind", "in_all", "alike"),
    [
        ({"a": 0.4, "b": 0.4, "c": 0.4}, "common", True, True),
        ({"a": 0.4, "b": 0.8, "c": 0.6}, "common", True, False),
        ({"a": 0.0, "b": 0.6, "c": 0.0}, "own", False, None),
    ],
)
def test_an_effect_of_all_units_is_told_from_one_units_own(
    nominal: Model, sizes: dict[str, float], kind: str, in_all: bool, alike: bool | None
) -> None:
    found = diagnose_batch(_runs(sizes), nominal)
    assert list(found.units) == list(sizes)
    (effect,) = found.effects
    assert (effect.name, effect.kind, effect.in_all > 0.95) == ("bias_cubic", kind, in_all)
    has = {unit for unit, size in sizes.items() if size}
    assert set(effect.units) == set(effect.terms) == has
    assert all(probability < 0.05 for unit, probability in effect.by_unit.items() if unit not in has)
    for unit, term in effect.terms.items():
        assert abs(term.values[0] - sizes[unit]) < max(4.0 * term.sigmas[0], 0.03)
    assert {name: value > 0.01 for name, value in effect.one_value.items()} == (
        {} if alike is None else dict.fromkeys(effect.one_value, alike)
    )
    facts = batch_facts(found)
    assert facts["units"]["b"]["verdict"] == "explained" and facts["effects"][0]["kind"] == kind


def test_units_without_an_effect_have_none(nominal: Model) -> None:
    assert diagnose_batch(_runs({"a": 0.0, "b": 0.0}), nominal).effects == ()


def test_runs_of_one_unit_are_no_batch(nominal: Model) -> None:
    with pytest.raises(ConfigurationError, match="no runs of a batch"):
        diagnose_batch(_runs({"a": 0.4}), nominal)


def test_what_one_unit_leaves_open_several_decide() -> None:
    """0.6 and 0.4 in two units: as 0.36 / p to 0.16 / p, and 1 that both have something of their own."""
    in_all, by_unit = _shared({unit: {E: 0.6, F: 0.4} for unit in "ab"}, NOTHING_HIDDEN, ONE)
    odds = {("e",): 0.6**2 / ONE, ("f",): 0.4**2 / ONE}
    total = sum(odds.values()) + 1.0
    assert in_all[("e",)] == pytest.approx((odds[("e",)] + 0.36) / total, rel=0.01)
    assert by_unit[("f",)]["a"] == pytest.approx((odds[("f",)] + 0.4) / total, rel=0.01)
    three, _ = _shared({unit: {E: 0.6, F: 0.4} for unit in "abc"}, NOTHING_HIDDEN, ONE)
    assert three[("e",)] > in_all[("e",)]


def test_a_unit_that_cannot_show_an_effect_says_nothing_of_it() -> None:
    """With it in one of three units, and the others blind: as probable as their own as the type's."""
    hidden = {"a": NONE, "b": E, "c": E}
    weights = {"a": {E: 1.0}, "b": {NONE: 1.0}, "c": {NONE: 1.0}}
    in_all, by_unit = _shared(weights, hidden, ONE)
    assert in_all[("e",)] == pytest.approx(0.5, rel=0.01)
    assert by_unit[("e",)] == pytest.approx({"a": 1.0, "b": 0.5, "c": 0.5}, rel=0.01)
    in_all, by_unit = _shared(weights, NOTHING_HIDDEN, ONE)
    assert in_all[("e",)] < 1e-4 and by_unit[("e",)]["b"] < 1e-4


def test_what_one_unit_has_beside_the_common_effect_is_its_own() -> None:
    weights = {"a": {E | F: 1.0}, "b": {E: 1.0}, "c": {E: 1.0}}
    in_all, by_unit = _shared(weights, NOTHING_HIDDEN, ONE)
    assert in_all[("e",)] > 0.99 and in_all[("f",)] < 0.01
    assert by_unit[("f",)] == pytest.approx({"a": 1.0, "b": 0.0, "c": 0.0}, abs=0.01)
