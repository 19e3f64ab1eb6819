"""Stepwise regression against published Hald results, statsmodels, and the claims made for it on drift data."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import statsmodels.api as sm
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import t as student
from statsmodels.stats.outliers_influence import variance_inflation_factor
from statsmodels.stats.stattools import durbin_watson

from bench.analysis.common.stepwise import cochrane_orcutt_rho, stepwise
from drivers.base.errors import ConfigurationError

# Hald, Statistical Theory with Engineering Applications (1952): heat of hardening of cement.
HALD = np.array(
    [
        [7, 26, 6, 60, 78.5],
        [1, 29, 15, 52, 74.3],
        [11, 56, 8, 20, 104.3],
        [11, 31, 8, 47, 87.6],
        [7, 52, 6, 33, 95.9],
        [11, 55, 9, 22, 109.2],
        [3, 71, 17, 6, 102.7],
        [1, 31, 22, 44, 72.5],
        [2, 54, 18, 22, 93.1],
        [21, 47, 4, 26, 115.9],
        [1, 40, 23, 34, 83.8],
        [11, 66, 9, 12, 113.3],
        [10, 68, 8, 12, 109.4],
    ]
)
X, Y = HALD[:, :4], HALD[:, 4]


def test_check_18_hald_with_default_limits_is_matlabs_page() -> None:
    result = stepwise(X, Y)
    assert [(step.action, step.term) for step in result.steps] == [
        ("start", ""),
        ("enter", "x4"),
        ("enter", "x1"),
    ]
    assert [step.p for step in result.steps[1:]] == pytest.approx([0.000576232, 1.10528e-06], rel=1e-5)
    final = result.final
    assert result.selected == ("x1", "x4")
    assert np.allclose(final.coefficient, [1.4400, 0.4161, -0.4100, -0.6140], atol=5e-5)
    assert np.allclose(final.standard_error, [0.1384, 0.1856, 0.1992, 0.0486], atol=5e-5)
    assert final.p_value == pytest.approx([1.1053e-06, 0.0517, 0.0697, 1.8149e-07], abs=5e-5)
    assert final.p_value[[0, 3]] == pytest.approx([1.1053e-06, 1.8149e-07], rel=5e-5)
    assert final.intercept == pytest.approx(103.0974, abs=5e-5)
    assert (result.multiple_r, final.r2, result.adjusted_r2) == pytest.approx(
        (0.98614, 0.972471, 0.966965), abs=5e-6
    )
    assert (final.rmse, result.f, final.sse) == pytest.approx((2.734266, 176.627, 74.7621), rel=1e-6)
    assert result.significance_f == pytest.approx(1.581e-08, rel=1e-3)


def test_check_18_hald_with_a_wider_entry_drops_the_first_term_again() -> None:
    result = stepwise(X, Y, p_enter=0.06)
    moves = [(step.action, step.term) for step in result.steps[1:]]
    assert moves == [("enter", "x4"), ("enter", "x1"), ("enter", "x2"), ("remove", "x4")]
    assert [step.f for step in result.steps[1:]] == pytest.approx(
        [22.7985, 108.2239, 5.0259, 1.8633], abs=5e-5
    )
    assert [step.p for step in result.steps[3:]] == pytest.approx([0.051687, 0.2054], abs=5e-5)
    assert result.selected == ("x1", "x2")


@settings(max_examples=50, deadline=None)
@given(st.integers(12, 60), st.integers(1, 6), st.integers(0, 2**31))
def test_check_18_every_step_equals_statsmodels(count: int, terms: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(5, 2, (count, terms)) @ rng.normal(0, 1, (terms, terms)) + 3.0
    y = x @ rng.normal(0, 1, terms) * rng.integers(0, 2) + rng.normal(0, 2, count)
    for step in stepwise(x, y).steps:
        inside = np.flatnonzero(step.included)
        fit = sm.OLS(y, sm.add_constant(x[:, inside], has_constant="add")).fit()
        assert step.intercept == pytest.approx(fit.params[0], rel=1e-6, abs=1e-6)
        assert np.allclose(step.coefficient[inside], fit.params[1:], rtol=1e-6, atol=1e-9)
        assert np.allclose(step.standard_error[inside], fit.bse[1:], rtol=1e-6)
        assert np.allclose(step.p_value[inside], fit.pvalues[1:], rtol=1e-5, atol=1e-12)
        assert step.rmse == pytest.approx(np.sqrt(fit.mse_resid), rel=1e-7)
        for term in np.flatnonzero(~step.included):
            alone = sm.OLS(y, sm.add_constant(x[:, [*inside, term]], has_constant="add")).fit()
            assert step.coefficient[term] == pytest.approx(alone.params[-1], rel=1e-6)
            assert step.standard_error[term] == pytest.approx(alone.bse[-1], rel=1e-6)
            assert step.p_value[term] == pytest.approx(alone.pvalues[-1], rel=1e-5, abs=1e-12)


def test_table_and_residual_diagnostics_equal_statsmodels() -> None:
    result = stepwise(X, Y)
    fit = sm.OLS(Y, sm.add_constant(X[:, [0, 3]])).fit()
    assert result.f == pytest.approx(fit.fvalue) and result.significance_f == pytest.approx(fit.f_pvalue)
    assert result.adjusted_r2 == pytest.approx(fit.rsquared_adj)
    assert result.durbin_watson == pytest.approx(durbin_watson(fit.resid))
    assert np.allclose(result.predict(X), fit.fittedvalues)
    design = sm.add_constant(X[:, [0, 3]])
    expected = [variance_inflation_factor(design, 1), variance_inflation_factor(design, 2)]
    assert result.vif[[0, 3]] == pytest.approx(expected) and np.isnan(result.vif[[1, 2]]).all()


def ramp_temps() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(378.0)
    case = np.interp(t, [0, 60, 180, 318, 378], [25, -40, -40, 65, 65])
    return case, lfilter([0.12], [1, -0.88], case - 25) + 25


def test_check_19_the_second_temperature_cannot_enter_beside_the_first_and_their_difference() -> None:
    t1, t2 = ramp_temps()
    x = np.column_stack([t1, t2, t1 - t2])
    y = 0.3 * t1 + 0.8 * (t1 - t2) + np.random.default_rng(0).normal(0, 0.1, len(t1))
    result = stepwise(x, y, names=["T1", "T2", "T1-T2"], start=["T1", "T1-T2"])
    assert result.selected == ("T1", "T1-T2")
    assert np.isnan(result.final.p_value[1]) and np.isnan(result.final.coefficient[1])
    # Alone it could: the refusal is about the pair, not about the term.
    assert stepwise(x[:, 1:2], y).selected == ("x1",)


def test_a_constant_term_never_enters() -> None:
    x = np.column_stack([np.full(40, 7.3), np.arange(40.0)])
    assert stepwise(x, 2.0 * np.arange(40.0) + np.random.default_rng(1).normal(size=40)).selected == ("x2",)


def test_check_20_improvement_in_sample_is_one_minus_the_root_of_unexplained_variance() -> None:
    t1, t2 = ramp_temps()
    rng = np.random.default_rng(2)
    y = 2e-4 * t1 + 2e-3 * (t1 - t2) + rng.normal(0, 1.5e-3, len(t1))
    result = stepwise(np.column_stack([t1, t2, t1 * t2]), y)
    improvement = 1.0 - np.std(y - result.predict(np.column_stack([t1, t2, t1 * t2]))) / np.std(y)
    assert improvement == pytest.approx(1.0 - np.sqrt(1.0 - result.final.r2), abs=1e-12)
    # The published pair: R2 = 0.9731 is 83.6 %.
    assert 100 * (1 - np.sqrt(1 - 0.9731)) == pytest.approx(83.6, abs=0.2)


def ar1(rng: np.random.Generator, rho: float, count: int) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -rho], rng.standard_normal(count + 400))[400:])


def false_inclusion(rho: float, *, prewhiten: bool, repeats: int = 120) -> float:
    """Share of unrelated AR(1) = 0.98 terms kept beside a true one, residual AR(1) = rho, n = 378, in percent."""
    rng = np.random.default_rng(3)
    kept = 0
    for _ in range(repeats):
        truth = ar1(rng, 0.98, 378)
        noise = np.column_stack([ar1(rng, 0.98, 378) for _ in range(3)])
        y = truth + ar1(rng, rho, 378) * np.sqrt(1 - rho**2)
        result = stepwise(np.column_stack([truth, noise]), y, prewhiten=prewhiten)
        kept += sum(name != "x1" for name in result.selected)
    return 100.0 * kept / (3 * repeats)


def test_check_21_autocorrelation_lets_noise_in_and_prewhitening_keeps_it_out() -> None:
    assert false_inclusion(0.0, prewhiten=False) == pytest.approx(5.0, abs=3.5)
    assert false_inclusion(0.8, prewhiten=False) > 40.0
    assert false_inclusion(0.8, prewhiten=True) < 10.0


def test_prewhitened_coefficients_and_intercept_are_those_of_the_rows_given() -> None:
    rng = np.random.default_rng(4)
    x = np.column_stack([ar1(rng, 0.98, 4000), ar1(rng, 0.98, 4000)])
    y = 5.0 + 0.7 * x[:, 0] + ar1(rng, 0.8, 4000) * 0.3
    result = stepwise(x, y, prewhiten=True)
    assert result.whitening_rho == pytest.approx(0.8, abs=0.03)
    assert result.selected[0] == "x1" and result.final.coefficient[0] == pytest.approx(0.7, abs=0.02)
    assert result.final.intercept == pytest.approx(5.0, abs=0.15)
    assert result.lag1_correlation == pytest.approx(0.0, abs=0.05)
    assert result.durbin_watson == pytest.approx(2.0, abs=0.1)


def test_neighbours_are_not_sought_across_runs() -> None:
    rng = np.random.default_rng(5)
    x = rng.normal(size=(400, 1))
    levels = np.repeat([0.0, 0.0], 200)
    y = x[:, 0] + rng.normal(size=400) * 0.1 + levels
    y[200:] *= -1.0  # a second run that begins with another sign
    parts = np.repeat([0, 1], 200)
    result = stepwise(x, y, prewhiten=True, segments=parts)
    assert result.n == 398
    assert abs(cochrane_orcutt_rho(x, y, parts)) < 0.2


def test_effective_number_of_rows() -> None:
    rng = np.random.default_rng(6)
    result = stepwise(rng.normal(size=(5000, 1)), ar1(rng, 0.8, 5000), p_enter=1e-9)
    assert result.selected == ()
    assert result.lag1_correlation == pytest.approx(0.8, abs=0.03)
    assert result.effective_n == pytest.approx(5000 / 9, rel=0.2)


@pytest.mark.parametrize(
    ("x", "y"),
    [(np.zeros((5, 3)), np.zeros(5)), (np.full((20, 1), np.nan), np.zeros(20)), (np.zeros(9), np.zeros(9))],
)
def test_unusable_input_is_refused(x: np.ndarray, y: np.ndarray) -> None:
    with pytest.raises(ConfigurationError, match="cannot be used"):
        stepwise(x, y)


def term_of(p_value: float, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Terms (count, 1) and values (count,) whose regression has that p-value, by Student's distribution."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=count)
    x -= x.mean()
    left = rng.normal(size=count)
    left -= left.mean()
    left -= x * (x @ left) / (x @ x)
    ratio = student.isf(p_value / 2.0, count - 2)
    slope = ratio * np.sqrt(left @ left / (count - 2) / (x @ x))
    return x[:, None], 3.0 + slope * x + left


@pytest.mark.parametrize(
    ("p_value", "p_enter", "kept"),
    [
        (0.099, 0.05, True),
        (0.101, 0.05, False),
        (0.099, 0.01, True),
        (0.101, 0.01, False),
        (0.149, 0.15, True),  # what would enter is not thrown out
        (0.151, 0.15, False),
    ],
)
def test_a_term_leaves_from_a_tenth_on_unless_it_would_enter(
    p_value: float, p_enter: float, kept: bool
) -> None:
    x, y = term_of(p_value)
    result = stepwise(x, y, start=["x1"], p_enter=p_enter)
    assert result.steps[0].p_value == pytest.approx([p_value], rel=1e-9)
    assert result.selected == (("x1",) if kept else ())


@pytest.mark.parametrize(("p_value", "entered"), [(0.0499, True), (0.0501, False)])
def test_a_term_enters_below_a_twentieth(p_value: float, entered: bool) -> None:
    x, y = term_of(p_value)
    assert stepwise(x, y).selected == (("x1",) if entered else ())


def test_a_term_that_enters_and_leaves_for_ever_ends_the_search_where_it_was_before() -> None:
    """Whoever lets in at p < 0.9 and puts out at p > 0.1 would go round without end."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=(200, 3))
    y = x[:, 0] + rng.normal(size=200)
    result = stepwise(x, y, p_enter=0.9, p_remove=0.1)
    assert "x1" in result.selected and len(result.steps) < 10


