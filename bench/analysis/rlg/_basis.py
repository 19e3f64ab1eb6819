"""Columns of the smooth form: curves over both temperatures, what lags behind the block, a memory of turns.

* curves: each temperature, and cosines over its range, smooth or rough: variance of the k-th cosine as k^-4 (a
  cubic smoothing spline) or k^-2 (steps); the mean over a row of a ramp has a closed form;
* drives: dT1, dT2, T1 - T2, and the block less bodies that lag the case or the block by 10 min to 2.7 h: whatever
  flows between bodies that nobody measures is nearly a sum of these; each as it is, times T2, squared, and
  squared with its sign;
* memory: how far a temperature is from where joints with 2, 5, 10 degC of play would still hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.rlg._rows import ROW_S, RampRun
from drivers.base.arrays import Array

LAGS_S = (600.0, 1200.0, 2400.0, 4800.0, 9600.0)
"""Time constants by octaves, from a few rows to what a run of half a day can tell from a constant."""
_PLAYS_K = (2.0, 5.0, 10.0)
_COSINES = 64
"""The finest half wave of a range of 105 degC is 2 degC: what the plays begin with, six rows of a slow ramp."""
_MARGIN = 0.1
_DRIFT = 10
"""Cosines of a run's own slow drift."""
_BLANK = 1e-9
_SECOND_START = 0.01
GROUPS = ("line", "smooth T1", "smooth T2", "rough T1", "rough T2", "drives", "drives x T2",
          "signed squares", "squares", "memory")  # fmt: skip
