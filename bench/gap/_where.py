"""Where the gap lies: cells with size, share and significance; phases by time scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import idct
from scipy.stats import chi2

from bench.gap._cells import BANDS, Cell, band_slices, mixing
from bench.gap._data import Group
from bench.gap._fit import Floor, counts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """One cell of the map. `energy_ratio` is energy over floor, `p_value` adjusted for all cells (Holm)."""

    profile: str
    parity: str
    band: str
    rms_dph: float
    share: float
    energy_ratio: float
    p_value: float


def places(cells: Sequence[Cell], left: Array, floor: Floor) -> list[Place]:
    """Return the repeatable cells, largest gap first; `left` (cells,) are energies under the nominal model."""
    number = counts(cells)
    band = np.array([cell.band for cell in cells])
    p_value = holm(chi2.sf(left / (1.0 + 2.0 * floor.sigma[band]), number))
    gap = np.maximum(left - number, 0.0)
    counted = np.array([cell.repeatable for cell in cells])
    total = float(gap[counted].sum()) or 1.0
    found = [
        Place(
            cell.profile,
            cell.parity,
            BANDS[cell.band],
            float(np.sqrt(gap[k] * cell.power / cell.samples)),
            float(gap[k]) / total,
            float(left[k] / number[k]),
            float(p_value[k]),
        )
        for k, cell in enumerate(cells)
        if cell.repeatable
    ]
    return sorted(found, key=lambda place: (-place.share, place.p_value))


def holm(p_values: Array) -> Array:
    """Return p-values adjusted for their number (Holm, Scand. J. Statist. 6, 1979), (m,)."""
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    adjusted = np.empty_like(steps)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


@dataclass(frozen=True)
class PhasePlace:
    """Energy ratio to the floor of one phase and band in one profile, over its parity runs that repeat."""

    profile: str
    phase: str
    band: str
    energy_ratio: float
    share: float


def phase_map(groups: Sequence[Group], residuals: Sequence[Array], floor: Floor) -> list[PhasePlace]:
    """Return where in the runs the gap lies; `residuals` (parity runs, n - 1) are whitened coefficients by group.

    Whitening in the DCT domain shifts nothing in time, so a band's inverse transform shows when its energy comes.
    """
    rows: list[tuple[str, str, str, float, float]] = []
    for group, residual in zip(groups, residuals, strict=True):
        run = group.runs[0][0]
        n = residual.shape[1] + 1
        kept = residual[[k for k, same in enumerate(mixing(group)[1]) if same]]
        phases = [str(name) for name in dict.fromkeys(run.phase.tolist())]
        for band, part in enumerate(band_slices(n, run.stimulus.period_s)):
            if part.stop <= part.start:
                continue
            only = np.zeros((len(kept), n))
            only[:, 1 + part.start : 1 + part.stop] = kept[:, part]
            energy = (idct(only, norm="ortho", axis=-1) ** 2).sum(axis=0) / floor.ratio[band]
            expected = len(kept) * (part.stop - part.start) / n
            for phase in phases:
                at = run.phase == phase
                floor_energy = float(expected * at.sum())
                own = float(energy[at].sum())
                rows.append((group.profile, phase, BANDS[band], own / floor_energy, own - floor_energy))
    total = sum(max(row[4], 0.0) for row in rows) or 1.0
    places_ = [PhasePlace(*row[:4], max(row[4], 0.0) / total) for row in rows]
    return sorted(places_, key=lambda place: -place.share)
