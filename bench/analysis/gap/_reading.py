"""Noise of the table's reading: what scatters about an even turn is no rate, unless the gyro follows it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from bench.analysis.gap._align import over_offset
from bench.analysis.gap._data import SIGMA_OF_SECOND_DIFFERENCES, GapRun
from drivers.base.arrays import Array

_CHANGES = 8.0
"""A change of rate from sample to sample that many times the median one begins another dwell."""
_SHORTEST = 32
"""Samples of a dwell from which the scatter about its line is judged."""
_FEWEST = 8
"""Samples of a dwell that a reading in steps tells from another rate."""
_ONE_STEP, _OF_A_STEP = 1.5, 0.75
"""Steps of the reading by which its rate changes from sample to sample, and it is beside its line, at most."""
_SMALLEST, _SMALL, _FUZZ = 0.05, 3.5, 0.02
"""Part of the changes that are less than a step, steps of a small one, and the part of a step that is none."""
_COARSEST_DEG = 0.1
"""A change of angle from sample to sample that no step of a reading makes: 12 bits a turn are 0.09 deg."""
_WHOLE, _SINGLE = 0.9, 0.75
"""Part of the samples that turn by whole steps, and of the small changes that are one step: noise makes more."""
_BESIDE = 5.0
"""Standard deviations of an angle's scatter beyond which the ends of a stretch belong to the moves beside it."""
_WHITE = 1.5
"""Largest scatter about a line against what second differences say of it: more is a table that moves."""
_BLOCK = 16
"""Samples of the means that a rate which scatters white is judged by: a ripple shows in them."""
_FEWEST_BLOCKS = 8
_OPPOSED = 0.9
"""Less scatter than that, against what differences say, is of an angle: its rates take one another back."""
_ROUNDED_DEG = 1e-9
"""Scatter of an angle that is computed and not read."""
_FOLLOWS = 0.4
"""Part of the scatter that a gyro must show for it to be the table's rate: reading noise shows none."""
_OUTLYING = 6.0
"""Standard deviations of the output's noise beyond which a jump counts no more."""
_SIGMAS = 2.0
"""Standard deviations by which that part must be known to be less."""


@dataclass(frozen=True)
class _Dwell:
    """A stretch at one rate: its edges in a run (m + 1,), the line of their angles and what is beside it, deg."""

    run: int
    edges: slice
    line_deg: Array
    beside_deg: Array


def as_turned(runs: Sequence[GapRun], early_ms: float = 0.0) -> tuple[list[GapRun], list[str]]:
    """Return aligned runs with the table's angle as it turned, and what was set right.

    With what rounded stamps and codes do to it as large as it shows, and without its reading's scatter.
    `early_ms`: the offset over which that of a clock acts, see `over_offset`.
    """
    shown = [_as_shown(run) for run in _coded_alike(over_offset(runs, early_ms))]
    return without_reading_noise(shown)  # a gyro that is late would seem not to follow


def _coded_alike(runs: Sequence[GapRun]) -> list[GapRun]:
    """Return the runs, those whose log has too few angles to tell its codes with the coarsest of the others'."""
    step = max((_step_of_log(run) for run in runs), default=0.0)
    return [
        run
        if step == 0.0 or run.rounding_noise is None or run.rounding_noise.told
        else replace(run, rounding_noise=run.rounding_noise.coded(run.stimulus.angle_deg, step))
        for run in runs
    ]


def _step_of_log(run: GapRun) -> float:
    return 0.0 if run.rounding_noise is None else float(run.rounding_noise.sigma_deg.max()) * math.sqrt(12.0)


def _as_shown(run: GapRun) -> GapRun:
    if run.rounding_noise is None:
        return run
    left = run.output_dph - run.stimulus.input_rate_dph
    return replace(run, rounding_noise=run.rounding_noise.as_shown(run.stimulus, left, run.missing))


