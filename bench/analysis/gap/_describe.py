"""What the remainder looks like, so that its effect can be written: input, lag, frequency, harmonic, regime."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import idct

from bench.analysis.gap._cells import power_in
from bench.analysis.gap._findings import SIGNIFICANT, Place
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._generic import INPUTS, FreeCurve
from bench.analysis.gap._jumps import Jumps
from bench.analysis.gap._lines import SpectralLine
from bench.analysis.gap._model_file import Term
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._prepare import Prepared
from bench.analysis.gap._where import RegimePlace, regime_map
from bench.analysis.gap._which import Found, left_of_runs
from simulators.effects import Variant

_REACHED = 10.0
"""Times the median of their standard deviations from which on nodes of a curve are not shown."""


@dataclass(frozen=True)
class UnknownPart:
    """One thing that is left: what it follows and how; a free curve has its points, a line its frequency.

    `at` (m,) are values of the input, `curve` (m,) the output there in `unit`; both are empty without a curve.
    """

    follows: str
    sentence: str
    lag_s: float | None = None
    frequency_hz: float | None = None
    harmonic: int = 0
    unit: str = ""
    at: tuple[float, ...] = ()
    curve: tuple[float, ...] = ()
    term: Term | None = None


def _curve_part(variant: Variant, values: Sequence[float], sigmas: Sequence[float] = ()) -> UnknownPart:
    """Describe a free curve that was fitted, without nodes that by their `sigmas` the runs hardly reach."""
    term = Term(variant, tuple(values), (0.0,) * len(values))
    effect = variant.effect
    if not isinstance(effect, FreeCurve):
        raise TypeError(f"{effect.name} is no free curve")
    if effect.orders:
        size = list(zip((abs(value) for value in values), effect.orders, strict=True))
        _, order = max(size, key=lambda each: each[0])
        what = "proportional to rate" if effect.curve.of_rate else "at any rate"
        sentence = f"It follows the table's angle, {what}; strongest is harmonic {order} of a turn."
        return UnknownPart("table angle", sentence, harmonic=order, term=term)
    lag_s = variant.shape.get("lag_s")
    unit, kind = ("ppm of rate", "Scale factor") if effect.curve.of_rate else ("deg/h", "Bias")
    along = INPUTS[effect.curve.over]
    inputs, curve = effect.drawn(variant.shape, values)
    if effect.nodes and len(sigmas):
        reached = np.array(sigmas) <= _REACHED * np.median(sigmas)
        inputs, curve = inputs[reached], curve[reached]
    at = tuple(round(each, 2) for each in along.shown(inputs).tolist())
    top = int(np.argmax(np.abs(curve)))
    late = f", {lag_s:.0f} s late" if lag_s else ""
    sentence = (
        f"{kind} follows {effect.follows}{late}, by a curve that no effect of the catalogue has; "
        f"largest, {curve[top]:.3g} {unit}, at {at[top]:.3g} {along.unit}."
    )
    return UnknownPart(
        effect.follows, sentence, lag_s, unit=unit, at=at, curve=tuple(curve.tolist()), term=term
    )


def _line_part(line: SpectralLine) -> UnknownPart:
    """Describe a line."""
    bound = (
        f", harmonic {line.harmonic} of the table's angle"
        if line.harmonic
        else ", not bound to the table's angle"
    )
    size = f"{line.amplitude_dph:.3g} deg/h at {line.frequency_hz:.4g} Hz"
    if line.follows:
        sentence = (
            f"It is periodic as {line.follows} is: {size} (period {line.period_s:.4g} s) in runs of "
            f"{line.profile}. Look for what {line.follows} does that no effect of the catalogue does."
        )
    else:
        sentence = (
            f"It is periodic: {size}, or at what folds to it (period {line.period_s:.4g} s) in runs of "
            f"{line.profile}{bound}."
        )
    return UnknownPart(
        line.follows or "time", sentence, frequency_hz=line.frequency_hz, harmonic=line.harmonic
    )


def _differing_part(noise: Noise, run_id: str, at_s: float) -> UnknownPart:
    """Describe what is not the same in each repeat."""
    sentence = (
        f"It differs between repeats of the same run: {noise.correlated_dph:.3g} deg/h rms, changing within "
        f"{noise.correlation_time_s:.0f} s or so; most in {run_id} about {at_s / 60.0:.0f} min after its start. "
        "Look for what was not the same: weather, supply, ageing, a contact."
    )
    return UnknownPart("the repeat", sentence)


def crowd_part(names: Sequence[str]) -> UnknownPart:
    """Describe a function of the rate that several formulas together draw."""
    sentence = (
        f"It follows the input rate: {', '.join(names)} together draw its curve, and none of them is it. "
        "Look for an edge at some rate of one sense, or a resonance that turning excites."
    )
    return UnknownPart("input rate", sentence)


def _jumping_part(jumps: Jumps) -> UnknownPart:
    """Describe what steps in one repeat and not in another, or while nothing about it changes."""
    where = (
        "in one repeat and not in the other" if jumps.repeated else "while temperature and table stand still"
    )
    others = f", {jumps.number} such steps in all" if jumps.number > 1 else ""
    sentence = (
        f"It steps {where}: by {jumps.size_dph:.3g} deg/h in {jumps.run_id} about "
        f"{jumps.at_s / 60.0:.0f} min after its start{others}. Look for what has two states: a contact, a crack, "
        "a trim or a loop that latches, telegraph noise."
    )
    return UnknownPart("the repeat" if jumps.repeated else "time", sentence)


def shaken_part(noise: Noise, finest_arcsec: float) -> UnknownPart:
    """Describe noise that has quantisation's spectrum and not its steps."""
    sentence = (
        f"Noise grows with frequency as white noise of the angle does, as if read in steps of "
        f"{noise.quantum_arcsec:.3g} arcsec; the log has steps of {finest_arcsec:.2g} arcsec, so it is no "
        "quantisation. A base that shakes or sways does this: look at accelerometers, mounting, people and wind."
    )
    return UnknownPart("time", sentence)


