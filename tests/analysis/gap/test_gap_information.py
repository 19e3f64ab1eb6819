"""Expected information: against the exact information by sampling, and against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from bench.analysis.gap._information import Foretold, deflection, expected_if, expected_information

COLUMNS = np.array([[1.0, 0.2], [0.0, 0.7], [0.5, -0.3]])
"""Three whitened samples of two columns."""
GRAM = COLUMNS.T @ COLUMNS


def foretold(probability, mean=(0.0, 0.0), sigmas=(0.0, 0.0)):
    return Foretold(probability, np.array(mean), np.diag(sigmas))


def sampled_information(explanations, rng, count=40_000):
    """Mutual information of explanation and data, in nats, from draws of both and exact densities."""
    weights = np.array([each.probability for each in explanations])
    densities = [
        multivariate_normal(
            COLUMNS @ each.mean, np.eye(3) + (COLUMNS @ each.root) @ (COLUMNS @ each.root).T, seed=rng
        )
        for each in explanations
    ]
    total = 0.0
    for weight, own in zip(weights, densities, strict=True):
        drawn = own.rvs(count)
        mixture = sum(w * each.pdf(drawn) for w, each in zip(weights, densities, strict=True))
        total += weight * float(np.mean(own.logpdf(drawn) - np.log(mixture)))
    return total


@given(
    mean=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    sigma=st.floats(0.0, 6.0),
    weight=st.floats(0.1, 0.9),
)
def test_it_is_never_negative_nor_above_the_entropy(mean, sigma, weight):
    explanations = [foretold(1.0 - weight), foretold(weight, mean, (sigma, 0.0))]
    entropy = -sum(p * math.log(p) for p in (weight, 1.0 - weight))
    assert -1e-12 <= expected_information(GRAM, explanations) <= entropy + 1e-12


@pytest.mark.parametrize(
    "explanations",
    [
        [foretold(0.5), foretold(0.5, (1.5, 0.0))],
        [foretold(0.6), foretold(0.3, sigmas=(4.0, 0.0)), foretold(0.1, sigmas=(0.0, 9.0))],
        [foretold(0.7, (1.0, 1.0)), foretold(0.3, (1.0, 1.0), (3.0, 0.0))],
    ],
)
def test_it_is_near_the_exact_information(explanations):
    exact = sampled_information(explanations, np.random.default_rng(5))
    # between a bound below and one above: with little information and two explanations the mean is too high
    assert 0.9 * exact < expected_information(GRAM, explanations) < 1.45 * exact


def test_what_foretells_the_same_tells_nothing_and_what_is_far_apart_tells_all():
    same = [foretold(0.5, (2.0, 1.0)), foretold(0.5, (2.0, 1.0))]
    assert expected_information(GRAM, same) == pytest.approx(0.0, abs=1e-12)
    apart = [foretold(0.25), foretold(0.75, sigmas=(1e6, 0.0))]
    entropy = -sum(p * math.log(p) for p in (0.25, 0.75))
    assert expected_information(GRAM, apart) == pytest.approx(entropy, rel=0.01)


def test_a_formula_that_may_miss_a_quarter_tells_no_more_with_ten_times_the_signal():
    """The square of a distance is limited to 8 / 0.25^2 = 128, and its eighth counts."""
    pairs = [[foretold(0.5), foretold(0.5, (size, 0.0))] for size in (1e3, 1e4)]
    limits = [-math.log(0.5 * (1.0 + math.exp(-0.125 * 128.0)))] * 2
    assert [expected_information(GRAM, pair) for pair in pairs] == pytest.approx(limits, rel=1e-3)


def test_deflection_is_the_norm_of_the_foretold_samples():
    mean = np.array([1.2, -0.4])
    assert deflection(GRAM, mean) == pytest.approx(float(np.linalg.norm(COLUMNS @ mean)))


def test_what_a_run_leaves_if_one_explanation_is_true_follows_from_the_divergence():
    """Against a second mean: half its square; against a hidden effect: the exact integral."""
    near = [foretold(0.5), foretold(0.5, (0.1, 0.0))]
    odds = 0.5 * 0.01 * GRAM[0, 0]
    true = 1.0 / (1.0 + math.exp(-odds))
    assert expected_if(GRAM, near, 0) == pytest.approx([true, 1.0 - true], rel=1e-3)
    hidden = [foretold(0.8), foretold(0.2, sigmas=(3.0, 0.0))]
    cov = np.eye(3) + 9.0 * np.outer(COLUMNS[:, 0], COLUMNS[:, 0])
    lost = 0.5 * (np.trace(np.linalg.inv(cov)) - 3.0 + math.log(np.linalg.det(cov)))
    left = 0.2 * math.exp(-lost)
    assert expected_if(GRAM, hidden, 0) == pytest.approx([0.8 / (0.8 + left), left / (0.8 + left)])
    # a run that shows nothing leaves the probabilities as they are
    assert expected_if(np.zeros((2, 2)), hidden, 0) == pytest.approx([0.8, 0.2])


def test_the_spread_of_the_leading_effect_itself_is_no_evidence_against_another_beside_it():
    """What both share cancels: a run that cannot show the hidden effect leaves the probabilities as they are."""
    apart = np.diag([4.0, 0.0])
    both = [foretold(0.8, (2.0, 0.0), (1.5, 0.0)), foretold(0.2, (2.0, 0.0), (1.5, 5.0))]
    assert expected_if(apart, both, 0) == pytest.approx([0.8, 0.2])
    # one that shows it: as without the leading effect
    shown = np.diag([4.0, 3.0])
    alone = [foretold(0.8), foretold(0.2, sigmas=(0.0, 5.0))]
    assert expected_if(shown, both, 0) == pytest.approx(expected_if(shown, alone, 0))
    # an explanation that foretells more narrowly gains nothing if the other is true
    narrow = [foretold(0.8, (2.0, 0.0), (5.0, 0.0)), foretold(0.2, (2.0, 0.0))]
    assert expected_if(shown, narrow, 0) == pytest.approx([0.8, 0.2])