def without_reading_noise(runs: Sequence[GapRun]) -> tuple[list[GapRun], list[str]]:
    """Return the runs with the line for the angle where its reading only scatters, and what was taken so.

    The gyro decides: its output is regressed on the rate of the scatter, both differenced, over all runs.
    A steep effect (the edge of a dead zone beside the Earth's rate) would otherwise be fitted to that noise.
    """
    dwells = [dwell for number, run in enumerate(runs) for dwell in _dwells(number, run)]
    crossed = squared = variance = 0.0
    for dwell in dwells:
        run = runs[dwell.run]
        inside = slice(dwell.edges.start, dwell.edges.stop - 1)
        along = 3600.0 / run.stimulus.period_s * np.sin(np.radians(run.stimulus.elevation_deg[inside]))
        scatter, output = np.diff(dwell.beside_deg) * along, run.output_dph[inside]
        jumps = np.diff(output)
        known = ~np.isnan(jumps)
        bends = np.abs(np.diff(output, 2))
        if np.isnan(bends).all():
            continue
        sigma = float(np.nanmedian(bends)) * SIGMA_OF_SECOND_DIFFERENCES
        change = np.where(known, np.diff(scatter), 0.0)
        # an impulse, or a move that comes late, but no swing of the table that the gyro shows as well
        most = _OUTLYING * sigma + 2.0 * np.abs(change)
        jumps = np.clip(jumps, -most, most)
        crossed += float(change @ np.where(known, jumps, 0.0))
        squared += float(change @ change)
        variance += sigma**2 * float(np.square(np.diff(change, prepend=0.0, append=0.0)).sum())
    if squared == 0.0:
        return list(runs), []
    follows, sigma = crossed / squared, math.sqrt(variance) / squared
    if abs(follows) + _SIGMAS * sigma > _FOLLOWS:
        return list(runs), []
    steady = list(runs)
    for dwell in dwells:
        steady[dwell.run] = _on_its_line(steady[dwell.run], dwell)
    rates = [np.diff(dwell.beside_deg) / runs[dwell.run].stimulus.period_s for dwell in dwells]
    noise_dph = 3600.0 * float(np.std(np.concatenate(rates)))
    return steady, [
        f"the table's rate is read with a noise of {noise_dph:.2g} deg/h a sample that the gyro does not "
        f"follow ({follows:.2f} +- {_SIGMAS * sigma:.2f} of it): at one rate the table is taken to turn evenly"
    ]


def _dwells(number: int, run: GapRun) -> Iterator[_Dwell]:
    """Yield the stretches of a run in which its angle scatters, white, about a line, or within its step."""
    angle = run.stimulus.angle_deg
    stamped = run.rounding_noise is not None and run.rounding_noise.sigma_s.any()
    # codes of all rows of the log; where stamps scatter as well they are not seen one by one
    step = _step_deg(angle) or (0.0 if stamped else _step_of_log(run))
    change = np.abs(np.diff(angle, 2))
    # between rows that are missing the angle may jump by more than it scatters
    usual = np.where(run.missing[1:] | run.missing[:-1], np.nan, change)
    for edges in _stretches(change, usual, step):
        edges = _within(angle, edges, _OF_A_STEP * step) if step else _settled(angle, edges)
        if edges.stop - edges.start <= (_FEWEST if step else _SHORTEST):
            continue
        line = _fitted(angle[edges]) if step else _line(angle[edges])
        if line is not None and float(np.ptp(angle[edges] - line)) > _ROUNDED_DEG:
            yield _Dwell(number, edges, line, angle[edges] - line)


def _stretches(change: Array, usual: Array, step_deg: float) -> Iterator[slice]:
    """Yield the edges of stretches at one rate, from the sizes of an angle's second differences (m - 1,).

    `usual` holds those that say how large they are, NaN the others.

    Where stamps are rounded the reading scatters in proportion to the rate: each rate has a scale of its own.
    """
    if step_deg:
        yield from _between(change, _ONE_STEP * step_deg, 0)
        return
    windows = sliding_window_view(usual, min(_BLOCK, len(change)))
    known = (~np.isnan(windows)).any(axis=1)
    medians = np.full(len(windows), np.inf)
    medians[known] = np.nanmedian(windows[known], axis=1)
    at = np.arange(len(change))
    before, after = (medians[np.clip(part, 0, len(medians) - 1)] for part in (at - _BLOCK, at + 1))
    for piece in _between(change, _CHANGES * np.maximum(before, after), 0):
        own = change[piece.start : piece.stop - 2]
        if len(own):
            said = usual[piece.start : piece.stop - 2]
            median = float(np.nanmedian(said)) if np.isfinite(said).any() else float(np.median(own))
            yield from _between(own, _CHANGES * median, piece.start)


def _between(change: Array, largest: Array | float, first: int) -> Iterator[slice]:
    """Yield the edges between changes (k,) larger than `largest`, counted from `first`."""
    ends = np.flatnonzero(change > largest) + 1
    for start, stop in zip([0, *ends.tolist()], [*ends.tolist(), len(change) + 1], strict=True):
        yield slice(first + start, first + stop + 1)


