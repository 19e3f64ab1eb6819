"""Lines: something periodic that no effect explains, found in what the best set leaves of each run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.gap._data import Group
from bench.gap._noise import Noise, spectrum

Array = NDArray[np.float64]
_WIDTH = 8
_AROUND = 6
"""Windows on either side that say how high the surroundings are."""
_LONGEST_S = 700.0
_CAUTION = 3.0
"""Log odds against a line, beside the number of windows looked at."""
_MISFIT_SHARE = 0.1
"""Part of a profile's gap below which a line is taken for an effect's misfit."""


@dataclass(frozen=True)
class SpectralLine:
    """A line in the runs of one profile: period, amplitude there, log evidence; what part of a turn it lasts."""

    profile: str
    period_s: float
    amplitude_dph: float
    log_evidence: float
    turns: float

    @property
    def frequency_hz(self) -> float:
        """Frequency of the line."""
        return 1.0 / self.period_s

    @property
    def harmonic(self) -> int:
        """Which harmonic of the table's angle it is; 0 if none up to the 24th."""
        if self.turns <= 0.0:
            return 0
        order = round(1.0 / self.turns)
        return order if 1 <= order <= 24 and abs(1.0 / self.turns - order) < 0.01 * order else 0


def strongest_line(
    groups: Sequence[Group], residuals: Sequence[Array], noise: Noise, gaps: dict[str, float]
) -> SpectralLine | None:
    """Return the strongest line in whitened residuals (runs, n - 1) of each group; None without a clear one.

    `gaps` holds each profile's energy above the floor under the nominal model: a line that is a small part of
    it may be an effect's misfit. Probability is of the strongest of all windows looked at (Sidak).
    """
    found: list[SpectralLine] = []
    looked_at = sum(max(residual.shape[1] // _WIDTH, 1) for residual in residuals)
    for group, residual in zip(groups, residuals, strict=True):
        run = group.runs[0][0]
        period_s = run.stimulus.period_s
        windows = residual.shape[1] // _WIDTH
        energy = (residual[:, : windows * _WIDTH].reshape(len(residual), windows, _WIDTH) ** 2).sum(
            axis=(0, 2)
        )
        size = float(_WIDTH * len(residual))
        first = math.ceil(2.0 * (residual.shape[1] + 1) * period_s / _LONGEST_S / _WIDTH)
        if windows - first < 4 * _AROUND:
            continue
        around = _surroundings(energy)
        ratio = np.maximum(around / size, 1.0)
        log_p = chi2.logsf(energy[first:] / ratio[first:], size)
        k = int(np.argmin(log_p)) + first
        excess = float(energy[k] - around[k])
        evidence = -float(log_p[k - first]) - math.log(looked_at) - _CAUTION
        if evidence <= 0.0 or excess < _MISFIT_SHARE * gaps.get(group.profile, 0.0):
            continue
        middle = (k + 0.5) * _WIDTH + 1.0
        own_s = 2.0 * (residual.shape[1] + 1) * period_s / middle
        power = float(spectrum(noise, np.array([middle / (residual.shape[1] + 1)]), period_s)[0])
        amplitude = math.sqrt(2.0 * excess * power / residual.size)
        rate = float(np.median(np.abs(run.stimulus.table_rate_dps)))
        found.append(SpectralLine(group.profile, own_s, amplitude, evidence, rate * own_s / 360.0))
    return max(found, key=lambda line: line.log_evidence) if found else None


def _surroundings(energy: Array) -> Array:
    """Return the median of the windows around each, itself and its neighbours left out, as a mean, (windows,)."""
    offsets = [k for k in range(-_AROUND - 1, _AROUND + 2) if abs(k) > 1]
    padded = np.pad(energy, _AROUND + 1, mode="reflect")
    at = np.arange(len(energy)) + _AROUND + 1
    return np.asarray(np.median([padded[at + k] for k in offsets], axis=0))
