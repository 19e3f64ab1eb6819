"""Time alignment before any fit: whole samples by which the gyro's clock is off the table's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.analysis.gap._data import GapRun

_MOST = 5
_LEAST_CHANGE_DPS = 0.5
_CLEAR = 0.5
"""A shift must leave at most this part of the energy that no shift leaves."""


def aligned(runs: Sequence[GapRun]) -> tuple[list[GapRun], list[str]]:
    """Return the runs with their table angles shifted by whole samples where needed, and what was shifted.

    What is left of a sample is the catalogue's effect `time_offset`. A run at constant rate shows no shift.
    """
    result, notes = [], []
    for run in runs:
        shift = _shift(run)
        result.append(_shifted(run, shift) if shift else run)
        if shift:
            word = "late" if shift > 0 else "early"
            notes.append(
                f"{run.run_id}: the gyro's samples are {abs(shift) * run.stimulus.period_s:g} s {word} against "
                "the table; aligned before the fit, a remaining part of a sample shows as time_offset"
            )
    return result, notes


def _shift(run: GapRun) -> int:
    """Return by how many samples the table's angle must be moved later to fit the output."""
    rate = run.stimulus.input_rate_dph
    at = np.arange(_MOST, len(rate) - _MOST)
    # a shift by this much must not reach what is missing: nothing is known of the table there
    near = np.convolve(run.missing, np.ones(2 * _MOST + 1), mode="valid") > 0.0
    at = at[~near[: len(at)]]
    if len(at) < 4 * _MOST or np.ptp(run.stimulus.axis_rate_dps[at]) < _LEAST_CHANGE_DPS:
        return 0
    output = run.output_dph[at]
    left = {}
    for shift in range(-_MOST, _MOST + 1):
        columns = np.stack((np.ones(len(at)), rate[at - shift]))
        fit = np.linalg.lstsq(columns.T, output, rcond=None)[0]
        left[shift] = float(np.square(output - fit @ columns).sum())
    best = min(left, key=lambda each: left[each])
    return best if left[best] < _CLEAR * left[0] else 0


def _shifted(run: GapRun, shift: int) -> GapRun:
    s = run.stimulus
    edges = np.clip(np.arange(len(s) + 1) - shift, 0, len(s))
    rate = None if s.edge_rate_dps is None else s.edge_rate_dps[edges]
    noise = None if run.rounding_noise is None else run.rounding_noise.moved(edges)
    stimulus = replace(s, angle_deg=s.angle_deg[edges], edge_rate_dps=rate)
    return replace(run, stimulus=stimulus, rounding_noise=noise)