@pytest.mark.parametrize(
    ("names", "start", "rows"),
    [
        (["a", "b", "c", "d"], [], 9),
        (["a", "b"], [], 9),
        (["a", "b", "b"], [], 9),
        (["a", "b", "c"], ["d"], 9),
        (["a", "b", "c"], [], 5),
    ],
)
def test_input_that_does_not_fit_together_is_refused(names: list[str], start: list[str], rows: int) -> None:
    x = np.random.default_rng(0).normal(size=(rows, 3))
    with pytest.raises(ConfigurationError, match="input cannot be used") as refused:
        stepwise(x, x[:, 0], names=names, start=start)
    assert f"{len(names)} names" in refused.value.found


def test_a_term_across_everything_has_a_probability_of_one() -> None:
    """Orthogonal to the output and the mean: its F is zero."""
    x = np.array([[1.0], [-1.0], [-1.0], [1.0]])
    result = stepwise(x, np.array([1.0, 1.0, -1.0, -1.0]))
    assert result.final.p_value.tolist() == [1.0] and result.selected == ()


def test_one_degree_of_freedom_still_has_a_probability() -> None:
    """Four rows are three after prewhitening. Student's t with one degree is Cauchy's: p = 1 - 2/pi atan |t|."""
    x, y = np.array([[0.0], [1.0], [3.0], [4.0]]), np.array([0.03, 1.08, 3.03, 3.87])
    result = stepwise(x, y, prewhiten=True, start=["x1"], p_remove=1.0)
    final = result.final
    assert result.n == 3
    t = final.coefficient[0] / final.standard_error[0]
    assert final.p_value[0] == pytest.approx(1.0 - 2.0 / np.pi * np.arctan(abs(t)), rel=1e-9)


