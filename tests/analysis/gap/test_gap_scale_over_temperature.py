"""A scale factor that follows a temperature by a form of no formula of the catalogue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import diagnose
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus


def _runs(ppm_at: Callable[[Array], Array], seed: int) -> list[GapRun]:
    """Two repeats at 10 deg/s each way through a cold shock; the scale factor follows a place between sensors."""
    rng = np.random.default_rng(seed)
    made = []
    for rate_dps in (10.0, -10.0):
        s = stimulus(3600, rate_dps=rate_dps)
        between_c = s.lagged(s.t_out_c, 120.0)
        for repeat in range(2):
            name = f"{rate_dps:+.0f} {repeat}"
            ppm = ppm_at(between_c)
            made.append(made_run(name, s, rng, 1e-6 * ppm * s.input_rate_dph, condition=f"{rate_dps:+.0f}"))
    return made


@pytest.mark.parametrize("seed", [1, 2])
def test_a_cooler_out_of_range_is_a_scale_factor_that_follows_temperature(nominal: Model, seed: int) -> None:
    """Flat down to -5 degC and a straight line below."""
    found = diagnose(_runs(lambda t_c: 0.6 * np.maximum(-5.0 - t_c, 0.0), seed), nominal).rate
    named = [{cause.name, *cause.one_of} for cause in found.causes]
    assert len(named) == 1 and named[0] <= {"scale_factor_temperature", "scale_factor_quadratic"}
    assert found.verdict == "explained"


def test_fringes_of_a_scale_factor_have_no_name(nominal: Model) -> None:
    """Two and a half periods over the span: no line and no square is near it."""
    found = diagnose(_runs(lambda t_c: 15.0 * np.sin(2.0 * np.pi * t_c / 26.0), 3), nominal).rate
    assert found.causes == () and found.verdict == "unknown"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_scale_factor_that_bends_a_little_follows_temperature(nominal: Model, seed: int) -> None:
    """Soaks at -18, 32, 68 degC; more than twice as steep in the warm. No slow follower's transient is it."""
    rng, at_s, n = np.random.default_rng(seed), (0, 1500, 3500, 5000, 6500, 9000), 9000
    t_c = np.interp(np.arange(n), at_s, (-18.0, -18.0, 32.0, 32.0, 68.0, 68.0))
    rate_dps = np.where(np.arange(n) // 300 % 2, -30.0, 30.0)
    flat = stimulus(n, cold=False)
    s = replace(flat, t_in_c=t_c, t_out_c=t_c, angle_deg=np.concatenate(([0.0], np.cumsum(rate_dps))))
    above = (t_c - 25.0) / 50.0
    gap = 1e-6 * -5.0 * (above + 0.5 * above**2) * s.input_rate_dph
    found = diagnose([made_run(str(k), s, rng, gap) for k in range(2)], nominal).rate
    assert [cause.name for cause in found.causes] == ["scale_factor_temperature"]
    assert found.causes[0].probability > 0.9


def test_the_slope_of_a_bent_scale_factor_is_as_told() -> None:
    bent = effect("scale_factor_temperature")
    s = stimulus(3600, rate_dps=10.0)
    for bend in (-0.8, 0.8):
        (ppm_per_unit,) = Variant(bent, {"lag_s": 0.0, "bend": bend}).columns(s)
        ppm = ppm_per_unit / (1e-6 * s.input_rate_dph)
        cooling = slice(1000, 1300)
        slope = np.diff(ppm[cooling]) / np.diff(s.warm_k[cooling])
        # d/dT of 50 K (e^(b x) - 1) / b at x = (T - 25 degC) / 50 K
        between_k = 0.5 * (s.warm_k[cooling][1:] + s.warm_k[cooling][:-1])
        assert slope == pytest.approx(np.exp(bend * between_k / 50.0), rel=1e-4)
