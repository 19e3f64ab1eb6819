"""Where a line that means show lies in their rows: at its frequency there, or at one that folds to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.gap._data import GapRun
from drivers.base.arrays import Array

_NEAR = 2
"""Bins on either side in which a line's own frequency may lie: it is known to a part of a bin of the run."""
_CLEAR = 6.0
"""Times the usual size of bins around from which on there is a line in the rows."""
_AROUND = 64


@dataclass(frozen=True)
class RowLine:
    """A line in means at `seen_hz`: frequency and amplitude in the rows; NaN where these do not show it."""

    seen_hz: float
    period_s: float
    frequency_hz: float
    amplitude_dph: float

    @property
    def sentence(self) -> str:
        """What is known of the line's frequency."""
        means = f"the line at {self.seen_hz:.4g} Hz in means of {self.period_s:g} s"
        if math.isnan(self.frequency_hz):
            return f"{means} may be an alias: its cause may lie off by multiples of {1 / self.period_s:g} Hz"
        at = f"{self.frequency_hz:.5g} Hz in the log's rows, {self.amplitude_dph:.3g} deg/h"
        if self.frequency_hz <= 0.5 / self.period_s:
            return f"{means} is at {at}"
        return f"{means} is an alias: it is at {at}"


def in_rows(frequency_hz: float, runs: Sequence[GapRun]) -> RowLine:
    """Look for a line of the means at what folds to its frequency, in the longest of the runs that have rows."""
    period_s = runs[0].stimulus.period_s
    nothing = RowLine(frequency_hz, period_s, math.nan, math.nan)
    known = [run for run in runs if run.rows_dps is not None and run.row_s < 0.5 * run.stimulus.period_s]
    if not known:
        return nothing
    run = max(known, key=lambda run: 0 if run.rows_dps is None else len(run.rows_dps))
    assert run.rows_dps is not None
    size = _amplitudes(run.rows_dps)
    bin_hz = 1.0 / (len(run.rows_dps) * run.row_s)
    nyquist_hz = 0.5 / run.row_s
    orders = np.arange(math.ceil(nyquist_hz * period_s) + 1) / period_s
    places = np.unique(np.abs(np.concatenate((orders + frequency_hz, orders - frequency_hz))))
    places = places[(places < nyquist_hz) & (places > _AROUND * bin_hz)]
    if not len(places):
        return nothing
    near = np.rint(places / bin_hz).astype(int)[:, None] + np.arange(-_NEAR, _NEAR + 1)
    near = near[(near < len(size)).all(axis=1)]
    # what means leave of a line: those that they leave little of must be the larger to be seen
    tops = near[np.arange(len(near)), size[near].argmax(axis=1)]
    left = size[tops] * np.abs(np.sinc(tops * bin_hz * period_s))
    usual = np.array([np.median(size[max(top - _AROUND, 1) : top + _AROUND]) for top in tops])
    clear = size[tops] > _CLEAR * usual
    if not clear.any():
        return nothing
    best = int(np.argmax(np.where(clear, left, 0.0)))
    return RowLine(frequency_hz, period_s, float(tops[best] * bin_hz), 3600.0 * float(size[tops[best]]))


def _amplitudes(rows_dps: Array) -> Array:
    """Return the amplitude of a sinusoid at every bin, (n // 2 + 1,); missing rows are bridged."""
    known = np.isfinite(rows_dps)
    at = np.arange(len(rows_dps))
    rows = np.interp(at, at[known], rows_dps[known])
    window = np.hanning(len(rows))
    return np.asarray(2.0 * np.abs(np.fft.rfft((rows - rows.mean()) * window)) / window.sum())
