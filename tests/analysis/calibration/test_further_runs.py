"""A calibration after others: both together against one joint estimate, and what changed between them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.calibration import (
    PARAMETER_NAMES,
    PARAMETERS,
    ImuCompensation,
    Noise,
    Task,
    after,
    calibrate,
)
from bench.analysis.calibration._estimator import Estimate
from bench.analysis.calibration._further import changes, together
from bench.analysis.common.compensation import UnitMismatch, provenance
from drivers.base.errors import ConfigurationError

TASK = Task()
SCALE = TASK.prior_sigma[PARAMETERS]


class Linear:
    """Runs that measure the parameters linearly: rows in units of the prior, noise of one; prior mean zero."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        # the last parameters are hardly seen by the first run, the first by the second
        self.rows = [self.rng.standard_normal((40, 24)) * 10.0 ** np.linspace(*ends, 24) for ends in ENDS]
        self.truth = self.rng.standard_normal(24)

    def told(self, number, truth=None):
        """Return rows and measurements of a run."""
        rows = self.rows[number]
        return rows, rows @ (self.truth if truth is None else truth) + self.rng.standard_normal(len(rows))


ENDS = ((2.0, -2.0), (-2.0, 2.0))


def posterior(*runs):
    """Return mean and covariance, SI, of all rows and measurements at once."""
    information = np.eye(24) + sum(rows.T @ rows for rows, _ in runs)
    covariance = np.linalg.inv(information)
    mean = covariance @ sum(rows.T @ values for rows, values in runs)
    return mean * SCALE, covariance * np.outer(SCALE, SCALE)


def estimated(*runs):
    mean, covariance = posterior(*runs)
    sigma = np.sqrt(np.diag(covariance))
    course = np.zeros((1, 24))
    return Estimate(mean, sigma, covariance, np.zeros((2, 3)), 0.0, course, 1.0, course, np.zeros(1))


def kept(found, run="first"):
    names = ("parameters", "sigma", "covariance", "lever_m", "lag_s", "innovation_rms")
    values = {name: getattr(found, name) for name in names}
    return ImuCompensation("U-1", **values, scheme="s", **provenance({run: "sum"}))


def test_runs_together_are_one_estimate_from_all_their_rows():
    world = Linear(1)
    first, second, third = world.told(0), world.told(1), world.told(0)
    earlier = [kept(estimated(first)), kept(estimated(second), "second")]
    joint = together(estimated(third), TASK, earlier)
    expected = estimated(first, second, third)
    np.testing.assert_allclose(joint.covariance / expected.covariance, 1.0, rtol=1e-5)
    np.testing.assert_allclose(joint.parameters, expected.parameters, rtol=1e-5)
    np.testing.assert_allclose(joint.sigma, expected.sigma, rtol=1e-6)
    # what a search counts with is the information of the rows
    known = after(TASK, earlier).known
    np.testing.assert_allclose(known, sum(rows.T @ rows for rows, _ in (first, second)), rtol=1e-4, atol=1e-3)


def test_differences_of_runs_that_see_other_things_scatter_as_foretold_and_a_change_is_named():
    """About one pair of runs in 700 has a difference beyond four sigma; a change of eight is found."""
    alarms = 0
    for seed in range(300):
        world = Linear(seed)
        first, second = world.told(0), world.told(1)
        alarms += bool(changes(estimated(second), TASK, kept(estimated(first))))
    assert alarms <= 3
    world = Linear(5)
    moved = world.truth.copy()
    at = 11  # both runs see it
    own = [np.sqrt(np.diag(posterior(world.told(k))[1]))[at] / SCALE[at] for k in (0, 1)]
    moved[at] += 8.0 * np.hypot(*own)
    (text, *_) = changes(estimated(world.told(1, moved)), TASK, kept(estimated(world.told(0))))
    assert text.startswith(f"{PARAMETER_NAMES[at]} changed since first by ")


def test_a_covariance_that_says_nothing_is_refused():
    world = Linear(2)
    good = estimated(world.told(0))
    for covariance in (good.covariance * 1e9, -good.covariance, good.covariance * np.nan):
        with pytest.raises(ConfigurationError, match="does not say what it knows"):
            after(TASK, [kept(replace(good, covariance=covariance))])


def test_a_run_counts_once_and_another_unit_not_at_all():
    earlier = kept(estimated(Linear(3).told(0)))
    with pytest.raises(ConfigurationError, match="in the earlier calibration already"):
        calibrate(SimpleNamespace(unit_id="U-1", run_id="first"), Noise(), earlier=[earlier])
    with pytest.raises(UnitMismatch, match="U-2"):
        calibrate(SimpleNamespace(unit_id="U-2", run_id="second"), Noise(), earlier=[earlier])
