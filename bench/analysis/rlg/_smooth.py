"""The smooth form: curves, drives and memory regressed with a spread from run to run; what it can promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtri, stdtrit

from bench.analysis.common.run_spread import RunSpread, fit_run_spread
from bench.analysis.rlg._basis import GROUPS, OWN_SHARES, Basis, own_columns
from bench.analysis.rlg._rows import RampRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

LEVEL = 0.95
"""Part of a further run's rows that the interval of the bias is to hold."""
_TAIL = 0.05
_LOW = 0.10
"""Part of further runs that may improve by less than promised; none should by more than noise allows."""
MORE_RUNS = (0.0, 1.0, 2.0, 4.0, float("inf"))
"""How many more runs are spoken of; the last is what no number of runs can pass."""
_DRAWS = 400
_NEGLIGIBLE = 1e-6
"""Part of the largest variance below which a direction is left out of a file."""


@dataclass(frozen=True)
class Promise:
    """Improvement of the stability of 100 s means on a further run, %, within 90 %.

    `low_pct`: what nine runs in ten reach; `middle_pct`: what half of them do; `high_pct`: what would be reached
    if noise alone were left, by 95 % of runs at most.
    """

    low_pct: float
    middle_pct: float
    high_pct: float


@dataclass(frozen=True)
class RunToRun:
    """How far runs of the unit lie apart: 1 sigma over a run's rows about their mean, deg/h and % of the drift.

    `drift_dph`: the same of the drift that the runs have in common. `low_pct`, `high_pct`: 90 % interval.
    """

    dph: float
    drift_dph: float
    low_pct: float
    high_pct: float

    @property
    def pct(self) -> float:
        """The spread over the common drift, %."""
        return 100.0 * self.dph / self.drift_dph


