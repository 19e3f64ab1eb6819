"""Lines: something periodic that no effect explains, found in what the best set leaves of each run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct
from scipy.stats import chi2

from bench.analysis.gap._cells import power_in
from bench.analysis.gap._data import GapRun, Group
from bench.analysis.gap._noise import Noise, power_of
from drivers.base.arrays import Array

_WIDTH = 8
_AROUND = 6
"""Windows on either side that say how high the surroundings are."""
_LONGEST_S = 700.0
_CAUTION = math.log(100.0)
"""Log odds against a line, beside the number of windows looked at: noise alone has one in a set of a hundred."""
_MISFIT_SHARE = 0.1
"""Part of a profile's gap below which a line is taken for an effect's misfit."""
_STANDS_OUT, _ROUNDING = 10.0, 1e-12
"""Times its surroundings from which an input is periodic at a frequency; part of its energy that is rounding."""
_WANDERS = 0.05
"""Part of its frequency within which a line counts as one that is named: a unit over -35 to 80 degC, a beat."""


@dataclass(frozen=True)
class SpectralLine:
    """A line in the runs of `profile`, or of several: period, amplitude, log evidence; part of a turn it is.

    `follows`: the input that is periodic there itself (a table that swings, a chamber that cycles), "" if none.
    """

    profile: str
    period_s: float
    amplitude_dph: float
    log_evidence: float
    turns: float
    follows: str = ""

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
    groups: Sequence[Group],
    residuals: Sequence[Array],
    noise: Noise,
    gaps: dict[str, float],
    named_hz: Sequence[float] = (),
) -> SpectralLine | None:
    """Return the strongest line in whitened residuals (runs, n - 1) of each group; None without a clear one.

    `gaps` holds each profile's energy above the floor under the nominal model: a line that is a small part of
    it may be an effect's misfit. Looked at are the runs of each profile, and those of all profiles of one length:
    what hums in a laboratory does so at one frequency in all of them. Probability is of the strongest of all
    windows looked at (Sidak). What is left near the alias of a line that is named already, `named_hz`, is none:
    a line may follow temperature. One that is weaker than what rounding does to a turning table is of it: where
    the rows beat with the last digit, or a turn with the codes, that is no noise but a pattern.
    """
    found: list[SpectralLine] = []
    pools = _of_one_length(groups)
    looked_at = sum(max(residuals[pool[0]].shape[1] // _WIDTH, 1) for pool in pools)
    for pool in pools:
        residual = np.concatenate([residuals[each] for each in pool])
        runs = [groups[each].runs[0][0] for each in pool]
        period_s = runs[0].stimulus.period_s
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
        log_p = _log_tail(energy[first:] / ratio[first:], size)
        for line_hz in named_hz:
            cycles = abs((line_hz * period_s + 0.5) % 1.0 - 0.5)
            own = 2.0 * cycles * (residual.shape[1] + 1) - 1.0
            low, high = (int(own * (1.0 + part)) // _WIDTH - first for part in (-_WANDERS, _WANDERS))
            log_p[max(low - 1, 0) : max(high + 2, 0)] = 0.0
        k = int(np.argmin(log_p)) + first
        excess = float(energy[k] - around[k])
        evidence = -float(log_p[k - first]) - math.log(looked_at) - _CAUTION
        if evidence <= 0.0 or excess < _MISFIT_SHARE * sum(gaps.get(run.profile, 0.0) for run in runs):
            continue
        middle = (k + 0.5) * _WIDTH + 0.5  # window 0 holds the coefficients 1 .. 8
        own_s = 2.0 * (residual.shape[1] + 1) * period_s / middle
        power = float(np.mean([power_in(groups[each], noise)[round(middle) - 1] for each in pool]))
        amplitude = math.sqrt(2.0 * excess * power / residual.size)
        if 0.5 * amplitude**2 < float(np.mean([_of_rounding(groups[each]) for each in pool])):
            continue
        rate = max(float(np.median(np.abs(run.stimulus.table_rate_dps))) for run in runs)
        names = ", ".join(run.profile for run in runs)
        follows = _periodic_input(runs, windows, k)
        found.append(SpectralLine(names, own_s, amplitude, evidence, rate * own_s / 360.0, follows))
    return max(found, key=lambda line: line.log_evidence) if found else None


def _of_rounding(group: Group) -> float:
    """Return the mean square of what rounding of stamps and angles does to a group's rate, (deg/h)^2."""
    s = group.flat[0].stimulus
    return float(power_of(group.known_noise, len(s), s.period_s).mean())


def _periodic_input(runs: Sequence[GapRun], windows: int, at: int) -> str:
    """Return the input of one of the runs that stands out most in a window of their spectra, "" if none does."""
    most, result = _STANDS_OUT, ""
    for s in (run.stimulus for run in runs):
        inputs = {
            "input rate": s.input_rate_dph,
            "table rate": s.table_rate_dps,
            "T_in": s.t_in_c,
            "T_out": s.t_out_c,
        }
        for name, values in inputs.items():
            power = dct(values, norm="ortho")[1 : windows * _WIDTH + 1].reshape(windows, _WIDTH) ** 2
            energy = power.sum(axis=1)
            around = max(float(_surroundings(energy)[at]), _ROUNDING * float(energy.sum()))
            if energy[at] > most * around:
                most, result = float(energy[at]) / around, name
    return result


def _log_tail(energy: Array, count: float) -> Array:
    """Return the logarithm of the chi-square tail, beyond what numbers hold too (its leading term)."""
    half = 0.5 * np.maximum(energy, 1e-12)
    leading = -half + (0.5 * count - 1.0) * np.log(half) - math.lgamma(0.5 * count)
    exact = chi2.logsf(energy, count)
    return np.asarray(np.where(np.isfinite(exact), exact, leading))


def _of_one_length(groups: Sequence[Group]) -> list[list[int]]:
    """Return the places of each group alone, and of groups whose windows are of the same frequencies together."""
    alike: dict[tuple[int, float], list[int]] = {}
    for place, group in enumerate(groups):
        run = group.runs[0][0]
        alike.setdefault((len(run.stimulus), run.stimulus.period_s), []).append(place)
    return [[place] for place in range(len(groups))] + [each for each in alike.values() if len(each) > 1]


def _surroundings(energy: Array) -> Array:
    """Return the median of the windows around each, itself and its neighbours left out, as a mean, (windows,)."""
    offsets = [k for k in range(-_AROUND - 1, _AROUND + 2) if abs(k) > 1]
    padded = np.pad(energy, _AROUND + 1, mode="reflect")
    at = np.arange(len(energy)) + _AROUND + 1
    return np.asarray(np.median([padded[at + k] for k in offsets], axis=0))
