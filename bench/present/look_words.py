"""What a look at a log found, in words: the same on the terminal and on the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.analysis.look import AxisLook, Look

_MOST = 4
_COARSE = 1.0
_HELD = 0.2
"""Part of the variance on legs left out from which on an axis is said to follow a temperature."""


def clock_words(found: Look) -> str:
    """Return rows, rate, length and gaps of a log."""
    clock = found.clock
    length = max(len(axis.values) for axis in found.axes) / clock.per_s
    rate = (
        f"at {clock.rate_hz:.6g} Hz by {clock.source}, {length:.6g} s"
        if clock.known
        else "at an unknown rate"
    )
    words = f"{clock.rows} rows {rate}"
    if clock.gaps:
        words += f"; {clock.gaps} gaps with {clock.lost} rows lost, the longest {clock.longest_s:.3g} s"
    if clock.bursts:
        return words + "; its times are those of reading in bursts: rows are taken as equally far apart"
    return words + (f"; {clock.odd} rows at a time not after the one before" if clock.odd else "")


def motion_words(found: Look) -> str:
    """Return what is rest and what turning."""
    motion, unit = found.motion, "s" if found.clock.known else "samples"
    if not motion.judged:
        return "rest and turning were not looked for: the whole log counts as rest"
    rest = sum(stop - start for start, stop in motion.rests_s)
    words = (
        f"taken for rest, as the quietest: {rest:.4g} {unit} in {len(motion.rests_s)} stretches; "
        f"shaken {motion.shaken_s:.4g} {unit}; "
    )
    if not motion.by_gyros:
        return words + "told by accelerometers alone, which do not see how it turned"
    words += f"{len(motion.turns)} turns"
    shown = [
        f"{turn.axis} {turn.rate:.4g} from {turn.start_s:.4g} to {turn.stop_s:.4g} {unit} ({turn.angle:.4g})"
        for turn in motion.turns[:_MOST]
    ]
    more = f" and {len(motion.turns) - _MOST} more" if len(motion.turns) > _MOST else ""
    return words + (f": {', '.join(shown)}{more}" if shown else "")


def noise_words(axis: AxisLook) -> str:
    """Return white noise and bias instability, and whether the fit describes the Allan deviation."""
    allan = axis.allan
    if allan is None or not math.isfinite(allan.coefficients[0, 0]):
        return "too short a rest"
    factor, white_unit = _white(axis)
    if not allan.fits:
        off = f"no fit: off by {allan.worst_ratio:.2g} at {allan.worst_tau_s:.3g} {_time_unit(axis)}"
        if not math.isfinite(allan.white):
            return f"{off}; nowhere falls as white noise does"
        return f"{off}; white {factor * allan.white:.3g} {white_unit}"
    white = _coefficient("N", factor, allan.coefficients[:, 1].tolist(), white_unit)
    return f"{white}, {_coefficient('B', 1.0, allan.coefficients[:, 2].tolist(), allan.unit)}"


def _coefficient(name: str, factor: float, of: Sequence[float], unit: str) -> str:
    """Return a coefficient `of` value, low and high end in words, times a factor."""
    value, low, high = of
    if low > 0.0 or value > 0.0:
        return f"{name} {factor * value:.3g} {unit}"
    if not math.isfinite(high):
        return f"{name} not told by so short a rest"
    return f"{name} below {factor * high:.3g} {unit}"


def _white(axis: AxisLook) -> tuple[float, str]:
    """Return what makes of the Allan fit's white noise, in its unit times sqrt(h), the unit returned."""
    base = axis.channel.base_unit
    if not axis.clock_known:  # what is called an hour are 3600 samples then
        return 60.0, f"{base} sqrt(sample)"
    units = {"deg/s": (1.0, "deg/sqrt(h)"), "m/s^2": (3600.0, "m/s/sqrt(h)")}
    return units.get(base, (60.0, f"{base} sqrt(s)"))


def _time_unit(axis: AxisLook) -> str:
    return "s" if axis.clock_known else "samples"


def frequency_unit(*, clock_known: bool) -> str:
    """Return the unit of a log's frequencies: without a known clock they are of the samples."""
    return "Hz" if clock_known else "cycles a sample"


def nyquist_words(found: Look) -> str:
    """Return how far the spectra reach, and what their lines do not say."""
    unit = frequency_unit(clock_known=found.clock.known)
    rate = found.clock.per_s
    return (
        f"Spectra reach up to the Nyquist frequency, {0.5 * rate:.5g} {unit}. A line's frequency is that in the "
        f"record; its cause may also lie at any multiple of {rate:.5g} {unit} plus or minus it."
    )


def noticed(axis: AxisLook) -> list[str]:
    """Return what else an axis shows: outliers, steps, limits, a coarse grid, missing values, a temperature."""
    figures, words = axis.figures, []
    if figures.missing:
        words.append(f"{figures.missing} missing")
    if figures.outliers:
        words.append(f"{figures.outliers} outliers, up to {figures.largest_outlier:.3g}")
    if figures.steps:
        words.append(
            "steps " + ", ".join(f"{size:+.3g} at {time_s:.4g}" for time_s, size in figures.steps[:_MOST])
        )
    if figures.limits:
        words.append("saturates at " + ", ".join(f"{limit:.5g}" for limit in figures.limits))
    if figures.quantum > _COARSE * figures.sigma:
        words.append(f"coarse: steps of {figures.quantum:.3g}")
    heat = axis.temperature
    if heat is not None and heat.explained is None:
        words.append(f"{heat.slope:.3g} a K, on one leg: a drift may look the same")
    elif heat is not None and heat.explained is not None:
        told = max(heat.explained, 0.0)
        words.append(
            f"follows {heat.channel}: {100 * told:.0f} % on legs left out, {heat.slope:.3g} a K"
            if told > _HELD
            else f"{heat.channel} foretells nothing of a leg left out"
        )
    return words
