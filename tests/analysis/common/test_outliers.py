"""Single values that stand far off: found wherever they are, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.common.outliers import RARE, outliers


def test_what_stays_is_no_outlier() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1.0, 20_000)
    assert not len(outliers(noise)[0])
    assert not len(outliers(np.round(noise / 3.0))[0])  # steps of three sigma
    assert not len(outliers(noise + 100.0 * (np.arange(20_000) > 7_000))[0])
    assert not len(outliers(noise + 0.3 * np.arange(20_000))[0])
    tails = noise + 100.0 * (rng.random(20_000) < 0.02)
    assert not len(outliers(tails, most=RARE)[0])
    assert not len(outliers(np.zeros(100))[0]) and not len(outliers(noise[:31])[0])


@given(
    places=st.lists(st.integers(0, 199), min_size=1, max_size=3, unique=True).map(
        lambda p: [5 * k for k in p]
    ),
    size=st.floats(30.0, 1e6),
    holes=st.sets(st.integers(0, 999), max_size=50),
)
def test_single_values_are_found_wherever_they_are(places: list[int], size: float, holes: set[int]) -> None:
    values = np.random.default_rng(5).normal(0.0, 1.0, 1000)
    values[places] += size
    values[sorted(holes - set(places))] = np.nan
    at, off = outliers(values)
    assert sorted(at.tolist()) == sorted(places)
    assert off == pytest.approx([values[k] for k in at], abs=6.0)


def test_many_are_outliers_where_any_number_may_be() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(0.0, 1.0, 20_000)
    odd = np.flatnonzero(rng.random(20_000) < 0.02)
    values[odd] += 100.0
    at, off = outliers(values)
    alone = odd[(np.diff(odd, prepend=-9) > 2) & (np.diff(odd, append=20_009) > 2)]
    assert set(alone) <= set(at.tolist()) <= set(odd.tolist())
    assert np.abs(off - 100.0).max() < 8.0
