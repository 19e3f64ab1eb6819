"""The noise of a run's rows: level and form of its spectrum, by which what is faster than the means is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from bench.analysis.common.spectrum import median_of
from bench.analysis.gap._noise import Noise, spectrum
from drivers.base.arrays import Array

_NODES_A_DECADE, _FEWEST = 16, 16
_FORM_SIGMA = 0.05
"""Part by which the density of a real gyro's noise differs from its form."""
_WORTH = 6.0
"""Half the chi squared that each further parameter of the form must bring, beside its Occam factor."""
_WHITE, _ANGLE, _ANALOG, _DIGITAL, _STAGE = "white", "angle", "analog", "digital", "stage"
_LEAST_DAMPING = 0.25
"""Damping below which a stage of second order is a resonance, which is a gap and no form of noise."""
_LEAST_ORDER = 0.9
_STEEPEST, _WIDE = 8.0, 12.0
"""Largest order of a low pass; how far a fit may go from where it begins, in logarithms."""
_DEEPEST = 1e-6
"""Part of the white level below which a stop band is as good as empty: what rounding leaves."""


@dataclass(frozen=True)
class FastFloor:
    """White noise of the rows, as an angle random walk, and what gives its spectrum its form.

    `corner_hz` and `order`: a low pass in the unit or the logger, NaN and 0 for none; `digital`: one that reaches
    zero at half the rows' rate. `angle_arcsec`: white noise of the angle between rows, 1 sigma, as of a counter
    or a base that shakes; 0 for none. `damping`: of an output stage of second order at `corner_hz`, NaN for none.
    `model_arw`: what the model has, deg/sqrt(h).
    """

    arw_deg_per_sqrt_h: float
    model_arw: float
    corner_hz: float = math.nan
    order: float = 0.0
    digital: bool = False
    angle_arcsec: float = 0.0
    damping: float = math.nan

    def density(self, frequency_hz: Array, row_s: float) -> Array:
        """Return the one-sided power density, (deg/h)^2/Hz, (m,)."""
        return self.over(frequency_hz, row_s, _of_one_unit(frequency_hz, row_s))

    def over(self, frequency_hz: Array, row_s: float, of_one_unit: tuple[Array, Array]) -> Array:
        """Return the density from those of 1 deg/sqrt(h) and 1 arcsec at the same frequencies."""
        white, angle = of_one_unit
        formed = self.arw_deg_per_sqrt_h**2 * white * self._gain(frequency_hz, row_s)
        return np.asarray(formed + self.angle_arcsec**2 * angle)

    def _gain(self, frequency_hz: Array, row_s: float) -> Array:
        if not math.isnan(self.damping):
            return self._second_order(frequency_hz, row_s)
        if not self.order:
            return np.ones(len(frequency_hz))
        ratio = frequency_hz / self.corner_hz
        if self.digital:  # bilinear transform
            half_turn = 0.5 * math.pi - 1e-9
            ratio = np.tan(np.minimum(math.pi * frequency_hz * row_s, half_turn)) / math.tan(
                min(math.pi * self.corner_hz * row_s, half_turn)
            )
        return np.maximum(1.0 / (1.0 + ratio ** (2.0 * self.order)), _DEEPEST)

    def _second_order(self, frequency_hz: Array, row_s: float) -> Array:
        """Return the gain of a pair of poles, impulse invariant: a recursion from row to row (AR(2))."""
        natural = 2.0 * math.pi * self.corner_hz * row_s
        radius = math.exp(-self.damping * natural)
        pole = radius * np.exp(1j * natural * math.sqrt(max(1.0 - self.damping**2, 0.0)))
        turn = np.exp(-2j * math.pi * frequency_hz * row_s)
        size = np.abs((1.0 - pole * turn) * (1.0 - np.conj(pole) * turn))
        return np.asarray((np.abs(1.0 - pole) ** 2 / size) ** 2)

    @property
    def sentence(self) -> str:
        """What the rows' noise is, beside the model's."""
        text = (
            f"white noise of the rows is as of {self.arw_deg_per_sqrt_h:.3g} deg/sqrt(h), "
            f"the model has {self.model_arw:.3g}"
        )
        if not math.isnan(self.damping):
            text += f"; a stage of second order forms it, {self.corner_hz:.3g} Hz, damping {self.damping:.2g}"
        if 0.0 < self.order < _LEAST_ORDER:
            text += f"; it falls from {self.corner_hz:.3g} Hz on, more slowly than behind a low pass"
        elif self.order:
            text += f"; it falls beyond {self.corner_hz:.3g} Hz, as by a low pass of order {self.order:.2g}"
        if self.angle_arcsec:
            text += f"; beside it white noise of the angle, {self.angle_arcsec:.3g} arcsec a row"
        return text


