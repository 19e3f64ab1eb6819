"""Where the gap lies: cells with size, share and significance; phases by time scale."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import idct
from scipy.stats import chi2

from bench.analysis.gap._cells import BANDS, Cell, band_slices, mixing, power_in
from bench.analysis.gap._data import GapRun, Group
from bench.analysis.gap._findings import SIGNIFICANT, Place
from bench.analysis.gap._fit import Floor, counts
from bench.analysis.gap._noise import Noise
from drivers.base.arrays import Array
from simulators.effects import REFERENCE_C, Stimulus


def places(cells: Sequence[Cell], left: Array, floor: Floor) -> list[Place]:
    """Return the repeatable cells, those clear of noise first, by size, then the others by significance.

    `left` (cells,) are energies under the nominal model.
    """
    number = counts(cells)
    band = np.array([cell.band for cell in cells])
    chance = chi2.sf(left / (1.0 + 2.0 * floor.sigma[band]), number)
    p_value = holm(chance)
    gap = np.maximum(left - number, 0.0)
    counted = np.array([cell.repeatable for cell in cells])
    clear = p_value < SIGNIFICANT
    share = np.where(clear, gap, 0.0) / (float(gap[counted & clear].sum()) or 1.0)
    by_size = np.lexsort((-gap, np.where(clear, 0.0, chance)))
    order = [k for k in by_size.tolist() if cells[k].repeatable]
    return [
        Place(
            cells[k].profile,
            cells[k].parity,
            BANDS[cells[k].band],
            float(np.sqrt(gap[k] * cells[k].power / cells[k].samples)),
            float(share[k]),
            float(left[k] / number[k]),
            float(p_value[k]),
        )
        for k in order
    ]


def holm(p_values: Array) -> Array:
    """Return p-values adjusted for their number (Holm, Scand. J. Statist. 6, 1979), (m,)."""
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    adjusted = np.empty_like(steps)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


@dataclass(frozen=True)
class RegimePlace:
    """One interval of one input, in the bands with a gap: `low` .. `high` in the input's `unit`."""

    of: str
    unit: str
    low: float
    high: float
    rms_dph: float
    share: float
    energy_ratio: float
    p_value: float


def phase_map(groups: Sequence[Group], residuals: Sequence[Array], floor: Floor, noise: Noise) -> list[Place]:
    """Return where in the runs the gap lies; `residuals` (parity runs, n - 1) are whitened coefficients by group.

    Whitening in the DCT domain shifts nothing in time, so a band's inverse transform shows when its energy comes.
    """
    found: list[Place] = []
    degrees = []
    for group, residual in zip(groups, residuals, strict=True):
        run = group.runs[0][0]
        n, period_s = residual.shape[1] + 1, run.stimulus.period_s
        kept = residual[[k for k, same in enumerate(mixing(group)[1]) if same]]
        phases = [str(name) for name in dict.fromkeys(run.phase.tolist())]
        power = power_in(group, noise)
        for band, part in enumerate(band_slices(n, period_s)):
            if part.stop <= part.start:
                continue
            energy = in_time(kept, part) / floor.ratio[band]
            expected = len(kept) * (part.stop - part.start) / n
            for phase in phases:
                at = (run.phase == phase) & ~run.missing
                if not at.any():
                    continue
                floor_energy = float(expected * at.sum())
                own = float(energy[at].sum()) / (1.0 + 2.0 * floor.sigma[band])
                excess = max(own - floor_energy, 0.0)
                rms = np.sqrt(excess * float(power[part].mean()) * floor.ratio[band] / (len(kept) * at.sum()))
                ratio, start_s = float(own / floor_energy), float(np.argmax(at) * period_s)
                found.append(
                    Place(group.profile, phase, BANDS[band], float(rms), excess, ratio, 1.0, start_s)
                )
                degrees.append((own, max(floor_energy, 1.0)))
    return by_share(found, degrees)


def by_share(found: Sequence[Place], degrees: Sequence[tuple[float, float]]) -> list[Place]:
    """Return places with p-values and shares of the gap in those clear of noise, largest share first.

    Their `share` is what they have of the gap, in any unit; `degrees` their energies with the degrees of freedom.
    """
    p_values = holm(chi2.sf(*np.array(degrees).T))
    shares = np.array([place.share for place in found]) * (p_values < SIGNIFICANT)
    shares /= max(float(shares.sum()), 1e-300)
    judged = [
        replace(place, share=float(share), p_value=float(p))
        for place, share, p in zip(found, shares, p_values, strict=True)
    ]
    return sorted(judged, key=lambda place: -place.share)


