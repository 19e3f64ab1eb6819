"""Noise floor without the model, and which stochastic effect raises it: spectra of repeats or of quiet runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from bench.analysis.gap._cells import left_of_noise, mixed_whitened, mixing, power_in
from bench.analysis.gap._data import GapRun, Group
from bench.analysis.gap._fit import solve
from bench.analysis.gap._noise import (
    CORRELATED,
    NAMES,
    Noise,
    NoiseFit,
    Periodogram,
    fit_noise,
    periodogram,
    power_of,
)
from drivers.base.arrays import Array

EFFECT_OF = {
    "arw_deg_per_sqrt_h": "noise_level",
    "bias_instability_dph": "bias_instability",
    "rate_random_walk_dph_per_sqrt_h": "rate_random_walk",
    "quantum_arcsec": "quantisation",
}
_SHEET_WIDTHS = {"arw_deg_per_sqrt_h": 0.07, "bias_instability_dph": 0.25, "quantum_arcsec": 0.15}
_PENALTY = 4.0
"""Log prior odds and Occam factor of one raised coefficient."""
_LEAST_RISE = 1.15
_LEAST_POWER = 1.35
"""Power against the data sheet's fitted kinds, at some time scale, from which noise counts as raised."""
DIFFERS = "differs between repeats"
"""What is no noise of the gyro's kinds and yet not the same in each repeat: telegraph noise, weather, ageing."""
_CORRELATIONS = tuple(
    (order, time_s) for order in (1, 2) for time_s in (20.0, 60.0, 200.0, 600.0, 2000.0, 6000.0)
)
_DIFFERS_PENALTY = 10.0
_QUIET_SPAN_K, _STILL_DPS = 2.0, 0.01
_MOSTLY = 0.3
"""Part of the power from which the angle's codes are told from the gyro's own noise."""
REPEATS = "differences of repeats"
DATA_SHEET = "data sheet"


@dataclass(frozen=True)
class NoiseVerdict:
    """Fitted noise, and the probability that each stochastic effect raised it ("" for none)."""

    noise: Noise
    probabilities: Mapping[str, float]
    source: str
    rises: Mapping[str, float]
    sheet: Noise

    def risen(self, effect: str) -> str:
        """Return in words which coefficient a stochastic effect raised, from what to what; empty for others."""
        name = next((name for name, own in EFFECT_OF.items() if own == effect), "")
        if effect not in self.rises or not name:
            return ""
        return f"{name} = {self.rises[effect]:.3g}, the model has {getattr(self.sheet, name):.3g}"

    @property
    def named(self) -> str:
        """The most probable stochastic effect, "" for none."""
        likely = max(self.probabilities, key=lambda name: self.probabilities[name])
        return "" if likely == DIFFERS else likely

    @property
    def differs(self) -> float:
        """Probability that repeats differ by more than a gyro's kinds of noise."""
        return self.probabilities.get(DIFFERS, 0.0)


def judge_noise(data: Sequence[Periodogram], sheet: Noise, source: str) -> NoiseVerdict:
    """Fit the noise with the sheet's values, and with each coefficient set free in turn, and compare."""
    if not data:
        return NoiseVerdict(sheet, {"": 1.0}, DATA_SHEET, {}, sheet)
    widths = {name: width for name, width in _SHEET_WIDTHS.items() if getattr(sheet, name) > 0.0}
    base = fit_noise(data, sheet, widths)
    fits = {"": base}
    scores = {"": -base.cost}
    for name in NAMES:
        freed = [
            fit_noise(data, replace(sheet, **{name: start}), {**widths, name: 1.5})
            for start in _starts(sheet, name)
        ]
        best = min(freed, key=lambda fit: fit.cost)
        if getattr(best.noise, name) > _LEAST_RISE * getattr(sheet, name) and _raised(
            data, best.noise, _usual(base.noise, sheet)
        ):
            fits[EFFECT_OF[name]] = best
            scores[EFFECT_OF[name]] = -best.cost - _PENALTY
    if source == REPEATS:
        found = min(
            (_correlated(data, sheet, widths, *grid) for grid in _CORRELATIONS), key=lambda fit: fit.cost
        )
        fits[DIFFERS], scores[DIFFERS] = found, -found.cost - _DIFFERS_PENALTY
    weights = softmax(np.array(list(scores.values())))
    probabilities = dict(zip(scores, weights.tolist(), strict=True))
    chosen = max(probabilities, key=lambda name: probabilities[name])
    rises = {EFFECT_OF[name]: float(getattr(fits[chosen].noise, name)) for name in NAMES}
    return NoiseVerdict(fits[chosen].noise, probabilities, source, rises, sheet)


def _raised(data: Sequence[Periodogram], noise: Noise, usual: Noise) -> bool:
    """Return whether noise has clearly more power than usual somewhere: it is never quite of its kind."""
    ratios = [part.power(noise) / part.power(usual) for part in data]
    return max(float(ratio.max()) for ratio in ratios) > _LEAST_POWER


