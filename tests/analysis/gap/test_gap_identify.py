"""What runs can show before they are diagnosed, against plain least squares in time."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from bench.analysis.gap import Model, identifiable, identifiable_facts
from drivers.base.errors import ConfigurationError
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus


def _shocks(rates_dps: tuple[float, ...]) -> list:
    rng = np.random.default_rng(7)
    return [
        made_run(f"{rate} {repeat}", stimulus(rate_dps=rate), rng, condition=f"{rate}")
        for rate in rates_dps
        for repeat in range(2)
    ]


@pytest.fixture(scope="module")
def turned() -> list:
    return _shocks((10.0, -10.0, 0.0))


def test_least_size_is_that_of_least_squares(turned: list, nominal: Model) -> None:
    found = {each.effect: each for each in identifiable(turned, nominal)}
    lag = effect("scale_factor_lag")
    size = found["scale_factor_lag"].least["sf_ppm_per_k"]
    sizes = []
    for shape in lag.shapes:
        rows, columns = [], []
        for bias, run in zip(np.eye(len(turned)), turned, strict=True):
            own_bias = bias[:, None] * np.ones(len(run.stimulus))
            columns.append(np.concatenate((nominal.columns(run.stimulus), own_bias)))
            rows.append(Variant(lag, shape).columns(run.stimulus)[0])
        column, whole = np.concatenate(rows), np.concatenate(columns, axis=1).T
        scale = np.linalg.norm(whole, axis=0)
        left = column - whole / scale @ np.linalg.lstsq(whole / scale, column, rcond=1e-10)[0]
        sizes.append(10.0 * 0.24 / float(np.linalg.norm(left)))
    assert min(abs(size / each - 1.0) for each in sizes) < 0.1


def test_what_does_not_move_is_not_seen(nominal: Model) -> None:
    found = {each.effect: each for each in identifiable(_shocks((0.0,)), nominal)}
    for name in ("scale_factor_asymmetry", "saturation", "table_wobble_once", "time_offset"):
        assert found[name].reason
        assert not found[name].least
        assert not found[name].alike
    assert not found["hysteresis"].reason


def test_effects_that_do_the_same_are_named(turned: list, nominal: Model) -> None:
    found = {each.effect: each for each in identifiable(turned, nominal)}
    for each in found.values():
        for other, left in each.alike.items():
            assert other != each.effect
            assert 0.0 <= left < 1.0 / 16.0
    # the second column of the Shupe effect is the rate of the gradient: late gradients are among its forms
    assert "shupe" in found["gradient"].alike
    assert "gradient" not in found["scale_factor_asymmetry"].alike


def test_json_has_numbers_only(turned: list, nominal: Model) -> None:
    facts = json.loads(json.dumps(identifiable_facts(identifiable(turned, nominal)), allow_nan=False))
    assert {"effect", "least", "alike", "reason"} == set(facts["effects"][0])
    assert all(math.isfinite(size) for each in facts["effects"] for size in each["least"].values() if size)


def test_runs_of_a_platform_are_refused(nominal: Model) -> None:
    with pytest.raises(ConfigurationError, match="no rate"):
        identifiable([], nominal)
