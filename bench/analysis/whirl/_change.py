"""What no fixed lines hold: lines that change in a run, with the sense of turning, from run to run.

In a run each line of the fit gets a column beside it: the line times the time since the start, or times the sense
of turning. Of a column that is not there, |b|^2 / (2 sd^2) is Exp(1) in white noise. Gyros whose bias wanders are
noisier than white at some lines; by how much is read off the lines beside, where nothing is expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from bench.analysis.whirl._direct import DirectFit, design_of, fit_direct, solve
from bench.analysis.whirl._lines import statistics
from bench.analysis.whirl._residual import TRAVEL_DEG, Blocks, slack
from bench.analysis.whirl._types import Complex, Finding, TurnRecord
from drivers.base.arrays import Array

FALSE_ALARM = 0.01
"""Probability of each of the three findings of a bearing with fixed lines."""
MATTERS = 0.01
"""A change below this part of the whole whirl is not told: the whirl falls a hundred times with it."""
_BESIDE = (2.5, 3.5, 4.5, 5.5, 6.5, 7.5)
"""Where the lines beside one lie, in widths of a line (1 / turns), on both sides."""
_Weight = Callable[[Blocks], tuple[Array, Array]]


def change_findings(fit: DirectFit, judged: Sequence[TurnRecord]) -> Iterator[Finding]:
    """Yield which lines of a fit change during its runs, with the sense of turning, and on the runs `judged`."""
    minutes = max(float(part.last_s[-1]) for part in fit.blocks) / 60.0
    reverses = any(part.reverses for part in fit.blocks)
    for line, change, statistic in _during(fit, _since, (_sense,) if reverses else ()):
        yield Finding(
            "change",
            f"line {line:+g} changes by {change:.2f} arcsec in {minutes:.0f} min (statistic {statistic:.0f}): "
            "a bearing that warms up or runs in. The compensation holds the mean over the run; turn until it is "
            "steady, then record",
        )
    if reverses:
        for line, change, statistic in _during(fit, _sense, (_since, _since_squared)):
            yield Finding(
                "sense",
                f"line {line:+g} is {change:.2f} arcsec different in reverse (statistic {statistic:.0f}): "
                "load or friction differs with the sense of turning. The compensation holds the mean of both; "
                "fit one for each sense",
            )
    for record in judged:
        for line, change, statistic in _elsewhere(fit, record):
            yield Finding(
                "repeat",
                f"line {line:+g} of run {record.run_id} is {change:.2f} arcsec off the one fitted (statistic "
                f"{statistic:.0f}): the bearing does not repeat, or the unit was mounted otherwise",
            )


def _since(part: Blocks) -> tuple[Array, Array]:
    """Return how much of a run is over at the ends of its blocks, 0 to 1."""
    return part.first_s / part.last_s[-1], part.last_s / part.last_s[-1]


def _since_squared(part: Blocks) -> tuple[Array, Array]:
    first, last = _since(part)
    return first**2, last**2


def _sense(part: Blocks) -> tuple[Array, Array]:
    """Return 0 while turning forward and 1 in reverse, at the ends of the blocks."""
    reverse = slack(part.path_rad, math.radians(TRAVEL_DEG))
    return reverse[part.first], reverse[part.last]


def _during(
    fit: DirectFit, weight: _Weight, others: Sequence[_Weight] = ()
) -> Iterator[tuple[float, float, float]]:
    """Yield line, change in arcsec and statistic of the lines that go with a weight of the blocks' ends.

    Lines that go with `others` are fitted beside, so that they are not taken for it.
    """
    design, observed, root = design_of(fit)
    added = [
        np.concatenate([_weighted(part, line, *each(part)) for part in fit.blocks]) / root
        for each in (*others, weight)
        for line in fit.lines
    ]
    values, sd, residual, _ = solve(np.column_stack([design, *added]), observed)
    left = replace(fit, residual_arcsec=residual * root)
    size = len(fit.lines)
    yield from _told(fit, fit.lines, values[-size:], sd[-size:] * np.sqrt(noisier(left)))


def _weighted(part: Blocks, line: float, first: Array, last: Array) -> Complex:
    return np.asarray(last * np.exp(1j * line * part.last_rad) - first * np.exp(1j * line * part.first_rad))


def _elsewhere(fit: DirectFit, record: TurnRecord) -> Iterator[tuple[float, float, float]]:
    """Yield line, difference and statistic of the lines that are others on a run."""
    own = fit_direct([record], fit.lines, travels_deg=fit.travels_deg or (TRAVEL_DEG,))
    # Without a drift of its own, line +1 holds the drift of the run.
    told = [at for at, line in enumerate(fit.lines) if line != 1.0 or (fit.drift_dph and own.drift_dph)]
    variance = sum(each.sd_arcsec**2 * noisier(each) for each in (fit, own))
    difference = own.amplitudes_arcsec - fit.amplitudes_arcsec
    lines = tuple(fit.lines[at] for at in told)
    yield from _told(fit, lines, difference[told], np.sqrt(variance)[told])


def _told(
    fit: DirectFit, lines: Sequence[float], change: Complex, sd: Array
) -> Iterator[tuple[float, float, float]]:
    least = MATTERS * float(np.linalg.norm(fit.amplitudes_arcsec))
    beside = 2 * len(_BESIDE)
    # One exponential variable over the mean of `beside` others exceeds t with (1 + t / beside)^-beside.
    threshold = beside * ((len(lines) / FALSE_ALARM) ** (1.0 / beside) - 1.0)
    for line, value, spread in zip(lines, np.abs(change), sd, strict=True):
        statistic = float(value**2 / (2.0 * spread**2))
        if statistic > threshold and value > least:
            yield line, float(value), statistic


def noisier(fit: DirectFit) -> Array:
    """Return how much more variance than the white noise of a fit there is at its lines, (l,), at least 1."""
    turns = sum(float(np.abs(np.diff(part.path_rad)).sum()) / (2.0 * math.pi) for part in fit.blocks)
    beside = np.array([*_BESIDE, *(-at for at in _BESIDE)]) / turns
    seen = statistics(fit, np.add.outer(np.array(fit.lines), beside).ravel())
    return np.asarray(np.maximum(seen.reshape(len(fit.lines), -1).mean(axis=1), 1.0))