SECOND = GROUPS[6:9]
"""The groups of second order: at the one rate of a usual ramp they can stand for those of the first."""
STATIC = GROUPS[:5]
"""The groups of a spline on the temperatures alone."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Ranges of T1 and T2 in degC and the drives' rms, of the fitted runs; `kept`, (p,): the columns in use.

    `centre`, (p,): their means there, which are taken off: offsets are a run's own. `one_temperature`:
    only one was recorded, T1 stands for T2 as well.
    """

    case_range_c: tuple[float, float]
    block_range_c: tuple[float, float]
    scales: tuple[float, ...]
    one_temperature: bool
    kept: NDArray[np.int64]
    centre: Array

    @classmethod
    def of(cls, runs: Sequence[RampRun], *, one_temperature: bool, groups: Sequence[str] = GROUPS) -> Self:
        """Return the basis of runs, columns of `groups` only and none that is constant in all of them."""
        read = [_read(run, one_temperature) for run in runs]
        ranges = []
        for name in ("case_c", "block_c"):
            values = np.concatenate([getattr(run, name) for run in read])
            room = _MARGIN * float(np.ptp(values)) or 1.0
            ranges.append((float(values.min()) - room, float(values.max()) + room))
        every = np.concatenate([np.column_stack(_drives(run)) for run in read])
        scales = np.sqrt(np.mean(every**2, axis=0))
        still = scales <= _BLANK * max(float(np.abs(ranges).max()), 1.0)
        whole = cls(
            ranges[0],
            ranges[1],
            tuple(np.where(still, np.inf, scales).tolist()),
            one_temperature,
            _all(),
            np.zeros(len(_all())),
        )
        matrix = np.concatenate([whole.matrix(run) for run in runs])
        wanted = _shares()[np.isin(GROUPS, groups)].any(axis=0)
        kept = np.flatnonzero(wanted & (matrix.std(axis=0) > _BLANK))
        return replace(whole, kept=kept, centre=matrix[:, kept].mean(axis=0))

    def shares(self, groups: Sequence[str] = GROUPS) -> Array:
        """Return the shares that the kept columns have of the variances of `groups`, (len(groups), p)."""
        return _shares()[self._present(groups)][:, self.kept]

    def start(self, groups: Sequence[str] = GROUPS) -> Array:
        """Return where the search for the variances of `shares` begins: second orders explain what is left."""
        present = np.array(GROUPS)[self._present(groups)]
        return np.where(np.isin(present, SECOND), _SECOND_START, 1.0)

    def _present(self, groups: Sequence[str]) -> NDArray[np.bool_]:
        return np.isin(GROUPS, groups) & _shares()[:, self.kept].any(axis=1)

    def matrix(self, run: RampRun) -> Array:
        """Return the kept columns of all rows of a run, (n, p)."""
        run = _read(run, self.one_temperature)
        lines, curves = [], []
        for values, rate, (low, high) in (
            (run.case_c, run.case_rate, self.case_range_c),
            (run.block_c, run.block_rate, self.block_range_c),
        ):
            lines.append((2.0 * values - low - high) / (high - low))
            curves.append(_cosines(values, rate, low, high))
        drives = np.column_stack(_drives(run)) / self.scales
        parts = [
            np.column_stack(lines),
            *curves,
            drives,
            drives * lines[1][:, None],
            drives * np.abs(drives),
            drives**2,
            np.column_stack(
                [_slack(values, play) for values in (run.case_c, run.block_c) for play in _PLAYS_K]
            ),
        ]
        return np.asarray(np.column_stack(parts)[:, self.kept] - self.centre)

    def to_state(self) -> dict[str, Any]:
        """Return what a file needs; a drive that stood still has scale zero there."""
        return {
            "case_range_c": list(self.case_range_c),
            "block_range_c": list(self.block_range_c),
            "scales": [scale if np.isfinite(scale) else 0.0 for scale in self.scales],
            "one_temperature": self.one_temperature,
            "kept": self.kept,
            "centre": self.centre,
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a basis; ValueError if it is none."""
        kept = np.asarray(state["kept"], dtype=np.int64)
        centre = np.asarray(state["centre"], dtype=np.float64)
        scales = [float(scale) or np.inf for scale in state["scales"]]
        ranges = [(float(low), float(high)) for low, high in (state["case_range_c"], state["block_range_c"])]
        fits = (
            kept.ndim == 1
            and centre.shape == kept.shape
            and bool((np.diff(kept) > 0).all())
            and bool(((kept >= 0) & (kept < len(_all()))).all())
        )
        if (
            not fits
            or len(scales) != _DRIVES
            or any(low >= high for low, high in ranges)
            or min(scales) < 0.0
        ):
            raise ValueError("columns, scales or ranges of a smooth form that are none")
        return cls(ranges[0], ranges[1], tuple(scales), bool(state["one_temperature"]), kept, centre)


OWN_SHARES = np.stack([np.eye(1, 1 + _DRIFT)[0], np.r_[0.0, 1.0 / np.arange(1.0, 1 + _DRIFT) ** 2]])
"""Shares of `own_columns` of two variances: offset; drift, as of a random walk."""


def own_columns(run: RampRun) -> Array:
    """Return what a run has of its own: offset and slow drift over its time, (n, q)."""
    part = (run.time_s - run.time_s[0]) / max(float(np.ptp(run.time_s)), 1.0)
    return np.asarray(np.cos(np.pi * np.arange(1 + _DRIFT) * part[:, None]))


def lagged(time_s: Array, values: Array, taus_s: Sequence[float]) -> Array:
    """Return values (n,) behind first-order lags, (n, taus), settled on the first, straight between rows."""
    taus = np.asarray(taus_s)
    out = np.empty((len(values), len(taus)))
    out[0] = values[0]
    for row in range(1, len(values)):
        step = (time_s[row] - time_s[row - 1]) / taus
        decay = np.exp(-step)
        mean = (1.0 - decay) / step
        out[row] = decay * out[row - 1] + (1.0 - mean) * values[row] + (mean - decay) * values[row - 1]
    return out


def _drives(run: RampRun) -> list[Array]:
    behind_case = lagged(run.time_s, run.case_c, LAGS_S)
    behind_block = lagged(run.time_s, run.block_c, LAGS_S[1:])
    return [
        run.case_rate,
        run.block_rate,
        run.case_c - run.block_c,
        *(run.block_c[:, None] - behind_case).T,
        *(run.block_c[:, None] - behind_block).T,
    ]


_DRIVES = 3 + 2 * len(LAGS_S) - 1


def _shares() -> Array:
    """Return the shares that all columns have of the variances of `GROUPS`, (len(GROUPS), columns)."""
    order = np.arange(1.0, _COSINES + 1)
    curves = [[1.0 / order**power if own else 0.0 * order for own in (first, not first)]
              for power in (4, 2) for first in (True, False)]  # fmt: skip
    blocks: list[list[Array]] = [[np.ones(2)], *curves]
    blocks += [[np.ones(count)] for count in (*[_DRIVES] * 4, 2 * len(_PLAYS_K))]
    widths = (2, 2 * _COSINES, *[_DRIVES] * 4, 2 * len(_PLAYS_K))
    places = np.cumsum((0, *widths))[[0, 1, 1, 1, 1, 2, 3, 4, 5, 6]]
    shares = np.zeros((len(GROUPS), sum(widths)))
    for row, (place, block) in enumerate(zip(places, blocks, strict=True)):
        values = np.concatenate(block)
        shares[row, place : place + len(values)] = values
    return shares


def _all() -> NDArray[np.int64]:
    return np.arange(_shares().shape[1])


def _read(run: RampRun, one_temperature: bool) -> RampRun:
    return replace(run, block_c=run.case_c, block_rate=run.case_rate) if one_temperature else run


def _cosines(values: Array, rate_per_min: Array, low: float, high: float) -> Array:
    """Return means of cosines over the rows' ranges of temperature, (n, k): a rate makes a sinc of each."""
    order = np.arange(1, _COSINES + 1)
    place = np.clip((values - low) / (high - low), 0.0, 1.0)
    half = 0.5 * np.abs(rate_per_min) * ROW_S / 60.0 / (high - low)
    return np.asarray(np.cos(np.pi * order * place[:, None]) * np.sinc(order * half[:, None]))


def _slack(values: Array, play: float) -> Array:
    """Return values less where a joint with `play` to both sides holds, in parts of it, (n,), from -1 to 1."""
    held, out = values[0], np.empty_like(values)
    for row, value in enumerate(values):
        held = min(max(held, value - play), value + play)
        out[row] = (value - held) / play
    return out