def test_the_labels_of_runs_may_fall() -> None:
    rng = np.random.default_rng(8)
    x, y = rng.normal(size=(40, 1)), rng.normal(size=40)
    rising, falling = (stepwise(x, y, segments=np.repeat(labels, 20)) for labels in ((0, 1), (1, 0)))
    assert rising.durbin_watson == falling.durbin_watson
    assert rising.durbin_watson != stepwise(x, y).durbin_watson


def test_terms_that_nearly_coincide_have_seven_digits() -> None:
    """Two terms that differ by 5e-9 of their size, solved exactly in fractions."""
    rng = np.random.default_rng(9)
    first = rng.normal(size=30)
    x = np.column_stack([first, first + 5e-9 * rng.normal(size=30)])
    y = first + 3e7 * (x[:, 1] - x[:, 0]) + 0.01 * rng.normal(size=30)
    rows = [[Fraction(value) for value in column] for column in (*x.T, y)]
    a, b, c = ([value - sum(row) / 30 for value in row] for row in rows)
    aa, ab, bb, ac, bc = (
        sum(p * q for p, q in zip(*pair, strict=True)) for pair in ((a, a), (a, b), (b, b), (a, c), (b, c))
    )
    exact = [
        float((ac * bb - bc * ab) / (aa * bb - ab * ab)),
        float((bc * aa - ac * ab) / (aa * bb - ab * ab)),
    ]
    found = stepwise(x, y, start=["x1", "x2"], p_remove=1.0).final.coefficient
    assert found.tolist() == pytest.approx(exact, rel=1e-7)


def test_without_a_term_nothing_is_explained_and_with_an_exact_one_everything() -> None:
    rng = np.random.default_rng(11)
    x, noise = rng.normal(size=(40, 2)), rng.normal(size=40)
    none = stepwise(x, noise, p_enter=1e-9)
    assert none.selected == () and (none.f, none.significance_f) == (0.0, 1.0)
    assert (none.final.r2, none.adjusted_r2) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert np.isnan(none.vif).all() and none.predict(x) == pytest.approx(np.full(40, noise.mean()))
    for _ in range(30):  # rounding leaves a little more or less than nothing
        term = rng.normal(size=(12, 1))
        exact = stepwise(term, 2.0 * term[:, 0] + 1.0)
        assert exact.selected == ("x1",) and exact.final.coefficient == pytest.approx([2.0])
        assert exact.final.r2 <= 1.0 and 0.0 <= exact.final.rmse < 1e-6 and exact.f > 1e9
        assert exact.significance_f == pytest.approx(0.0, abs=1e-12) and exact.vif == pytest.approx([1.0])