def density_of(noise: Noise, frequency_hz: Array, row_s: float) -> Array:
    """Return the one-sided power density of a gyro's noise in rows `row_s` apart, (deg/h)^2/Hz, (m,)."""
    return np.asarray(2.0 * row_s * spectrum(noise, 2.0 * row_s * frequency_hz, row_s))


def _of_one_unit(frequency_hz: Array, row_s: float) -> tuple[Array, Array]:
    """Return the densities of 1 deg/sqrt(h) and of 1 arcsec of white angle noise, (m,) each."""
    arcsec = Noise(0.0, quantum_arcsec=math.sqrt(12.0))
    return density_of(Noise(1.0), frequency_hz, row_s), density_of(arcsec, frequency_hz, row_s)


def fast_floor(
    frequency_hz: Array, density: Array, freedom: float, row_s: float, model_arw: float
) -> FastFloor:
    """Return level and form of a density's noise, (m,) over (m,), lines and bands in it left aside.

    Medians of a sixteenth of a decade are fitted, so that lines do not count; the form is chosen by its fit.
    """
    nodes_hz, level, bins = _nodes(frequency_hz, density / median_of(freedom))
    sigma = np.sqrt(0.5 * math.pi * (2.0 / freedom) / bins + _FORM_SIGMA**2)
    level = np.maximum(level, _DEEPEST * level.max())
    arw = math.log(math.sqrt(float(np.median(level[: max(len(level) // 4, 1)])) / 7200.0))
    of_one_unit = _of_one_unit(nodes_hz, row_s)
    top_hz = 0.5 / row_s
    angle = math.log(math.sqrt(float(level[-1] / of_one_unit[1][-1])))
    best: tuple[float, FastFloor] | None = None
    for form, start in _starts(arw, angle, top_hz):
        low, high = _bounds(form, start, top_hz)

        def off(at: Array, form: str = form) -> Array:
            formed = _floor(form, at, model_arw).over(nodes_hz, row_s, of_one_unit)
            return np.asarray(np.log(level / formed) / sigma)

        found = least_squares(
            off, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), loss="soft_l1"
        )
        cost = float(found.cost) + _WORTH * (len(start) - 1)
        if best is None or cost < best[0]:
            best = cost, _floor(form, found.x, model_arw)
    assert best is not None
    return best[1]


def _floor(form: str, at: Array, model_arw: float) -> FastFloor:
    """Return a floor of a form at the logarithms of its parameters."""
    values = np.exp(at).tolist()
    if form == _ANGLE:
        return FastFloor(values[0], model_arw, angle_arcsec=values[1])
    if form == _STAGE:
        return FastFloor(values[0], model_arw, values[1], damping=values[2])
    corner_hz, order = values[1:] or (math.nan, 0.0)
    return FastFloor(values[0], model_arw, corner_hz, order, digital=form == _DIGITAL)


def _starts(arw: float, angle: float, top_hz: float) -> list[tuple[str, Array]]:
    """Return the forms with logarithms at which their fits begin."""
    corners = [math.log(part * top_hz) for part in (0.1, 0.3, 0.7)]
    low_passes = [
        (form, np.array([arw, at, math.log(2.0)])) for form in (_ANALOG, _DIGITAL) for at in corners
    ]
    stages = [(_STAGE, np.array([arw, at, math.log(0.5)])) for at in corners]
    return [(_WHITE, np.array([arw])), (_ANGLE, np.array([arw, angle])), *low_passes, *stages]


def _bounds(form: str, start: Array, top_hz: float) -> tuple[Array, Array]:
    """Return the least and the largest logarithms of a form's parameters."""
    low, high = start - _WIDE, start + _WIDE
    if form in (_ANALOG, _DIGITAL):
        low[1:], high[1:] = np.log([0.5, 0.5]), np.log([max(top_hz, 0.6), _STEEPEST])
    if form == _STAGE:
        low[1:], high[1:] = np.log([0.5, _LEAST_DAMPING]), np.log([max(top_hz, 0.6), 1.0])
    return low, high


def _nodes(frequency_hz: Array, density: Array) -> tuple[Array, Array, Array]:
    """Return middle frequencies of bands, their median density and their bins, (nodes,) each."""
    count = len(frequency_hz)
    edges = [0]
    while edges[-1] < count:
        further = np.searchsorted(frequency_hz, frequency_hz[edges[-1]] * 10.0 ** (1.0 / _NODES_A_DECADE))
        edges.append(min(max(edges[-1] + _FEWEST, int(further)), count))
    if len(edges) > 2 and edges[-1] - edges[-2] < _FEWEST:
        del edges[-2]
    parts = [slice(low, high) for low, high in pairwise(edges)]
    middle = np.array([np.exp(np.mean(np.log(frequency_hz[part]))) for part in parts])
    level = np.array([np.median(density[part]) for part in parts])
    return middle, level, np.array([part.stop - part.start for part in parts], dtype=np.float64)