def in_time(coefficients: Array, part: slice) -> Array:
    """Return the energy at each sample, (n,), summed over rows (m, n - 1), of one band."""
    only = np.zeros((len(coefficients), coefficients.shape[1] + 1))
    only[:, 1 + part.start : 1 + part.stop] = coefficients[:, part]
    return np.asarray((idct(only, norm="ortho", axis=-1) ** 2).sum(axis=0))


def regime_map(
    groups: Sequence[Group],
    residuals: Sequence[Array],
    floor: Floor,
    noise: Noise,
    bands: Mapping[str, set[int]],
) -> list[RegimePlace]:
    """Return the gap by intervals of temperature, its rate of change, table rate and angle.

    `residuals` (runs, n - 1) are each run's own whitened coefficients, `bands` the bands with a gap by profile.
    """
    sums: dict[str, Array] = {}
    for group, residual in zip(groups, residuals, strict=True):
        for run, own in zip(group.flat, residual, strict=True):
            n, period_s = len(own) + 1, run.stimulus.period_s
            power = power_in(group, noise)
            energy, excess = np.zeros(n), np.zeros(n)
            dof = 0.0
            for band, part in enumerate(band_slices(n, period_s)):
                if band not in bands.get(group.profile, set()) or part.start == part.stop:
                    continue  # a short run of a profile has nothing in its slowest bands
                of_band = in_time(own[None], part) / floor.ratio[band] / (1.0 + 2.0 * floor.sigma[band])
                expected = (part.stop - part.start) / n
                energy += of_band
                dof += expected
                excess += (of_band - expected) * float(power[part].mean()) * floor.ratio[band]
            for regime in REGIMES if dof else ():
                row = regime.rows(run)[~run.missing]
                size = len(regime.edges) - 1
                count = np.bincount(row, minlength=size).astype(np.float64)
                sums.setdefault(regime.of, np.zeros((4, size)))
                sums[regime.of] += (
                    np.bincount(row, energy[~run.missing], size),
                    dof * count,
                    np.bincount(row, excess[~run.missing], size),
                    count,
                )
    found = []
    for regime in REGIMES:
        if regime.of not in sums:
            continue
        had, dof, excess, count = sums[regime.of]
        gap = np.maximum(had - dof, 0.0)
        p_values = chi2.sf(had, np.maximum(dof, 1.0)) * len(had) * len(REGIMES)
        share = gap / (gap.sum() or 1.0)
        rms = np.sqrt(np.maximum(excess, 0.0) / np.maximum(count, 1.0))
        found += [
            RegimePlace(
                regime.of,
                regime.unit,
                float(regime.edges[k]),
                float(regime.edges[k + 1]),
                float(rms[k]),
                float(share[k]),
                float(had[k] / dof[k]),
                float(min(p_values[k], 1.0)),
            )
            for k in np.flatnonzero(dof >= 1.0)
        ]
    return found


@dataclass(frozen=True)
class Regime:
    """An input and the intervals that it is cut into."""

    of: str
    unit: str
    edges: tuple[float, ...]
    values: Callable[[Stimulus], Array]

    def rows(self, run: GapRun) -> NDArray[np.int64]:
        """Return the interval of every sample, (n,)."""
        at = np.searchsorted(self.edges, self.values(run.stimulus), side="right") - 1
        return np.asarray(np.clip(at, 0, len(self.edges) - 2))


REGIMES = (
    Regime("T_in", "degC", tuple(np.arange(-60.0, 81.0, 10.0).tolist()), lambda s: s.warm_k + REFERENCE_C),
    Regime(
        "dT_in/dt",
        "K/min",
        (-20.0, -8.0, -4.0, -2.0, -1.0, -0.3, 0.3, 1.0, 2.0, 4.0, 8.0, 20.0),
        lambda s: s.warming_k_per_min,
    ),
    Regime(
        "table rate",
        "deg/s",
        (-500.0, -60.0, -30.0, -7.0, -0.5, 0.5, 7.0, 30.0, 60.0, 500.0),
        lambda s: s.table_rate_dps,
    ),
    Regime(
        "input rate",
        "deg/h",
        (-2e6, -2e5, -2e4, -1e3, -12.0, -6.0, -2.0, 2.0, 6.0, 12.0, 1e3, 2e4, 2e5, 2e6),
        lambda s: s.input_rate_dph,
    ),
    Regime(
        "table angle",
        "deg",
        tuple(np.arange(0.0, 361.0, 30.0).tolist()),
        lambda s: 0.5 * (s.angle_deg[1:] + s.angle_deg[:-1]) % 360.0,
    ),
)