def _usual(noise: Noise, sheet: Noise) -> Noise:
    """Return fitted noise as far as units differ from their data sheet, two standard deviations."""
    most = {name: getattr(sheet, name) * math.exp(2.0 * width) for name, width in _SHEET_WIDTHS.items()}
    return replace(noise, **{name: min(getattr(noise, name), value) for name, value in most.items()})


def _correlated(
    data: Sequence[Periodogram], sheet: Noise, widths: Mapping[str, float], order: float, time_s: float
) -> NoiseFit:
    """Fit the noise with a correlated part of some time and order beside the sheet's."""
    scale = sheet.bias_instability_dph or 6.0 * sheet.arw_deg_per_sqrt_h
    start = replace(sheet, correlated_dph=scale, correlation_time_s=time_s, correlation_order=order)
    return fit_noise(data, start, {**widths, CORRELATED: 2.0})


def _starts(sheet: Noise, name: str) -> list[float]:
    value = float(getattr(sheet, name))
    if name == "quantum_arcsec":
        least = 60.0 * sheet.arw_deg_per_sqrt_h
        return [max(value, part * least) * 2.0 for part in (0.3, 1.0, 3.0)]
    scale = value or sheet.bias_instability_dph or 6.0 * sheet.arw_deg_per_sqrt_h
    return [1.5 * scale, 4.0 * scale, 15.0 * scale]


def floor_data(
    groups: Sequence[Group], stacks: Sequence[NDArray[Any]], sheet: Noise, sigmas: Array
) -> tuple[list[Periodogram], str]:
    """Return spectra that hold noise only: differences of repeats, else quiet runs less their warm-up.

    `stacks` holds each group's coefficients of [data, nominal columns], (runs, 1 + q, n - 1).
    """
    repeats = []
    for group, stack in zip(groups, stacks, strict=True):
        rows = [k for k, same in enumerate(mixing(group)[1]) if not same]
        if rows:
            left = _less_nominal(mixed_whitened(group, stack, sheet)[rows], sigmas)
            repeats.append(_coloured(group, left, sheet))
    if repeats:
        return repeats, REPEATS
    quiet = []
    for group, stack in zip(groups, stacks, strict=True):
        for run, own in zip(group.flat, stack, strict=True):
            if is_quiet(run):
                alone = Group(group.profile, ("0",), ((run,),))
                left = _less_nominal(mixed_whitened(alone, own[None], sheet), sigmas)
                quiet.append(_coloured(group, left, sheet, skip=5))
    return quiet, "quiet runs" if quiet else DATA_SHEET


def is_quiet(run: GapRun) -> bool:
    """Return whether temperature and table stand still in a run."""
    span_k, span_dps = np.ptp(run.stimulus.warm_k), np.ptp(run.stimulus.table_rate_dps)
    return bool(span_k < _QUIET_SPAN_K and span_dps < _STILL_DPS)


def shared_codes(group: Group, stack: NDArray[Any], sheet: Noise, sigmas: Array) -> float:
    """Return the part, 0 to 1, of what the angle's codes do that is the same in a group's repeats.

    Their differences lack it: least squares where codes make most of the noise, the gyro's being the sheet's.
    """
    rows = [k for k, same in enumerate(mixing(group)[1]) if not same]
    s, power = group.flat[0].stimulus, power_in(group, sheet)
    codes = power_of(group.known_codes, len(s), s.period_s) / power
    mostly = codes > _MOSTLY
    if not rows or not mostly.any():
        return 0.0
    left = _less_nominal(mixed_whitened(group, stack, sheet)[rows], sigmas)[:, mostly]
    found = np.mean(left**2, axis=0) / left_of_noise(group, sheet, sheet)[mostly]
    codes = codes[mostly]
    return float(np.clip(1.0 - codes @ (found - 1.0 + codes) / (codes @ codes), 0.0, 1.0))


def _less_nominal(parity_runs: Array, sigmas: Array) -> Array:
    gram = np.einsum("rik,rjk->ij", parity_runs, parity_runs, optimize=True)
    solution = solve(gram, sigmas, ())
    return np.asarray(parity_runs[:, 0] - np.tensordot(solution.values, parity_runs[:, 1:], axes=(0, 1)))


def _coloured(group: Group, left: Array, sheet: Noise, skip: int = 1) -> Periodogram:
    """Return the periodogram of residuals in deg/h again, from whitened rows (m, n - 1)."""
    period_s = group.runs[0][0].stimulus.period_s
    bridged = left_of_noise(group, sheet, sheet)
    padded = np.zeros((len(left), left.shape[1] + 1))
    padded[:, 1:] = left * np.sqrt(power_in(group, sheet) / bridged)
    known = np.minimum(bridged, 1.0)
    part = math.sqrt(1.0 - group.shared)
    codes = group.known_codes
    known_codes = replace(
        codes,
        arw_deg_per_sqrt_h=part * codes.arw_deg_per_sqrt_h,
        quantum_arcsec=part * codes.quantum_arcsec,
    )
    return periodogram(padded, period_s, known, skip=skip, beside=group.known_stamps.beside(known_codes))