@dataclass(frozen=True, eq=False)
class SmoothForm:
    """Coefficients of a basis with how sure they are and how far runs lie apart; deg/h.

    `coefficients` (p,). `doubt` (k, p), `apart` (m, p): their covariance, and that of what a run differs by, are
    these transposed times themselves. `own` (q,), `noise`: variances of a run's own columns and of a row. `runs`:
    how many were fitted.
    """

    basis: Basis
    coefficients: Array
    mean_dph: float
    doubt: Array
    apart: Array
    own: Array
    noise: float
    runs: int

    def drift_dph(self, run: RampRun) -> Array:
        """Return the bias on every row, (n,)."""
        return np.asarray(self.mean_dph + self.basis.matrix(run) @ self.coefficients)

    def half_width_dph(self, run: RampRun, shipped_dph: Array) -> Array:
        """Return the half width about `shipped_dph` (n,) that holds `LEVEL` of a further run's rows, (n,).

        What comes from run to run (offset, coefficients) is known from a few runs and has Student's factor, noise
        and what the shipped form departs by the normal one; squares add up. ConfigurationError for a form of one
        run.
        """
        self._require_runs()
        columns, own = self.basis.matrix(run), own_columns(run) ** 2 * self.own
        few = (self.runs + 1.0) / (self.runs - 1.0) * own[:, 0]
        few += ((columns @ self.apart.T) ** 2).sum(axis=1) + ((columns @ self.doubt.T) ** 2).sum(axis=1)
        known = own[:, 1:].sum(axis=1) + self.noise
        known += (self.mean_dph + columns @ self.coefficients - shipped_dph) ** 2
        tail = 0.5 + 0.5 * LEVEL
        return np.asarray(np.sqrt(stdtrit(self.runs - 1.0, tail) ** 2 * few + ndtri(tail) ** 2 * known))

    def promise(self, run: RampRun, shipped_dph: Array) -> Promise:
        """Return what subtracting `shipped_dph` (n,) would do on runs through the temperatures of `run`.

        Runs are drawn from what is known of the unit; of `run` itself only the temperatures are read. The spread
        is drawn anew for each, scaled inverse chi-squared. ConfigurationError for a form of one run.
        """
        self._require_runs()
        rng = np.random.default_rng(0)
        columns, own = self.basis.matrix(run), own_columns(run)
        size = np.sqrt((self.runs - 1.0) / rng.chisquare(self.runs - 1.0, (_DRAWS, 1)))
        apart = rng.standard_normal((_DRAWS, len(self.doubt))) @ self.doubt
        apart += rng.standard_normal((_DRAWS, len(self.apart))) @ self.apart
        noise = (rng.standard_normal((_DRAWS, len(self.own))) * np.sqrt(self.own)) @ own.T
        noise += np.sqrt(self.noise) * rng.standard_normal(noise.shape)
        drawn = (self.coefficients + size * apart) @ columns.T + noise
        whole = np.std(drawn, axis=1)
        less = 1.0 - np.std(drawn - shipped_dph, axis=1) / whole
        low, middle = 100.0 * np.quantile(less, [_LOW, 0.5])
        high = 100.0 * np.quantile(1.0 - np.std(noise, axis=1) / whole, 1.0 - _TAIL)
        return Promise(float(low), float(middle), float(high))

    def spread(self, runs: Sequence[RampRun]) -> RunToRun:
        """Return how far runs like `runs` lie apart; ConfigurationError for a form of one run."""
        self._require_runs()
        columns = np.concatenate([part - part.mean(axis=0) for part in map(self.basis.matrix, runs)])
        dph = float(np.sqrt(((columns @ self.apart.T) ** 2).sum(axis=1).mean()))
        drift = float(np.sqrt(np.mean((columns @ self.coefficients) ** 2)))
        freedom = self.runs - 1.0
        many, few = chdtri(freedom, np.array([_TAIL, 1.0 - _TAIL]))
        low, high = (100.0 * dph / drift * float(np.sqrt(freedom / points)) for points in (many, few))
        return RunToRun(dph, drift, low, high)

    def _require_runs(self) -> None:
        if self.runs < 2:
            raise ConfigurationError(
                "one run says nothing of how far runs lie apart",
                where="smooth form of a ring laser",
                found="a form fitted to one run",
                expected="at least two runs, each after a power-on of its own",
                remedy="record another run and fit both",
            )

    def to_state(self) -> dict[str, Any]:
        """Return what a file needs."""
        names = ("coefficients", "doubt", "apart", "own", "mean_dph", "noise", "runs")
        return {"basis": self.basis.to_state(), **{name: getattr(self, name) for name in names}}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a form; ValueError if it is none."""
        basis, runs = Basis.from_state(state["basis"]), int(state["runs"])
        names = ("coefficients", "doubt", "apart", "own")
        arrays = {name: np.asarray(state[name], dtype=np.float64) for name in names}
        numbers = {name: float(state[name]) for name in ("mean_dph", "noise")}
        count = len(basis.kept)
        sized = arrays["coefficients"].shape == (count,) and arrays["own"].shape == OWN_SHARES.shape[1:]
        sized &= all(arrays[name].ndim == 2 and arrays[name].shape[1] == count for name in ("doubt", "apart"))
        if not sized or min(*arrays["own"], numbers["noise"]) < 0.0 or runs < 1:
            raise ValueError("coefficients or variances of a smooth form that are none")
        return cls(
            basis,
            arrays["coefficients"],
            numbers["mean_dph"],
            arrays["doubt"],
            arrays["apart"],
            arrays["own"],
            numbers["noise"],
            runs,
        )


@dataclass(frozen=True, eq=False)
class SmoothFit:
    """A form, and the regression that it comes from, which says what more runs would bring."""

    form: SmoothForm
    found: RunSpread

    def after(self, runs: Sequence[RampRun], more: float) -> float:
        """Return the improvement in the middle for further runs like `runs` once `more` of them are fitted, %.

        The form's own, over drawn runs with the expected variance of what is not sure; infinity: what is left is
        noise and what a run has of its own.
        """
        form, covariance = self.form, self.found.covariance_after(more)
        rng = np.random.default_rng(0)
        freedom = form.runs - 1.0
        size = np.sqrt(freedom / rng.chisquare(freedom, (_DRAWS, 1)))
        apart = size * (rng.standard_normal((_DRAWS, len(form.apart))) @ form.apart)
        middles = []
        for run in runs:
            columns, own = form.basis.matrix(run), own_columns(run)
            columns, own = columns - columns.mean(axis=0), own - own.mean(axis=0)
            always = float((own**2 @ form.own).mean()) + form.noise
            unsure = float(np.einsum("ij,jk,ik->", columns, covariance, columns)) / len(columns)
            left = np.var(apart @ columns.T, axis=1) + always + unsure
            drift = np.var((form.coefficients + apart) @ columns.T, axis=1) + always + unsure
            middles.append(100.0 * (1.0 - float(np.median(np.sqrt(left / drift)))))
        return float(np.mean(middles))


def fit_smooth(
    runs: Sequence[RampRun],
    *,
    one_temperature: bool,
    groups: Sequence[str] = GROUPS,
    use: Sequence[NDArray[np.bool_]] | None = None,
) -> SmoothFit:
    """Fit the form to runs of one unit; `groups`: columns of these only; `use`: rows of each run, default all.

    Temperatures are read on all rows: what lags goes on where the bias is left out.
    ConfigurationError for a bias that does not change or temperatures that do not.
    """
    basis = Basis.of(runs, one_temperature=one_temperature, groups=groups)
    chosen = use or [np.ones(len(run.time_s), dtype=np.bool_) for run in runs]
    bias = [run.bias_dph[rows] for run, rows in zip(runs, chosen, strict=True)]
    mean = float(np.concatenate(bias).mean())
    found = fit_run_spread(
        [basis.matrix(run)[rows] for run, rows in zip(runs, chosen, strict=True)],
        [own_columns(run)[rows] for run, rows in zip(runs, chosen, strict=True)],
        [values - mean for values in bias],
        basis.shares(groups),
        OWN_SHARES,
        basis.start(groups),
    )
    form = SmoothForm(
        basis,
        found.coefficients,
        mean,
        _factor(found.covariance),
        _factor(found.apart),
        found.own,
        found.noise,
        len(runs),
    )
    return SmoothFit(form, found)


def promise_of(each: Sequence[Promise]) -> Promise:
    """Return the mean of promises of runs, point by point: what a run as usual as these is promised."""
    rows = np.array([(one.low_pct, one.middle_pct, one.high_pct) for one in each])
    return Promise(*map(float, rows.mean(axis=0)))


def _factor(covariance: Array) -> Array:
    """Return rows (k, p) whose transpose times themselves is the covariance (p, p), less what is negligible."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _NEGLIGIBLE * values[-1]
    return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)
