"""A channel's whitened coefficients in cells of phase by time scale, and the gap in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.stats import f as fisher

from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._channel_floor import ChannelFloor
from bench.analysis.gap._findings import SIGNIFICANT, Place
from bench.analysis.gap._fit import MISFIT
from bench.analysis.gap._where import holm
from drivers.base.arrays import Array
from simulators.effects import CHANNEL_UNITS

_BANDS_S = (0.0, 8.0, 32.0, 128.0, 512.0, 2048.0, math.inf)
_LEAK = 0.1


@dataclass(frozen=True, eq=False)
class ChannelCells:
    """Whitened coefficients of a channel's pieces side by side: (size,) each; `cell` numbers phase and band."""

    series: tuple[ChannelSeries, ...]
    floor: Array
    cell: NDArray[np.int64]
    names: tuple[tuple[str, int], ...]
    trust: Array

    def whitened(self, rests: Sequence[Array]) -> Array:
        """Return DCT coefficients over the floor's deviation of what is left of every series, (size,)."""
        parts = [
            dct(rest[piece], norm="ortho")
            for series, rest in zip(self.series, rests, strict=True)
            for _, piece in series.pieces()
        ]
        return np.asarray(np.concatenate(parts) / np.sqrt(self.floor))

    def sums(self, values: Array) -> Array:
        """Return sums by cell."""
        return np.asarray(np.bincount(self.cell, values, len(self.names)), dtype=np.float64)


def channel_cells(series: Sequence[ChannelSeries], floor: ChannelFloor) -> ChannelCells:
    powers, cells, trust = [], [], []
    names: dict[tuple[str, int], int] = {}
    for each in series:
        for phase, piece in each.pieces():
            size, period_s = piece.stop - piece.start, each.inputs.period_s
            power, octave = floor.at(size, period_s)
            periods = 2.0 * size * period_s / np.maximum(np.arange(size), 0.5)
            band = np.searchsorted(_BANDS_S, periods, side="right") - 1
            cells.append([names.setdefault((phase, int(b)), len(names)) for b in band])
            powers.append(power)
            trust.append(floor.count[octave])
    number = np.concatenate(cells).astype(np.int64)
    counts = np.bincount(number, minlength=len(names))
    own = np.bincount(number, np.concatenate(trust), len(names)) / counts
    return ChannelCells(tuple(series), np.concatenate(powers), number, tuple(names), own)


def tolerance(cells: ChannelCells, left: Array, accuracy: float) -> Array:
    """Return the deviation that each coefficient is allowed beside noise, for formulas are not the real thing.

    A share of the gap's power in every cell, falling off from time scale to time scale of a phase, and the
    accuracy that the model claims.
    """
    count = cells.sums(np.ones(len(left)))
    gap = cells.sums(np.maximum(left**2 - 1.0, 0.0) * cells.floor) / count
    phases = np.array([name[0] for name in cells.names])
    bands = np.array([name[1] for name in cells.names])
    near = (phases[:, None] == phases) * _LEAK ** np.abs(bands[:, None] - bands)
    allowed = MISFIT**2 * near @ gap
    return np.asarray(np.sqrt(1.0 + (allowed[cells.cell] + accuracy**2) / cells.floor))


def channel_places(cells: ChannelCells, left: Array) -> list[Place]:
    """Return phases by time scales, largest gap first; `p_value` allows for the cells of all channels."""
    energy, count = cells.sums(left**2), cells.sums(np.ones(len(left)))
    power = cells.sums(cells.floor) / count
    raw = fisher.sf(energy / count, count, cells.trust)
    p_values = np.minimum(holm(raw) * len(CHANNEL_UNITS), 1.0)
    excess = np.maximum(energy - count, 0.0)
    squares = cells.sums(np.maximum(left**2 - 1.0, 0.0) * cells.floor)
    share = np.where(p_values < SIGNIFICANT, squares, 0.0)
    share /= float(share.sum()) or 1.0
    samples = {
        phase: sum(int(count[k]) for k, name in enumerate(cells.names) if name[0] == phase)
        for phase, _ in cells.names
    }
    begins: dict[str, float] = {}
    for each in cells.series:
        for phase, piece in each.pieces():
            start_s = float(each.inputs.time_s[piece.start])
            begins[phase] = min(begins.get(phase, start_s), start_s)
    found = [
        Place(
            "",
            phase,
            band_name(band),
            math.sqrt(float(excess[k] * power[k]) / samples[phase]),
            float(share[k]),
            float(energy[k] / count[k]),
            float(p_values[k]),
            begins[phase],
        )
        for k, (phase, band) in enumerate(cells.names)
    ]
    return sorted(found, key=lambda place: (-place.share, -place.rms))


def channel_bands() -> tuple[str, ...]:
    """Return the time scales of a channel's map, fast to slow."""
    return tuple(band_name(band) for band in range(len(_BANDS_S) - 1))


def band_name(band: int) -> str:
    """Return a time scale in words."""
    low, high = _BANDS_S[band], _BANDS_S[band + 1]
    if not low:
        return f"under {high:g} s"
    if math.isinf(high):
        return f"over {low / 60:.0f} min"
    return f"{low:g}..{high:g} s" if high < 600.0 else f"{low / 60:.0f}..{high / 60:.0f} min"


def gap_rms(cells: ChannelCells, left: Array, places: Sequence[Place]) -> float:
    """Return the rms above the floor over all samples, in the channel's unit; 0 where nothing is significant."""
    clear = {(place.part, place.band) for place in places if place.clear}
    on = np.array([(phase, band_name(band)) in clear for phase, band in cells.names])[cells.cell]
    squares = float(((left**2 - 1.0) * cells.floor)[on].sum())
    return math.sqrt(max(squares, 0.0) / len(left))
