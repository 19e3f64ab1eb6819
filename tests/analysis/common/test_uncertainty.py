"""Budgets against the printed examples of JCGM 100, JCGM 101 and EA-4/02."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.common.uncertainty import Budget, Contribution


def test_the_end_gauge_of_the_gum() -> None:
    """JCGM 100, H.1: u_c = 32 nm, 16 effective degrees of freedom, k = 2.92 for 99 %, U = 93 nm."""
    budget = Budget(
        50_000_623.0,
        (
            Contribution("standard", 25.0, freedom=18.0, unit="nm"),
            Contribution("repeated observations", 5.8, freedom=24.0, kind="A"),
            Contribution("comparator, random", 3.9, freedom=5.0),
            Contribution("comparator, systematic", 6.7, freedom=8.0),
            Contribution("difference of expansion", 0.58e-6, 5e6, "1/degC", freedom=50.0),
            Contribution("difference of temperature", 0.029, 575.0, "degC", freedom=2.0),
            Contribution("expansion", 1.2e-6, 0.0),
        ),
        0.99,
    )
    assert round(budget.combined) == 32 and math.floor(budget.freedom) == 16
    assert budget.k == pytest.approx(2.92, abs=0.005) and round(budget.expanded) == 93
    assert sum(budget.share(item) for item in budget.contributions) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("stated", "rows", "value", "combined"),
    [
        # EA-4/02 S2, a weight of 10 kg, in g and mg: u = 29.3 mg
        (0.0, [(10_000_005.0, 22.5), (20.0, 14.4), (0.0, 8.95), (0.0, 5.77), (0.0, 5.77)], 10_000_025.0, 29.3),
        # EA-4/02 S4, a gauge block of 50 mm, in nm: 49.999 926 mm, u = 36.4 nm
        (
            0.0,
            [(50e6 + 20, 15.0), (0, 17.3), (-94.0, 5.37), (0, 18.5), (0, 16.6), (0, 11.8), (0, 3.87)],
            49_999_926.0,
            36.4,
        ),
    ],
)  # fmt: skip
def test_examples_of_ea_4_02(
    stated: float, rows: list[tuple[float, float]], value: float, combined: float
) -> None:
    budget = Budget(stated, tuple(Contribution("", u, estimate=x) for x, u in rows))
    assert budget.value == pytest.approx(value, abs=1e-6) and budget.combined == pytest.approx(
        combined, rel=3e-3
    )


@pytest.mark.parametrize(
    ("distribution", "last", "gum", "monte_carlo"),
    [
        ("normal", 1.0, 3.92, 3.92),  # JCGM 101, table 2
        ("rectangular", 1.0, 3.92, 3.88),  # table 3
        ("rectangular", 10.0, 19.9, 17.0),  # table 4: the linear sum and k say too much
    ],
)
def test_the_additive_model_of_jcgm_101(
    distribution: str, last: float, gum: float, monte_carlo: float
) -> None:
    inputs = [Contribution("", u, distribution=distribution) for u in (1.0, 1.0, 1.0, last)]
    budget = Budget(0.0, tuple(inputs))
    assert budget.expanded == pytest.approx(gum, abs=0.005 * last)
    half = np.quantile(np.abs(budget.draws(1_000_000)), 0.95)
    assert half == pytest.approx(monte_carlo, abs=0.01 * max(1.0, last / 2))
    assert budget.half_width == pytest.approx(monte_carlo, rel=0.01)


@pytest.mark.parametrize(
    ("distribution", "outside"), [("triangular", 0.25), ("arcsine", 2.0 / 3.0), ("exponential", None)]
)
def test_other_distributions_are_drawn(distribution: str, outside: float | None) -> None:
    """Beyond half of its half width lie 1/4 of a triangular and 2/3 of an arcsine distribution."""
    budget = Budget(3.0, (Contribution("", 2.0, 0.5, distribution=distribution),))
    draws = budget.draws(200_000) - 3.0
    assert draws.mean() == pytest.approx(0.0, abs=0.01) and draws.std() == pytest.approx(1.0, abs=0.01)
    if outside is None:
        assert draws.min() >= -1.0
    else:
        half_width = {"triangular": math.sqrt(6.0), "arcsine": math.sqrt(2.0)}[distribution]
        assert np.mean(np.abs(draws) > 0.5 * half_width) == pytest.approx(outside, abs=0.01)


def test_few_degrees_of_freedom_widen_the_interval() -> None:
    """Student's t at 4 degrees of freedom: 2.776 (JCGM 100, table G.2); one alone is the whole budget."""
    budget = Budget(1.0, (Contribution("mean of five", 0.1, kind="A", freedom=4.0),))
    assert budget.freedom == pytest.approx(4.0) and budget.expanded == pytest.approx(0.2776, abs=1e-4)
    assert np.quantile(np.abs(budget.draws(1_000_000) - 1.0), 0.95) == pytest.approx(0.2776, rel=0.01)
    assert Budget(1.0, ()).expanded == 0.0
