"""Whitened runs cut into cells (parity of runs, octave-like band) and their Gram matrices.

A cell's Gram matrix of [data, columns] is all that later steps need: every fit is small linear algebra.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._bridge import noise_left
from bench.analysis.gap._data import Group
from bench.analysis.gap._grams import gram_blocks
from bench.analysis.gap._noise import Noise, power_of
from bench.analysis.gap._stack import Stack
from drivers.base.arrays import Array

BAND_EDGES_S = (3500.0, 1400.0, 560.0, 300.0, 150.0, 75.0, 38.0, 20.0, 10.0, 5.0)
"""Periods between the bands, slowest band first."""
BANDS = (
    "over 58 min",
    "23..58 min",
    "9..23 min",
    "5..9 min",
    "150..300 s",
    "75..150 s",
    "38..75 s",
    "20..38 s",
    "10..20 s",
    "5..10 s",
    "under 5 s",
)
_NEGLIGIBLE, _UNSEEN = 1e-5, 1.0
"""Part of a column's energy in one cell below which it counts as none, and the energy, in variances of one
coefficient's noise, that a column as large as the data may have there at most.
"""


@dataclass(frozen=True)
class Cell:
    """Part of the data: whitened products of [data, columns], `count` coefficients, fewer
    where samples are missing.

    `whitened` (a, a) holds the products of the data, 0, and of the columns that have something here, `at` (a,),
    of 1 + p `columns`, by the noise model; `floor` is the noise's variance against it. `power` is the noise's
    mean power per coefficient, (deg/h)^2, `samples` the runs' length.
    """

    profile: str
    parity: str
    repeatable: bool
    band: int
    count: float
    columns: int
    at: NDArray[np.int64]
    whitened: Array
    power: float
    samples: int
    floor: float = 1.0

    def products(self, columns: NDArray[np.int64]) -> Array:
        """Return the products of some of [data, columns], (k, k); 0 is the data."""
        places = np.full(self.columns, -1)
        places[self.at] = np.arange(len(self.at))
        own = places[columns]
        here = own >= 0
        result = np.zeros((len(columns),) * 2)
        result[np.ix_(here, here)] = self.whitened[np.ix_(own[here], own[here])] / self.floor
        return result


def mixing(group: Group) -> tuple[list[str], list[bool], Array]:
    """Return `contrasts` of a group, or each run by itself where repeats are unequal."""
    if group.balanced:
        return contrasts(group.conditions, len(group.runs[0]))
    runs = [run.run_id for run in group.flat]
    return runs, [True] * len(runs), np.eye(len(runs))


def mixed_whitened(group: Group, stacked: NDArray[Any], noise: Noise) -> Array:
    """Return the parity runs, whitened, from the runs' coefficients (runs, p, n - 1), condition-major."""
    power = power_in(group, noise)
    mix = mixing(group)[2]
    scale = (1.0 / np.sqrt(power)).astype(stacked.dtype)
    result = np.tensordot(mix.astype(stacked.dtype), stacked, axes=1) if len(mix) > 1 else stacked.copy()
    result *= scale
    return np.asarray(result)


def band_slices(n: int, period_s: float) -> list[slice]:
    """Return for each band its slice of coefficients 1 .. n-1; number k has a period of 2 n / k samples."""
    edges = [math.floor(2.0 * n * period_s / edge) for edge in BAND_EDGES_S]
    cuts = [0, *(min(max(edge, 0), n - 1) for edge in edges), n - 1]
    return [slice(low, high) for low, high in pairwise(cuts)]


def contrasts(conditions: Sequence[str], repeats: int) -> tuple[list[str], list[bool], Array]:
    """Return names, whether repeatable, and orthonormal rows (m, m), m = conditions x repeats, run order c-major.

    Opposite rates give common, odd in rate and, with a zero run, even in rate. Differences of repeats come last.
    """
    names, between = _between(conditions)
    within = _helmert(repeats)
    rows, labels, repeatable = [], [], []
    for repeat in range(repeats):
        for index, name in enumerate(names):
            rows.append(np.kron(between[index], within[repeat]))
            labels.append(name)
            repeatable.append(repeat == 0)
    return labels, repeatable, np.array(rows)