def _step_deg(angle_deg: Array) -> float:
    """Return the step in which an angle (m + 1,) is read, deg, where no noise beside it is seen; 0 for none.

    `_rounding_noise.step_deg` is that of the log, however much more its table moves.

    A resolver's code: at an even rate it turns by so many steps or one more, in a pattern that repeats.
    """
    turned = np.diff(angle_deg)
    change = np.abs(np.diff(turned))
    change = change[(change > _ROUNDED_DEG) & (change < _COARSEST_DEG)]
    if len(change) < _SHORTEST:
        return 0.0
    step = float(np.quantile(change, _SMALLEST, method="inverted_cdf"))
    step = float(change[np.abs(change - step) < _FUZZ * step].mean())
    off = np.abs(turned / step - np.rint(turned / step))
    small = change[change < _SMALL * step]
    read = np.mean(off < _FUZZ) >= _WHOLE and np.mean(small < _ONE_STEP * step) >= _SINGLE
    return step if read else 0.0


def _settled(angle_deg: Array, edges: slice) -> slice:
    """Return a stretch without what is left of the moves beside it, where its angle scatters about a line."""
    if edges.stop - edges.start <= _SHORTEST:
        return edges
    scatter = SIGMA_OF_SECOND_DIFFERENCES * float(np.median(np.abs(np.diff(angle_deg[edges], 2))))
    inside = _within(angle_deg, edges, _BESIDE * scatter)
    if 2 * (inside.stop - inside.start) <= edges.stop - edges.start:
        return edges  # an angle that walks leaves every line
    # beside a move the sample at the end may hold a part of it that is less than the scatter
    turned = np.abs(
        np.diff(angle_deg, prepend=angle_deg[0], append=angle_deg[-1]) - _slope(angle_deg[inside])
    )
    moves = [turned[at] > 2.0 * _BESIDE * scatter for at in (edges.start, edges.stop)]
    return slice(
        inside.start + (moves[0] and edges.start > 0),
        inside.stop - (moves[1] and edges.stop < len(angle_deg)),
    )


def _within(angle_deg: Array, edges: slice, most_deg: float) -> slice:
    """Return the part of a stretch where an angle is no further beside a line: no creep after a move."""
    while edges.stop - edges.start > _FEWEST:
        own = angle_deg[edges]
        beside = np.abs(own - _fitted(own))
        worst = int(np.argmax(beside))
        if beside[worst] <= most_deg:
            break
        if 2 * worst < len(own):
            edges = slice(edges.start + worst + 1, edges.stop)
        else:
            edges = slice(edges.start, edges.start + worst)
    return edges


def _fitted(angle_deg: Array) -> Array:
    """Return the line of least squares through an angle (m + 1,)."""
    place = np.arange(len(angle_deg)) - 0.5 * (len(angle_deg) - 1)
    return np.asarray(angle_deg.mean() + place * _slope(angle_deg))


def _slope(angle_deg: Array) -> float:
    """Return the slope of that line, deg a sample."""
    place = np.arange(len(angle_deg)) - 0.5 * (len(angle_deg) - 1)
    return float((place * angle_deg).sum()) / float((place * place).sum())


def _line(angle_deg: Array) -> Array | None:
    """Return the line that an angle (m + 1,) scatters about, or None: white itself, or in a tachometer's rate."""
    rate = np.diff(angle_deg)
    spread = float(np.std(rate))
    if spread < _ROUNDED_DEG:
        return None
    line = _fitted(angle_deg)
    if float(np.std(angle_deg - line)) <= _WHITE * float(np.std(np.diff(rate))) / math.sqrt(6.0):
        return line
    blocks = rate[: len(rate) // _BLOCK * _BLOCK].reshape(-1, _BLOCK).mean(axis=1)
    if len(blocks) < _FEWEST_BLOCKS or float(np.std(blocks)) > _WHITE * spread / math.sqrt(_BLOCK):
        return None
    white = float(np.std(np.diff(rate))) / math.sqrt(2.0)
    if not _OPPOSED * white <= spread <= _WHITE * white:
        return None
    # an integral of noise walks: what it reached is kept, or the sample after the dwell would turn all of it
    return np.linspace(angle_deg[0], angle_deg[-1], len(angle_deg))


def _on_its_line(run: GapRun, dwell: _Dwell) -> GapRun:
    s, line = run.stimulus, dwell.line_deg
    angle, edge_rate = s.angle_deg.copy(), s.edge_rate_dps
    angle[dwell.edges] = line
    if edge_rate is not None:
        edge_rate = edge_rate.copy()
        edge_rate[dwell.edges] = (line[-1] - line[0]) / ((len(line) - 1) * s.period_s)
    noise = None if run.rounding_noise is None else run.rounding_noise.on_a_line(dwell.edges)
    stimulus = replace(s, angle_deg=angle, edge_rate_dps=edge_rate)
    return replace(run, stimulus=stimulus, rounding_noise=noise)
