"""One servoed table axis, in closed form: trapezoidal rate profile, then a critically damped position servo.

The reference angle is piecewise quadratic in time, so the servo's answer w^2/(s + w)^2 is known exactly on every
piece: r - 2 r'/w + 3 r''/w^2 + (c1 + c2 t) exp(-w t). Nothing is integrated, and a table at a steady rate
costs nothing. Angles are in deg, counter-clockwise positive about up, and count turns; time in s.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from drivers.base.arrays import Array
from simulators.config import Rotation
from simulators.plant.noise import NoiseSource

_RAD = math.pi / 180.0
_SETTLED = 20.0
_FADED = 40.0
"""Servo time constants after which its transient is below 1e-7 of its start, and taken as zero (4e-18)."""
_TICKS_PER_S = 1000
_READINGS = 4096
_QUIET = NoiseSource(0, "encoder")


class TableParameters(Rotation):
    """A precision single-axis table; limits after the BD125 data sheet (1000 deg/s, 4200 deg/s2, 1 arcsec).

    The encoder's error is its peak over a turn, of an eccentric disc.
    """

    max_rate_dps: float = 1000.0
    max_acceleration_dps2: float = 200.0
    coast_deceleration_dps2: float = 20.0
    servo_bandwidth_hz: float = 5.0
    encoder_error_arcsec: float = 0.5


@dataclass(frozen=True)
class _Piece:
    """From `start_s`: reference angle, rate, acceleration, and the transient's two constants."""

    start_s: float
    angle: float
    rate: float
    acceleration: float
    c1: float
    c2: float


