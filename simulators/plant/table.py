"""One servoed table axis, in closed form: trapezoidal rate profile, then a critically damped position servo.

The reference angle is piecewise quadratic in time, with a swing on top where one is demanded, so the servo's
answer is known exactly on every piece (`_servo`). Nothing is integrated, and a table at a steady rate costs
nothing. Angles are in deg, counter-clockwise positive about up, and count turns; time in s.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from drivers.base.arrays import Array
from simulators.config import Rotation
from simulators.plant._servo import Piece, Swing
from simulators.plant.noise import NoiseSource

__all__ = ["Swing", "TableAxis", "TableParameters"]

_RAD = math.pi / 180.0
_SETTLED = 20.0
"""Servo time constants after which its transient is below 1e-7 of its start."""
_TICKS_PER_S = 1000
_READINGS = 4096
_QUIET = NoiseSource(0, "encoder")
_Phases = list[tuple[float, float]]
"""Acceleration and how long it lasts."""


class TableParameters(Rotation):
    """A precision single-axis table; limits after the BD125 data sheet (1000 deg/s, 4200 deg/s2, 1 arcsec).

    The encoder's error is its peak over a turn, of an eccentric disc.
    """

    max_rate_dps: float = 1000.0
    max_acceleration_dps2: float = 200.0
    coast_deceleration_dps2: float = 20.0
    servo_bandwidth_hz: float = 5.0
    encoder_error_arcsec: float = 0.5


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
        self._pieces = [Piece(0.0, 0.0, 0.0, 0.0)]
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
        phases, angle = self._way(now_s, beyond, rate_limit_dps, a)
        self._plan(now_s, phases, 0.0, angle)

    def _way(self, now_s: float, beyond: float, rate_limit_dps: float, a: float) -> tuple[_Phases, float]:
        """Return the phases of `_travel` and the angle where they end."""
        angle, rate = self._reference(now_s)
        stop = rate * abs(rate) / (2.0 * a)
        distance = stop + beyond
        sign = math.copysign(1.0, beyond)
        top = max(min(self.max_rate_dps, rate_limit_dps), sign * rate)
        peak = sign * min(top, math.sqrt(max(0.0, a * sign * distance + rate * rate / 2.0)))
        first, last = (peak - rate) / (sign * a), abs(peak) / a
        covered = (peak * peak - rate * rate) / (2.0 * sign * a) + sign * peak * peak / (2.0 * a)
        cruise = max(0.0, (distance - covered) / peak) if peak else 0.0
        return [(sign * a, first), (0.0, cruise), (-sign * a, last)], angle + distance

    def demand_states(
        self,
        now_s: float,
        states: tuple[float, float, float],
        hold_s: float,
        rate_limit_dps: float = math.inf,
        acceleration_limit_dps2: float = math.inf,
        *,
        shortest: bool = True,
    ) -> None:
        """Follow an angle, its rate and its acceleration for `hold_s`, then brake to rest.

        `shortest`: the angle is the nearest of its kind modulo 360. If it is further away than the servo can
        catch up within the rate limit, the axis travels towards it instead.
        """
        if not self._on:
            return
        a = min(self.max_acceleration_dps2, acceleration_limit_dps2)
        top = min(self.max_rate_dps, rate_limit_dps)
        angle, rate = self._reference(now_s)
        gap = math.remainder(states[0] - angle, 360.0) if shortest else states[0] - angle
        if abs(gap) * self._w <= top:
            _, rate, along = states
            phases = [(along, hold_s)]
            start = (angle + gap, rate)
        else:
            stop = rate * abs(rate) / (2.0 * a)
            phases, _ = self._way(now_s, gap - stop, top, a)
            start = (angle, rate)
        phases, rate = _cut(phases, rate, hold_s, top)
        if math.isinf(hold_s):
            self._plan(now_s, phases, rate, start=start)
        else:
            self._plan(now_s, [*phases, (-math.copysign(a, rate), abs(rate) / a)], start=start)

    def rest(self, now_s: float) -> tuple[float, float]:
        """Return when a swing that is demanded now begins, and the angle it is about, turns counted.

        That is at once in a swing, else where the profile ends.
        """
        centre = self._pieces[-1].angle
        number = bisect_right(self._starts, now_s) - 1
        if self._pieces[number].swing is not None:
            return now_s, centre
        ahead = (piece.start_s for piece in self._pieces[number + 1 :] if piece.swing is not None)
        return next(ahead, max(now_s, self._starts[-1])), centre

    def demand_swing(self, now_s: float, swings: Sequence[tuple[float, Swing]]) -> None:
        """Swing about where the profile ends, as `rest` tells: each for its duration in s, the last for good.

        An axis that would turn on is to be brought to rest first; an axis that is not servoed ignores it.
        """
        if not self._on:
            return
        start, centre = self.rest(now_s)
        piece, t = self._piece_at(start)
        state = piece.state(t, self._w)[:2]
        keep = bisect_right(self._starts, start)
        del self._pieces[keep:], self._starts[keep:]
        for duration, swing in swings:
            state = self._append(Piece(start, centre, 0.0, 0.0, swing=swing), state, duration)
            start += duration

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
        angle, rate, _ = piece.state(t, self._w)
        p = self.parameters
        ripple = p.ripple_once_ppm * math.cos(math.radians(angle))
        ripple += p.ripple_twice_ppm * math.cos(math.radians(2.0 * angle))
        return rate * (1.0 + ripple * 1e-6)

    def acceleration_dps2(self, now_s: float) -> float:
        """Return the servo's acceleration, without the ripple."""
        piece, t = self._piece_at(now_s)
        return piece.state(t, self._w)[2]

    def settled(self, now_s: float) -> bool:
        """Return whether the profile has ended and the servo's transient has died out."""
        return now_s >= self._starts[-1] + _SETTLED / self._w

    def total_angle_deg(self, now_s: float) -> float:
        """Return the axis angle, turns counted."""
        piece, t = self._piece_at(now_s)
        angle = piece.state(t, self._w)[0]
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
            still = piece.rests(times_s[0] - piece.start_s, self._w)
            angle = piece.angles((times_s[:2] if still else times_s) - piece.start_s, self._w)
        else:
            cuts = np.searchsorted(times_s, self._starts[first + 1 : last + 1])
            parts = np.split(times_s, cuts)
            pieces = self._pieces[first : last + 1]
            angle = np.concatenate(
                [
                    piece.angles(part - piece.start_s, self._w)
                    for piece, part in zip(pieces, parts, strict=True)
                    if len(part)
                ]
            )
        if not (self._ripple_once_deg or self._ripple_twice_deg):
            return np.asarray(angle)
        turn = angle * _RAD
        sin = np.sin(turn)
        return np.asarray(angle + sin * (self._ripple_once_deg + 2.0 * self._ripple_twice_deg * np.cos(turn)))

    def _piece_at(self, now_s: float) -> tuple[Piece, float]:
        piece = self._pieces[bisect_right(self._starts, now_s) - 1]
        return piece, now_s - piece.start_s

    def _reference(self, now_s: float) -> tuple[float, float]:
        piece, t = self._piece_at(now_s)
        return piece.reference(t)

    def _plan(
        self,
        now_s: float,
        phases: _Phases,
        final_rate: float = 0.0,
        final_angle: float | None = None,
        start: tuple[float, float] | None = None,
    ) -> None:
        """Replace the profile from `now_s` on by (acceleration, duration) phases and a steady end.

        The end takes `final_rate` and `final_angle` themselves, so that rounding leaves no creep. The reference
        goes on from where it is, or jumps to the angle and rate of `start`.
        """
        piece, t = self._piece_at(now_s)
        angle, rate = piece.reference(t) if start is None else start
        state = piece.state(t, self._w)[:2]
        keep = bisect_right(self._starts, now_s)
        del self._pieces[keep:], self._starts[keep:]
        begin = now_s
        for acceleration, duration in phases:
            if duration <= 0.0:
                continue
            state = self._append(Piece(begin, angle, rate, acceleration), state, duration)
            angle += rate * duration + 0.5 * acceleration * duration * duration
            rate += acceleration * duration
            begin += duration
        end = Piece(begin, angle if final_angle is None else final_angle, final_rate, 0.0)
        self._append(end, state, 0.0)

    def _append(self, piece: Piece, state: tuple[float, float], duration_s: float) -> tuple[float, float]:
        """Add a piece that continues from a servo state; return the servo state at its end."""
        piece = piece.continuing(*state, self._w)
        self._pieces.append(piece)
        self._starts.append(piece.start_s)
        return piece.state(duration_s, self._w)[:2]


def _cut(phases: _Phases, rate: float, hold_s: float, top: float) -> tuple[_Phases, float]:
    """Return the phases up to `hold_s`, none beyond the rate `top`, and the rate they end with.

    What would last for good at a steady rate is left out: a profile ends so.
    """
    kept: _Phases = []
    for acceleration, duration in phases:
        lasting = min(duration, hold_s)
        hold_s -= 0.0 if math.isinf(hold_s) else lasting
        if acceleration:
            steep = max(0.0, min(lasting, (math.copysign(top, acceleration) - rate) / acceleration))
            kept.append((acceleration, steep))
            rate += acceleration * steep
            lasting -= steep
        kept.append((0.0, lasting))
    return [phase for phase in kept if math.isfinite(phase[1])], rate
