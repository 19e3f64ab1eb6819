"""What the remainder looks like, so that its effect can be written: input, lag, frequency, harmonic, regime."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.gap._findings import SIGNIFICANT, Place
from bench.analysis.gap._generic import PREFIX
from bench.analysis.gap._lines import SpectralLine
from bench.analysis.gap._model_file import Term
from bench.analysis.gap._where import RegimePlace
from simulators.effects import REFERENCE_C, Variant


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


def curve_part(variant: Variant, values: Sequence[float]) -> UnknownPart:
    """Describe a free curve that was fitted."""
    term = Term(variant, tuple(values), (0.0,) * len(values))
    name = variant.effect.name.removeprefix(PREFIX)
    names = [parameter.name for parameter in variant.effect.parameters]
    lag_s = variant.shape.get("lag_s")
    if "_at_" not in names[0]:
        size = {parameter: abs(value) for parameter, value in zip(names, values, strict=True)}
        order = int(max(size, key=lambda each: size[each]).rpartition("_")[2])
        what = "proportional to rate" if name.startswith("rate") else "at any rate"
        sentence = f"It follows the table's angle, {what}; strongest is harmonic {order} of a turn."
        return UnknownPart("table angle", sentence, harmonic=order, term=term)
    unit = "ppm of rate" if names[0].startswith("ppm") else "deg/h"
    above_c = REFERENCE_C if variant.effect.follows == "T_in" else 0.0
    at = tuple(float(each.rpartition("_at_")[2]) + above_c for each in names)
    top = int(np.argmax(np.abs(values)))
    late = f", {lag_s:.0f} s late" if lag_s else ""
    kind = "Scale factor" if unit.startswith("ppm") else "Bias"
    unit_at = {"T_in": "degC", "T_in - T_out": "K"}.get(variant.effect.follows, "K/min")
    sentence = (
        f"{kind} follows {variant.effect.follows}{late}, by a curve that no effect of the catalogue has; "
        f"largest, {values[top]:.3g} {unit}, at {at[top]:.3g} {unit_at}."
    )
    return UnknownPart(
        variant.effect.follows, sentence, lag_s, unit=unit, at=at, curve=tuple(values), term=term
    )


def line_part(line: SpectralLine) -> UnknownPart:
    """Describe a line."""
    bound = (
        f", harmonic {line.harmonic} of the table's angle"
        if line.harmonic
        else ", not bound to the table's angle"
    )
    sentence = (
        f"It is periodic: {line.amplitude_dph:.3g} deg/h at {line.frequency_hz:.4g} Hz "
        f"(period {line.period_s:.4g} s) in runs of {line.profile}{bound}."
    )
    return UnknownPart("time", sentence, frequency_hz=line.frequency_hz, harmonic=line.harmonic)


def remaining_part(left: Sequence[Place], regimes: Sequence[RegimePlace]) -> UnknownPart | None:
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