def _remaining_part(left: Sequence[Place], regimes: Sequence[RegimePlace]) -> UnknownPart | None:
    """Describe what fits no curve: the cell and the regime where most is left; None if nothing stands out."""
    cells = [place for place in left if place.clear]
    if not cells:
        return None
    most = cells[0]
    where = [place for place in regimes if place.p_value < SIGNIFICANT]
    sentence = f"It shows in {most.profile} ({most.part}) at {most.band}, {most.rms:.3g} deg/h rms"
    if not where:
        return UnknownPart("none of the inputs", sentence + ".")
    best = max(where, key=lambda place: place.rms_dph)
    sentence += f", most of all at {best.of} {best.low:g} to {best.high:g} {best.unit}."
    return UnknownPart(best.of, sentence)


def unknown_parts(
    found: Found, variants: Sequence[Variant], left: Sequence[Place], bands: Mapping[str, set[int]]
) -> list[UnknownPart]:
    """Describe what is missing beside the best set: its free curves and line, else where most is left.

    `bands` has the bands with a gap by profile.
    """
    best, q = found.best, found.best.solution.indices.size
    parts: list[UnknownPart] = []
    nominal = q - sum(len(found.posterior.candidates[member].columns) for member in best.members)
    at = nominal
    for member in sorted(best.members):
        k = len(found.posterior.candidates[member].columns)
        if isinstance(variants[member].effect, FreeCurve):
            values, variances = best.solution.values, np.diag(best.solution.covariance)
            own = slice(at, at + k)
            parts.append(
                _curve_part(variants[member], values[own].tolist(), np.sqrt(variances[own]).tolist())
            )
        at += k
    if found.line is not None and best.line:
        parts.append(_line_part(found.line))
    if not parts and found.data.noise.differs < 0.5:
        left_over = left_of_runs(found.data, best.solution)
        regimes = regime_map(found.data.groups, left_over, found.data.floor, found.data.noise.noise, bands)
        rest = _remaining_part(left, regimes)
        parts += [] if rest is None else [rest]
    return parts


def differing_parts(
    data: Prepared, solution: Solution, jumps: Jumps | None = None, line: SpectralLine | None = None
) -> list[UnknownPart]:
    """Say how repeats differ beyond noise: how much, how slowly, and in which run most; where they jump.

    A line that comes with another phase in each repeat, and is larger than what differs, says it already.
    """
    parts, noise = [] if jumps is None else [_jumping_part(jumps)], data.noise.noise
    humming = jumps is None and line is not None and line.amplitude_dph > noise.correlated_dph
    if data.noise.differs <= 0.5 or humming:
        return parts
    most, run_id, at_s = 0.0, "", 0.0
    for group, left in zip(data.groups, left_of_runs(data, solution), strict=True):
        if len(group.flat) == len(group.runs):
            continue
        period_s = group.flat[0].stimulus.period_s
        n = left.shape[1] + 1
        coefficients = np.zeros((len(left), n))
        slow = math.ceil(2.0 * n * period_s / max(noise.correlation_time_s, 20.0 * period_s))
        coefficients[:, 1 : slow + 1] = (left * np.sqrt(power_in(group, noise)))[:, :slow]
        curves = idct(coefficients, norm="ortho", axis=-1)
        number = np.repeat(np.arange(len(group.runs)), [len(repeats) for repeats in group.runs])
        means = np.stack([curves[number == k].mean(axis=0) for k in range(len(group.runs))])
        apart = curves - means[number]
        run, sample = np.unravel_index(int(np.abs(apart).argmax()), apart.shape)
        if abs(apart[run, sample]) > most:
            most, run_id = float(abs(apart[run, sample])), group.flat[run].run_id
            at_s = float(sample * period_s)
    return [*parts, _differing_part(noise, run_id, at_s)]
