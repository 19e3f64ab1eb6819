"""What a critically damped position servo makes of its reference, piece by piece, in closed form.

The reference is quadratic in time on every piece, with a swing on top where one is demanded. The answer of
w^2/(s + w)^2 to r is r - 2 r'/w + 3 r''/w^2 + (c1 + c2 t) exp(-w t) for the quadratic part, and that to
(A + B t) exp(s t) is (H (A + B t) + H' B) exp(s t), with H and its derivative H' at s. Angles in deg, times in s.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from drivers.base.arrays import Array

FADED = 40.0
"""Servo time constants after which a transient is 4e-18 of its start, and taken as zero."""


@dataclass(frozen=True)
class Swing:
    """(amplitude + growth t) sin(2 pi frequency t + phase) about the axis' rest, t from the swing's start."""

    amplitude_deg: float
    growth_dps: float
    frequency_hz: float
    phase_rad: float

    def reference(self, t: float) -> tuple[float, float]:
        """Return the swing's angle and rate before the servo."""
        s = 2j * math.pi * self.frequency_hz
        turn = cmath.exp(s * t + 1j * self.phase_rad)
        size = self.amplitude_deg + self.growth_dps * t
        return (size * turn).imag, ((self.growth_dps + s * size) * turn).imag

    def served(self, t: float, w: float) -> tuple[float, float, float]:
        """Return angle, rate and acceleration behind the servo, its transient left out."""
        s = 2j * math.pi * self.frequency_hz
        h, slope = self._gain(w)
        turn = cmath.exp(s * t + 1j * self.phase_rad)
        grown = h * self.growth_dps
        size = h * (self.amplitude_deg + self.growth_dps * t) + slope * self.growth_dps
        return (
            (size * turn).imag,
            ((grown + s * size) * turn).imag,
            ((2.0 * s * grown + s * s * size) * turn).imag,
        )

    def angles(self, t: Array, w: float) -> Array:
        """Return `served`'s angle for an array of times."""
        h, slope = self._gain(w)
        size = h * (self.amplitude_deg + self.growth_dps * t) + slope * self.growth_dps
        return np.asarray((size * np.exp(1j * (2.0 * math.pi * self.frequency_hz * t + self.phase_rad))).imag)

    def _gain(self, w: float) -> tuple[complex, complex]:
        s = 2j * math.pi * self.frequency_hz
        h = (w / (s + w)) ** 2
        return h, -2.0 * h / (s + w)


@dataclass(frozen=True)
class Piece:
    """From `start_s`: reference angle, rate, acceleration and swing, and the transient's two constants."""

    start_s: float
    angle: float
    rate: float
    acceleration: float
    c1: float = 0.0
    c2: float = 0.0
    swing: Swing | None = None

    def reference(self, t: float) -> tuple[float, float]:
        """Return reference angle and rate `t` after the start."""
        angle = self.angle + self.rate * t + 0.5 * self.acceleration * t * t
        rate = self.rate + self.acceleration * t
        if self.swing is None:
            return angle, rate
        by, at = self.swing.reference(t)
        return angle + by, rate + at

    def state(self, t: float, w: float) -> tuple[float, float, float]:
        """Return the servo's angle, rate and acceleration `t` after the start."""
        a = self.acceleration
        rate = self.rate + a * t
        angle = self.angle + self.rate * t + 0.5 * a * t * t - 2.0 * rate / w + 3.0 * a / (w * w)
        fade = math.exp(-w * t) if w * t < FADED else 0.0
        left = (self.c1 + self.c2 * t) * fade
        angle, rate = angle + left, rate - 2.0 * a / w + self.c2 * fade - w * left
        a += w * (w * left - 2.0 * self.c2 * fade)
        if self.swing is None:
            return angle, rate, a
        swung = self.swing.served(t, w)
        return angle + swung[0], rate + swung[1], a + swung[2]

    def angles(self, t: Array, w: float) -> Array:
        """Return the servo's angle for an array of times after the start."""
        a = self.acceleration
        offset = self.angle - 2.0 * self.rate / w + 3.0 * a / (w * w)
        angle = offset + (self.rate - 2.0 * a / w) * t
        if a:
            angle += 0.5 * a * t * t
        if (self.c1 or self.c2) and t[0] * w < FADED:
            angle += (self.c1 + self.c2 * t) * np.exp(-w * t) * (w * t < FADED)
        if self.swing is not None:
            angle += self.swing.angles(t, w)
        return np.asarray(angle)

    def rests(self, t: float, w: float) -> bool:
        """Return whether the axis stands still from `t` after the start to the end of the piece."""
        if self.rate or self.acceleration or self.swing:
            return False
        return not (self.c1 or self.c2) or t * w >= FADED

    def continuing(self, angle: float, rate: float, w: float) -> Piece:
        """Return the piece with the transient that continues from a servo angle and rate."""
        steady = Piece(self.start_s, self.angle, self.rate, self.acceleration, swing=self.swing)
        at = steady.state(0.0, w)
        c1 = angle - at[0]
        return Piece(
            self.start_s, self.angle, self.rate, self.acceleration, c1, rate - at[1] + w * c1, self.swing
        )