def _between(conditions: Sequence[str]) -> tuple[list[str], Array]:
    if len(conditions) == 1:
        return ["run"], np.ones((1, 1))
    rates = _rates(conditions)
    if rates is not None and len(rates) in (2, 3) and np.isclose(rates.sum(), 0.0):
        order = np.argsort(-rates)
        rows = np.zeros((len(rates), len(rates)))
        rows[0] = 1.0
        rows[1, order[0]], rows[1, order[-1]] = 1.0, -1.0
        if len(rates) == 3:
            rows[2, order] = (1.0, -2.0, 1.0)
        names = ["common", "odd in rate", "even in rate"][: len(rates)]
        return names, rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return ["common", *(f"orientation {k}" for k in range(1, len(conditions)))], _helmert(len(conditions))


def _rates(conditions: Sequence[str]) -> Array | None:
    try:
        return np.array([float(condition) for condition in conditions])
    except ValueError:
        return None


def _helmert(n: int) -> Array:
    rows = np.zeros((n, n))
    rows[0] = 1.0
    for k in range(1, n):
        rows[k, :k], rows[k, k] = 1.0, -float(k)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def power_in(group: Group, noise: Noise) -> Array:
    """Return the power of noise in a group's coefficients (n - 1,), (deg/h)^2, what rounding makes in it too."""
    s = group.flat[0].stimulus
    return power_of(noise.beside(group.known_noise), len(s), s.period_s)


def codes_dph(group: Group, band: int) -> float:
    """Return the most that the angle's codes can do to the rate in a band, deg/h rms over the runs.

    All of a sawtooth of one step, whose first sine has that over pi, at the band's highest frequency.
    """
    steps = [
        0.0 if run.rounding_noise is None else run.rounding_noise.code_arcsec(run.stimulus, run.missing)
        for run in group.flat
    ]
    shortest_s = (*BAND_EDGES_S, 2.0 * group.flat[0].stimulus.period_s)[band]
    return math.sqrt(2.0 * sum(step**2 for step in steps) / len(steps)) / shortest_s


def shared_noise(group: Group, noise: Noise) -> tuple[Array, Array]:
    """Return the noise of repeats' mean, and of their differences, in each band, over that of runs on their own.

    A table that repeats its motion repeats its codes: of errors of r runs that are correlated by c the mean has
    1 + (r - 1) c, and the differences have 1 - c.
    """
    s, more = group.flat[0].stimulus, len(group.runs[0]) - 1
    part = power_of(group.known_codes, len(s), s.period_s) / power_in(group, noise)
    own = [part[each] for each in band_slices(len(s), s.period_s)]
    of_codes = np.array([float(each.mean()) if len(each) else 0.0 for each in own])
    return 1.0 + more * group.shared * of_codes, 1.0 - group.shared * of_codes


def left_of_noise(group: Group, filled_for: Noise, noise: Noise) -> Array:
    """Return the power of noise with gaps bridged over that without gaps, (n - 1,), mean of the group's runs."""
    period_s = group.flat[0].stimulus.period_s
    parts = [noise_left(run.missing, period_s, filled_for, noise) for run in group.flat]
    return np.asarray(np.mean(parts, axis=0))


def whitened_rows(
    group: Group, stack: Stack, noise: Noise, variance: Array
) -> Callable[[NDArray[Any]], Array]:
    """Return what turns coefficients (runs, k, n - 1) of a group into rows (k, runs (n - 1)).

    Their products are the sum of those of `group_cells` over `variance`, which has their order.
    """
    n, period_s = stack.full.shape[2] + 1, group.runs[0][0].stimulus.period_s
    mix = mixing(group)[2]
    power = power_in(group, noise) * np.maximum(left_of_noise(group, stack.filled_for, noise), 1.0)
    sizes = [part.stop - part.start for part in band_slices(n, period_s) if part.stop > part.start]
    deviation = np.sqrt(power * np.repeat(variance.reshape(len(sizes), len(mix)), sizes, axis=0).T)

    def rows(coefficients: NDArray[Any]) -> Array:
        mixed = np.tensordot(mix, coefficients, axes=1) / deviation[:, None]
        return np.asarray(mixed.transpose(1, 0, 2).reshape(mixed.shape[1], -1))

    return rows