class TableAxis:
    """A servoed table axis; at rest at 0 deg with its servo open at 0 s.

    `source` draws the encoder's noise, which depends on seed and time only.
    """

    def __init__(self, parameters: TableParameters, source: NoiseSource = _QUIET) -> None:
        self.parameters = parameters
        self.max_rate_dps = parameters.max_rate_dps
        self.max_acceleration_dps2 = parameters.max_acceleration_dps2
        self._w = 2.0 * math.pi * parameters.servo_bandwidth_hz
        self._on = False
        self._pieces = [_Piece(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)]
        self._starts = [0.0]
        self._ripple_once_deg = math.degrees(parameters.ripple_once_ppm * 1e-6)
        self._ripple_twice_deg = math.degrees(parameters.ripple_twice_ppm * 1e-6) / 2.0
        self._noise: list[float] = source.generator(0).standard_normal(_READINGS).tolist()

    def servo(self, now_s: float, on: bool) -> None:
        """Close or open the servo; opened, the axis coasts to rest and ignores demands."""
        if on == self._on:
            return
        self._on = on
        _, rate = self._reference(now_s)
        deceleration = self.parameters.coast_deceleration_dps2
        self._plan(now_s, [(-math.copysign(deceleration, rate), abs(rate) / deceleration)])

    def demand_rate(self, now_s: float, rate_dps: float, acceleration_limit_dps2: float = math.inf) -> None:
        """Go to `rate_dps` (clipped to the rate limit) at the lower of the two acceleration limits."""
        if not self._on:
            return
        _, rate = self._reference(now_s)
        change = max(-self.max_rate_dps, min(self.max_rate_dps, rate_dps)) - rate
        acceleration = min(self.max_acceleration_dps2, acceleration_limit_dps2)
        self._plan(now_s, [(math.copysign(acceleration, change), abs(change) / acceleration)], rate + change)

    def demand_angle(
        self,
        now_s: float,
        angle_deg: float,
        rate_limit_dps: float = math.inf,
        acceleration_limit_dps2: float = math.inf,
    ) -> None:
        """Go to `angle_deg` by the shortest path from where the axis would stop, time-optimally.

        The limits come on top of the axis' own; an axis that turns faster keeps its rate as it can.
        """
        a = min(self.max_acceleration_dps2, acceleration_limit_dps2)
        angle, rate = self._reference(now_s)
        stop = rate * abs(rate) / (2.0 * a)
        self._travel(now_s, math.remainder(angle_deg - (angle + stop), 360.0), rate_limit_dps, a)

    def demand_turn(
        self,
        now_s: float,
        by_deg: float,
        rate_limit_dps: float = math.inf,
        acceleration_limit_dps2: float = math.inf,
    ) -> None:
        """Turn by `by_deg` from where the axis would stop, time-optimally, in the sense of its sign."""
        a = min(self.max_acceleration_dps2, acceleration_limit_dps2)
        self._travel(now_s, by_deg, rate_limit_dps, a)

    def _travel(self, now_s: float, beyond: float, rate_limit_dps: float, a: float) -> None:
        """Come to rest `beyond` degrees past where the axis would stop at acceleration `a`."""
        if not self._on:
            return
        angle, rate = self._reference(now_s)
        stop = rate * abs(rate) / (2.0 * a)
        distance = stop + beyond
        sign = math.copysign(1.0, beyond)
        top = max(min(self.max_rate_dps, rate_limit_dps), sign * rate)
        peak = sign * min(top, math.sqrt(max(0.0, a * sign * distance + rate * rate / 2.0)))
        first, last = (peak - rate) / (sign * a), abs(peak) / a
        covered = (peak * peak - rate * rate) / (2.0 * sign * a) + sign * peak * peak / (2.0 * a)
        cruise = max(0.0, (distance - covered) / peak) if peak else 0.0
        self._plan(now_s, [(sign * a, first), (0.0, cruise), (-sign * a, last)], 0.0, angle + distance)

    def angle_deg(self, now_s: float) -> float:
        """Return the encoder's angle in [0, 360): the axis angle and the encoder's errors."""
        p, angle = self.parameters, self.total_angle_deg(now_s)
        eccentric = p.encoder_error_arcsec / 3600.0 * math.sin(math.radians(angle))
        # readings come at any time, one by one: a table addressed by a hash of the time (Knuth's multiplier)
        address = (round(now_s * _TICKS_PER_S) * 2654435761 & 0xFFFFFFFF) * _READINGS >> 32
        error = p.encoder_noise_arcsec * self._noise[address]
        error += p.encoder_ripple_arcsec * math.sin(p.encoder_ripple_lines * math.radians(angle))
        return ((angle + eccentric) % 360.0 + error / 3600.0) % 360.0

    def rate_dps(self, now_s: float) -> float:
        """Return the axis rate."""
        piece, t = self._piece_at(now_s)
        angle, rate = self._servo_state(piece, t)
        p = self.parameters
        ripple = p.ripple_once_ppm * math.cos(math.radians(angle))
        ripple += p.ripple_twice_ppm * math.cos(math.radians(2.0 * angle))
        return rate * (1.0 + ripple * 1e-6)

    def acceleration_dps2(self, now_s: float) -> float:
        """Return the servo's acceleration, without the ripple."""
        piece, t = self._piece_at(now_s)
        w = self._w
        fade = math.exp(-w * t) if w * t < _FADED else 0.0
        return piece.acceleration + w * fade * (w * (piece.c1 + piece.c2 * t) - 2.0 * piece.c2)

    def settled(self, now_s: float) -> bool:
        """Return whether the profile has ended and the servo's transient has died out."""
        return now_s >= self._starts[-1] + _SETTLED / self._w

    def total_angle_deg(self, now_s: float) -> float:
        """Return the axis angle, turns counted."""
        piece, t = self._piece_at(now_s)
        angle, _ = self._servo_state(piece, t)
        once, twice = math.sin(math.radians(angle)), math.sin(math.radians(2.0 * angle))
        return angle + self._ripple_once_deg * once + self._ripple_twice_deg * twice

    def total_angles_deg(self, times_s: Array) -> Array:
        """Return the axis angle at ascending times, turns counted; float64 (n,) -> (n,).

        If the axis stands still from the first time to the last, the result is (2,), the angle twice.
        """
        first = bisect_right(self._starts, float(times_s[0])) - 1
        last = bisect_right(self._starts, float(times_s[-1])) - 1
        if first == last:
            piece = self._pieces[first]
            angle = self._servo_angles(piece, times_s[:2] if self._rests(piece, times_s[0]) else times_s)
        else:
            cuts = np.searchsorted(times_s, self._starts[first + 1 : last + 1])
            parts = np.split(times_s, cuts)
            angle = np.concatenate(
                [
                    self._servo_angles(self._pieces[first + k], part)
                    for k, part in enumerate(parts)
                    if len(part)
                ]
            )
        if not (self._ripple_once_deg or self._ripple_twice_deg):
            return np.asarray(angle)
        turn = angle * _RAD
        sin = np.sin(turn)
        return np.asarray(angle + sin * (self._ripple_once_deg + 2.0 * self._ripple_twice_deg * np.cos(turn)))

    def _rests(self, piece: _Piece, time_s: float) -> bool:
        """Return whether the axis stands still from `time_s` to the end of its piece."""
        if piece.rate or piece.acceleration:
            return False
        return not (piece.c1 or piece.c2) or (time_s - piece.start_s) * self._w >= _FADED

    def _piece_at(self, now_s: float) -> tuple[_Piece, float]:
        piece = self._pieces[bisect_right(self._starts, now_s) - 1]
        return piece, now_s - piece.start_s

    def _reference(self, now_s: float) -> tuple[float, float]:
        piece, t = self._piece_at(now_s)
        rate = piece.rate + piece.acceleration * t
        return piece.angle + piece.rate * t + 0.5 * piece.acceleration * t * t, rate

    def _servo_state(self, piece: _Piece, t: float) -> tuple[float, float]:
        """Return servo angle and rate `t` after the start of a piece."""
        w, a = self._w, piece.acceleration
        rate = piece.rate + a * t
        angle = piece.angle + piece.rate * t + 0.5 * a * t * t - 2.0 * rate / w + 3.0 * a / (w * w)
        fade = math.exp(-w * t) if w * t < _FADED else 0.0
        transient = (piece.c1 + piece.c2 * t) * fade
        return angle + transient, rate - 2.0 * a / w + piece.c2 * fade - w * transient

    def _servo_angles(self, piece: _Piece, times_s: Array) -> Array:
        """Return `_servo_state`'s angle for an array of times."""
        w, a = self._w, piece.acceleration
        t = times_s - piece.start_s
        offset = piece.angle - 2.0 * piece.rate / w + 3.0 * a / (w * w)
        angle = offset + (piece.rate - 2.0 * a / w) * t
        if a:
            angle += 0.5 * a * t * t
        if (piece.c1 or piece.c2) and t[0] * w < _FADED:
            angle += (piece.c1 + piece.c2 * t) * np.exp(-w * t) * (w * t < _FADED)
        return np.asarray(angle)

    def _plan(
        self,
        now_s: float,
        phases: list[tuple[float, float]],
        final_rate: float = 0.0,
        final_angle: float | None = None,
    ) -> None:
        """Replace the profile from `now_s` on by (acceleration, duration) phases and a steady end.

        The end takes `final_rate` and `final_angle` themselves, so that rounding leaves no creep.
        """
        piece, t = self._piece_at(now_s)
        angle, rate = self._reference(now_s)
        state = self._servo_state(piece, t)
        keep = bisect_right(self._starts, now_s)
        del self._pieces[keep:], self._starts[keep:]
        start = now_s
        for acceleration, duration in phases:
            if duration <= 0.0:
                continue
            state = self._append(start, angle, rate, acceleration, state, duration)
            angle += rate * duration + 0.5 * acceleration * duration * duration
            rate += acceleration * duration
            start += duration
        self._append(start, angle if final_angle is None else final_angle, final_rate, 0.0, state, 0.0)

    def _append(
        self,
        start_s: float,
        angle: float,
        rate: float,
        acceleration: float,
        state: tuple[float, float],
        duration_s: float,
    ) -> tuple[float, float]:
        """Add a piece that continues from a servo state; return the servo state at its end."""
        w = self._w
        c1 = state[0] - (angle - 2.0 * rate / w + 3.0 * acceleration / (w * w))
        c2 = state[1] - (rate - 2.0 * acceleration / w) + w * c1
        piece = _Piece(start_s, angle, rate, acceleration, c1, c2)
        self._pieces.append(piece)
        self._starts.append(start_s)
        return self._servo_state(piece, duration_s)
