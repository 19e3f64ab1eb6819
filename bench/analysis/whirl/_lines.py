"""Which lines there are: a significance test for whole ones, and a scan for lines that are not whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from bench.analysis.whirl._direct import DirectFit, fit_direct, root_s
from bench.analysis.whirl._types import Complex, TurnRecord
from drivers.base.arrays import Array

HIGHEST = 24
CANDIDATES = tuple(float(line) for line in range(-HIGHEST, HIGHEST + 1) if line)
_STEPS_A_TURN = 3.0
"""Steps of the scan within the width of a line, 1 / turns."""
_CHUNK = 256


@dataclass(frozen=True)
class Line:
    """A line found by the scan. `statistic`: |a|^2 / (2 sd^2), Exp(1) where there is none."""

    line: float
    amplitude_arcsec: complex
    statistic: float
    threshold: float


def choose_lines(
    records: Sequence[TurnRecord],
    candidates: Sequence[float] = CANDIDATES,
    *,
    false_alarm: float = 0.01,
    keep: Sequence[float] = (),
) -> tuple[float, ...]:
    """Return the candidate lines that are significant in a joint fit, and those of `keep`, in order.

    A line that is not there has a statistic above ln(candidates / false_alarm) with the probability
    false_alarm / candidates, so that a run without whirl gives a line with the probability `false_alarm`.
    """
    candidates = [line for line in candidates if abs(line) < _fastest(records)]
    fit = fit_direct(records, candidates)
    threshold = math.log(len(candidates) / false_alarm)
    found = [line for line, value in zip(fit.lines, fit.statistic, strict=True) if value > threshold]
    return tuple(sorted({*found, *(float(line) for line in keep)}))


def _fastest(records: Sequence[TurnRecord]) -> float:
    """Return the line that turns by half a turn in a block of 1 s: above it lines cannot be told apart."""
    speeds = [
        float(np.percentile(np.abs(np.diff(record.angle_rad)), 90.0)) / record.period_s for record in records
    ]
    return math.pi / max(speeds) if max(speeds) > 0.0 else math.inf


def scan_lines(
    fit: DirectFit, *, highest: float = float(HIGHEST), false_alarm: float = 0.01, most: int = 4
) -> tuple[Line, ...]:
    """Return lines off those fitted that the residuals of a fit show, strongest first; at most `most`.

    Candidates are spaced by a third of a line's width, 1 / turns, between -highest and highest; within the
    width of a fitted line and of zero nothing can be told. The threshold is ln(candidates / false_alarm).
    """
    steps = [float(np.percentile(np.abs(part.last_rad - part.first_rad), 90.0)) for part in fit.blocks]
    highest = min(highest, math.pi / max(steps)) if max(steps) > 0.0 else highest
    turns = sum(float(np.abs(part.last_rad - part.first_rad).sum()) / (2.0 * math.pi) for part in fit.blocks)
    grid = np.arange(-highest, highest, 1.0 / (_STEPS_A_TURN * turns))
    taken = np.array([0.0, *fit.lines])
    residual = fit.residual_arcsec / root_s(fit.blocks)
    found: list[Line] = []
    while len(found) < most:
        grid = grid[(np.abs(grid[:, None] - taken[None, :]) > 2.0 / turns).all(axis=1)]
        if not len(grid):
            break
        threshold = math.log(len(grid) / false_alarm)
        spectrum = _statistics(fit, residual, grid)
        at = float(grid[int(np.argmax(spectrum))])
        if spectrum.max() <= threshold:
            break
        line = _refine(fit, residual, at, 1.0 / turns)
        column = _column(fit, line) / root_s(fit.blocks)
        amplitude = complex(np.vdot(column, residual) / np.vdot(column, column).real)
        found.append(Line(line, amplitude, float(_statistics(fit, residual, np.array([line]))[0]), threshold))
        residual = residual - amplitude * column
        taken = np.append(taken, line)
    return tuple(found)


def _column(fit: DirectFit, line: float) -> Complex:
    return np.concatenate([part.column(line) for part in fit.blocks])


def statistics(fit: DirectFit, lines: Array) -> Array:
    """Return |a|^2 / (2 sd^2) of single lines (l,) in what a fit leaves, its own sd taken for noise."""
    return _statistics(fit, fit.residual_arcsec / root_s(fit.blocks), lines)


def _statistics(fit: DirectFit, residual: Complex, lines: Array) -> Array:
    """Return |a|^2 / (2 sd^2) of single lines in a residual of even noise, its own sd taken for noise."""
    variance = float((np.abs(residual) ** 2).mean()) / 2.0
    root = root_s(fit.blocks)
    values = np.empty(len(lines))
    for start in range(0, len(lines), _CHUNK):
        part = lines[start : start + _CHUNK]
        columns = np.stack([_column(fit, float(line)) / root for line in part])
        energy = (np.abs(columns) ** 2).sum(axis=1)
        values[start : start + _CHUNK] = np.abs(columns.conj() @ residual) ** 2 / (2.0 * variance * energy)
    return values


def _refine(fit: DirectFit, residual: Complex, line: float, width: float) -> float:
    """Return where near `line` the statistic is largest."""
    best = minimize_scalar(
        lambda value: -float(_statistics(fit, residual, np.array([value]))[0]),
        bounds=(line - 0.5 * width, line + 0.5 * width),
        method="bounded",
        options={"xatol": 1e-3 * width},
    )
    return float(best.x)