def repeatable_rows(
    group: Group, filled_for: Noise, noise: Noise, floor: Array
) -> Callable[[NDArray[Any]], Array]:
    """Return what turns the first m coefficients of a group's runs (runs, k, m) into rows (k, parity runs, m).

    They are whitened on the floor (bands,), the parity runs are those that repeats share.
    """
    _, repeatable, mix = mixing(group)
    return _floored(group, filled_for, noise, floor, mix[np.array(repeatable)])


def run_rows(group: Group, filled_for: Noise, noise: Noise, floor: Array) -> Callable[[NDArray[Any]], Array]:
    """Return the same for the runs each by itself: (runs, k, m) into (k, runs, m)."""
    return _floored(group, filled_for, noise, floor, np.eye(len(group.flat)))


def _floored(
    group: Group, filled_for: Noise, noise: Noise, floor: Array, mix: Array
) -> Callable[[NDArray[Any]], Array]:
    n, period_s = len(group.flat[0].stimulus), group.flat[0].stimulus.period_s
    power = power_in(group, noise) * np.maximum(left_of_noise(group, filled_for, noise), 1.0)
    sizes = [part.stop - part.start for part in band_slices(n, period_s)]
    deviation = np.sqrt(power * np.repeat(floor, sizes))

    def rows(coefficients: NDArray[Any]) -> Array:
        mixed = np.tensordot(mix, coefficients, axes=1)
        return np.asarray((mixed / deviation[: mixed.shape[2]]).transpose(1, 0, 2))

    return rows


def cells_in(group: Group) -> int:
    """Return how many cells a group has: bands by parity runs."""
    run = group.runs[0][0].stimulus
    bands = [part for part in band_slices(len(run), run.period_s) if part.stop > part.start]
    return len(bands) * len(group.flat)


def group_cells(group: Group, stack: Stack, noise: Noise) -> list[Cell]:
    """Return the cells of a group from its runs' coefficients of [data, columns]."""
    n, period_s = stack.full.shape[2] + 1, group.runs[0][0].stimulus.period_s
    names, repeatable, mix = mixing(group)
    of_mean, of_differences = shared_noise(group, noise)
    power = power_in(group, noise) * np.maximum(left_of_noise(group, stack.filled_for, noise), 1.0)
    known = np.minimum(left_of_noise(group, stack.filled_for, noise), 1.0)
    parts = band_slices(n, period_s)
    flat = [part for part in parts if part.stop > part.start]
    sizes = np.array([stack.energies(part) / power[part].mean() for part in flat])
    total = sizes.sum(axis=0)
    least = min(_NEGLIGIBLE, _UNSEEN / max(float(total[0]), 1.0)) * total
    cells = []
    for index, part in enumerate(flat):
        # most columns are smooth and have nothing in the fast bands, which hold most coefficients
        at = np.flatnonzero(sizes[index] > least)
        at = at if len(at) and at[0] == 0 else np.insert(at, 0, 0)
        rows = stack.part(at, part) / np.sqrt(power[part])
        rows = (mix @ rows.reshape(len(mix), -1)).reshape(rows.shape)
        band, mean_power = parts.index(part), float(power[part].mean())
        for name, same, block in zip(names, repeatable, gram_blocks(rows), strict=True):
            floor = float((of_mean if same else of_differences)[band])
            cells.append(
                Cell(
                    group.profile,
                    name,
                    same,
                    band,
                    float(known[part].sum()),
                    len(stack.place),
                    at,
                    block,
                    mean_power * floor,
                    n,
                    floor,
                )
            )
    return cells


def rescaled(cells: Sequence[Cell], floor: Array) -> list[Cell]:
    """Return the cells with the noise's variance in each band multiplied by `floor` (bands,)."""
    return [
        replace(cell, floor=cell.floor * ratio, power=cell.power * ratio)
        for cell, ratio in ((cell, float(floor[cell.band])) for cell in cells)
    ]
