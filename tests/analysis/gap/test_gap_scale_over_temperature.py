"""A scale factor that follows a temperature by a form of no formula of the catalogue."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import diagnose
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array
from tests.analysis.gap.conftest import made_run, stimulus


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
