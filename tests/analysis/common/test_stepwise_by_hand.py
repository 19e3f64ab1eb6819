"""The correlation that is taken off before terms are chosen, against sums written out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.common.stepwise import _lag1_correlation, _next_move, _whitened, cochrane_orcutt_rho
from drivers.base.errors import ConfigurationError


def chain(rho, n, seed):
    rng = np.random.default_rng(seed)
    values = [rng.normal()]
    for _ in range(n - 1):
        values.append(rho * values[-1] + rng.normal())
    return np.array(values)


def iterated(x, y, times):
    """Cochrane and Orcutt's iteration: a line through differences, the correlation of what it leaves."""
    rho = 0.0
    for _ in range(times):
        a, b = (x[1:] - rho * x[:-1], y[1:] - rho * y[:-1]) if rho else (x, y)
        slope = np.polyfit(a, b, 1)[0]
        left = y - slope * x
        left = left - left.mean()
        rho = float(np.sum(left[1:] * left[:-1]) / np.sum(left[:-1] ** 2))
    return rho


def test_a_correlation_is_iterated_until_it_stands_still():
    x = chain(0.95, 60, 55)
    y = 2.0 * x + chain(0.9, 60, 5)
    column, parts = x[:, None], np.zeros(60)
    steps = [iterated(x, y, times) for times in range(1, 10)]
    found = cochrane_orcutt_rho(column, y, parts)
    # it changes by a quarter of the last change each time, and by less than 1e-4 in the eighth
    assert found == pytest.approx(steps[7], abs=1e-9) and steps[7] - steps[6] < 1e-4 < steps[6] - steps[5]
    change = steps[1] - steps[0]
    # the first change counts from nothing, the second one is small enough
    assert cochrane_orcutt_rho(column, y, parts, tolerance=10.0) == pytest.approx(steps[0], rel=1e-9)
    assert cochrane_orcutt_rho(column, y, parts, tolerance=2.0 * change) == pytest.approx(steps[1], rel=1e-9)
    assert cochrane_orcutt_rho(column, y, parts, tolerance=0.0, iterations=3) == pytest.approx(
        steps[2], rel=1e-9
    )
    assert cochrane_orcutt_rho(column, y, parts, iterations=1) == pytest.approx(steps[0], rel=1e-9)


def test_a_column_about_zero_is_no_other_than_one_about_a_thousand():
    x = np.tile([1.0, -1.0, 2.0, -2.0], 50)
    y = 3.0 * x + chain(0.5, 200, 7)
    parts = np.zeros(200)
    found = cochrane_orcutt_rho(x[:, None], y, parts)
    assert found == pytest.approx(iterated(x, y, 10), abs=1e-4)
    assert cochrane_orcutt_rho(1000.0 + x[:, None], y, parts) == pytest.approx(found, abs=1e-9)
    still = np.column_stack((x, np.full(200, 5.0)))
    assert cochrane_orcutt_rho(still, y, parts) == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize(
    ("share", "refused"), [(0.9985, False), (0.9995, True), (-0.9985, False), (-0.9995, True)]
)
def test_what_walks_at_random_is_refused(share, refused):
    """A residual that falls by the same share each step, beside a column that explains nothing of it."""
    y = 1e3 * share ** np.arange(40.0)
    y = np.concatenate((y, -y))
    parts = np.repeat([0, 1], 40)
    x = np.zeros((80, 1))
    if refused:
        with pytest.raises(ConfigurationError, match="random walk" if share > 0.0 else "alternates") as error:
            cochrane_orcutt_rho(x, y, parts)
        assert error.value.found == f"lag-1 correlation {share:.4f}"
    else:
        assert cochrane_orcutt_rho(x, y, parts) == pytest.approx(share, abs=1e-9)


def test_neighbours_are_of_one_run_and_differences_of_them():
    parts = np.array([4, 4, 4, 1, 1, 9])
    left = np.array([1.0, 2.0, -1.0, 5.0, 3.0, 8.0])
    assert _lag1_correlation(left, parts) == pytest.approx((2.0 - 2.0 + 15.0) / (1.0 + 4.0 + 25.0))
    assert _lag1_correlation(left[:1], parts[:1]) == 0.0 == _lag1_correlation(np.zeros(3), parts[:3])
    x, y, labels = _whitened(left[:, None], 10.0 * left, parts, 0.5)
    assert x[:, 0].tolist() == [1.5, -2.0, 0.5] and y.tolist() == [15.0, -20.0, 5.0]
    assert labels.tolist() == [4, 4, 1]


@pytest.mark.parametrize(
    ("p_values", "inside", "move"),
    [
        ([0.5, 0.0, 0.0, 0.2], [], ("enter", 1)),
        ([0.04, 0.01, 0.03, 0.01], [], ("enter", 1)),
        ([0.01 * (1.0 + 1e-7), 0.01, 0.2, 0.3], [], ("enter", 0)),
        ([0.01 * (1.0 + 1e-5), 0.01, 0.2, 0.3], [], ("enter", 1)),
        ([0.05, 0.06, 0.2, 0.3], [], None),
        ([np.nan, 0.06, 0.2, 0.04], [], ("enter", 3)),
        ([0.3, 0.06, 0.4, 0.2], [0, 2], ("remove", 2)),
        ([0.4 * (1.0 - 1e-7), 0.06, 0.4, 0.2], [0, 2], ("remove", 0)),
        ([0.4 * (1.0 - 1e-5), 0.06, 0.4, 0.2], [0, 2], ("remove", 2)),
        ([0.3, 0.04, 0.4, 0.2], [0, 2], ("enter", 1)),
        ([0.1, 0.05, 0.1, 0.1], [0, 2], None),
        ([0.0, 0.0, 0.0, 0.0], [0, 1, 2, 3], None),
    ],
)
def test_the_likeliest_term_enters_before_the_least_likely_leaves_and_of_equal_ones_the_first(
    p_values, inside, move
):
    """Limits of 0.05 and 0.10, which themselves move nothing; a probability may have run out of digits."""
    included = np.isin(np.arange(4), inside)
    step = SimpleNamespace(included=included, p_value=np.array(p_values))
    assert _next_move(step, 0.05, 0.10) == move
