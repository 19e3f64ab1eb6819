"""The sine of an ACUTROL3000's Synthesis mode: what was demanded, how it slews there, what limits it.

TM-8004-C 4.2.19 (Configure:Oscillator), 4.3.4 (Demand:Oscillator), 4.7.6 (Mode:Synthesis). The amplitude is one
of position, rate or acceleration, slews linearly and is kept while the frequency slews, linearly or by decades.
How an amplitude beyond the limits is limited is our reading: the sine stays one, with the largest amplitude that
rate, acceleration and stops allow.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from drivers.acutrol.grammar import PARAMETER_OUT_OF_RANGE, WRONG_PARAMETER_COUNT
from simulators.emulators._acutrol_arguments import Refused, numbers, one_of
from simulators.plant.table import Swing

_ENABLED = ("ENABLE", "DISABLE")
_STATES = ("POSITION", "RATE", "ACCELERATION")
_SWEEPS = ("LOGARITHMIC", "LINEAR")
_STEP = 0.01
"""The frequency slews in steps of so much of it, or of as many hertz below 1 Hz."""
_PARTS = 32
"""An amplitude that is limited on its way slews in so many parts."""
_LEAST_HZ = 0.001
"""The lowest frequency of a logarithmic sweep (4.2.19)."""
AT_AMPLITUDE, AT_FREQUENCY = 1 << 10, 1 << 11
_ACCELERATION_LIMITED, _RATE_LIMITED = 1 << 2 | 1 << 3, 1 << 4 | 1 << 5


@dataclass(frozen=True)
class Sine:
    """What is demanded, or is there now: amplitude in the unit of its state, frequency in Hz, phase in deg."""

    amplitude: float = 0.0
    frequency_hz: float = 0.0
    phase_deg: float = 0.0


@dataclass(frozen=True)
class Bounds:
    """What the amplitude of the position must stay within: deg/s, deg/s2, deg."""

    rate_dps: float
    acceleration_dps2: float
    room_deg: float = math.inf

    def amplitude_deg(self, frequency_hz: float) -> float:
        """Return the largest amplitude at a frequency."""
        w = 2.0 * math.pi * frequency_hz
        return min(self.room_deg, self.rate_dps / w, self.acceleration_dps2 / w**2) if w else self.room_deg


@dataclass(frozen=True)
class _Knot:
    """The sine from a moment on, and the amplitude of the position that it has within the bounds."""

    start_s: float
    sine: Sine
    position_deg: float


class Oscillator:
    """The oscillator of one axis; `swings` makes motion of it."""

    def __init__(self) -> None:
        self.demand = Sine()
        self._enabled, self._state, self._sweep = "DISABLE", "POSITION", "LINEAR"
        self._amplitude_slew, self._frequency_slew = 10.0, 0.1
        self._bounds = Bounds(math.inf, math.inf)
        self._knots: list[_Knot] = []

    @property
    def configuration(self) -> str:
        """The answer to Configure:Oscillator?."""
        slews = (f"{slew:.6f}" for slew in (self._amplitude_slew, self._frequency_slew))
        return ",".join(
            [self._enabled.capitalize(), *slews, self._state.capitalize(), self._sweep.capitalize()]
        )

    @property
    def enabled(self) -> bool:
        """Whether the sine is added to what other modes demand."""
        return self._enabled == "ENABLE"

    def configure(self, arguments: Sequence[str]) -> None:
        """Take enabled, amplitude slew, frequency slew, state of the amplitude and kind of sweep."""
        if len(arguments) != 5:
            raise Refused(WRONG_PARAMETER_COUNT)
        enabled, state, sweep = (
            one_of(choices, arguments[place])
            for choices, place in ((_ENABLED, 0), (_STATES, 3), (_SWEEPS, 4))
        )
        slews = numbers(arguments[1:3])
        if min(slews) <= 0.0:
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._enabled, self._state, self._sweep = enabled, state, sweep
        self._amplitude_slew, self._frequency_slew = slews

    def set(self, arguments: Sequence[str]) -> None:
        """Take amplitude, frequency and initial phase; a rate or acceleration at 0 Hz has no sine."""
        if len(arguments) != 3:
            raise Refused(WRONG_PARAMETER_COUNT)
        sine = Sine(*numbers(arguments))
        if sine.frequency_hz < 0.0 or (
            sine.frequency_hz == 0.0 and sine.amplitude and self._state != "POSITION"
        ):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self.demand = sine

    def reset(self) -> None:
        """Stand still: the next swing begins without amplitude, at the frequency and the phase demanded."""
        self._knots = []

    def swings(self, from_s: float, bounds: Bounds) -> list[tuple[float, Swing]]:
        """Return the swings from `from_s` on that slew to what is demanded, each with its duration in s.

        They go on from the position's amplitude that is there, whatever its bounds and its state were.
        """
        now, position_deg = self._at(from_s) if self._knots else (self.demand, 0.0)
        now = replace(now, amplitude=position_deg * self._per_deg(now))
        aim, self._bounds, self._knots = self.demand, bounds, []
        times = self._times(now, aim)
        phase = math.radians(now.phase_deg)
        swings = []
        sines = [self._between(now, aim, after_s) for after_s in times]
        amplitudes = [position_deg, *map(self._position_deg, sines[1:])]
        for (start, end), (first, last), (at, to) in zip(
            pairwise(times), pairwise(sines), pairwise(amplitudes), strict=True
        ):
            hertz = (first.frequency_hz + last.frequency_hz) / 2.0
            self._knots.append(_Knot(from_s + start, replace(first, phase_deg=math.degrees(phase)), at))
            swings.append((end - start, Swing(at, (to - at) / (end - start), hertz, phase)))
            phase += 2.0 * math.pi * hertz * (end - start)
        last_deg = self._position_deg(aim)
        self._knots.append(_Knot(from_s + times[-1], replace(aim, phase_deg=math.degrees(phase)), last_deg))
        swings.append((0.0, Swing(last_deg, 0.0, aim.frequency_hz, phase)))
        return swings

    def bits(self, now_s: float) -> int:
        """Return the bits of A<n>DYN: at amplitude, at frequency, rate or acceleration limited."""
        if not self._knots:
            return 0
        now, _ = self._at(now_s)
        bits = AT_AMPLITUDE * (now.amplitude == self.demand.amplitude)
        bits |= AT_FREQUENCY * (now.frequency_hz == self.demand.frequency_hz)
        w = 2.0 * math.pi * now.frequency_hz
        wanted = abs(self._wanted_deg(now))
        bits |= _RATE_LIMITED * (wanted * w > self._bounds.rate_dps)
        return bits | _ACCELERATION_LIMITED * (wanted * w * w > self._bounds.acceleration_dps2)

    def _times(self, now: Sine, aim: Sine) -> list[float]:
        """Return the seconds from now on between which amplitude and frequency are slewed in a straight line."""
        swept_s = self._sweep_s(now, aim)
        slewed_s = abs(aim.amplitude - now.amplitude) / self._amplitude_slew
        change = abs(aim.frequency_hz - now.frequency_hz)
        steps = math.ceil(change / (_STEP * max(1.0, now.frequency_hz, aim.frequency_hz)))
        parts = _PARTS if abs(self._wanted_deg(aim)) > self._bounds.amplitude_deg(aim.frequency_hz) else 1
        slewed = (slewed_s * part / parts for part in range(1, parts + 1))
        return sorted({0.0, *slewed, *(swept_s * step / steps for step in range(1, steps + 1))})

    def _sweep_s(self, now: Sine, aim: Sine) -> float:
        if self._sweep == "LINEAR":
            return abs(aim.frequency_hz - now.frequency_hz) / self._frequency_slew
        ends = [max(_LEAST_HZ, sine.frequency_hz) for sine in (now, aim)]
        return abs(math.log10(ends[1] / ends[0])) / self._frequency_slew

    def _between(self, now: Sine, aim: Sine, after_s: float) -> Sine:
        """Return amplitude and frequency `after_s` on the way from one sine to another."""
        along = self._amplitude_slew * after_s
        change = aim.amplitude - now.amplitude
        amplitude = aim.amplitude if along >= abs(change) else now.amplitude + math.copysign(along, change)
        swept_s = self._sweep_s(now, aim)
        if after_s >= swept_s:
            return Sine(amplitude, aim.frequency_hz)
        share = after_s / swept_s
        if self._sweep == "LINEAR":
            return Sine(amplitude, now.frequency_hz + share * (aim.frequency_hz - now.frequency_hz))
        low, high = (max(_LEAST_HZ, sine.frequency_hz) for sine in (now, aim))
        return Sine(amplitude, low * (high / low) ** share)

    def _at(self, now_s: float) -> tuple[Sine, float]:
        """Return the sine that is there at `now_s`, its phase that of now, and the position's amplitude."""
        number = max(0, bisect_right(self._knots, now_s, key=lambda knot: knot.start_s) - 1)
        knot = self._knots[number]
        after_s, sine = max(0.0, now_s - knot.start_s), knot.sine
        if number + 1 == len(self._knots):
            turned = 360.0 * sine.frequency_hz * after_s
            return replace(sine, phase_deg=sine.phase_deg + turned), knot.position_deg
        following = self._knots[number + 1]
        share = after_s / (following.start_s - knot.start_s)

        def between(before: float, after: float) -> float:
            return before + share * (after - before)

        there = Sine(
            between(sine.amplitude, following.sine.amplitude),
            between(sine.frequency_hz, following.sine.frequency_hz),
            between(sine.phase_deg, following.sine.phase_deg),
        )
        return there, between(knot.position_deg, following.position_deg)

    def _per_deg(self, sine: Sine) -> float:
        """Return the amplitude of its state of a sine of 1 deg at its frequency."""
        return float((2.0 * math.pi * sine.frequency_hz) ** _STATES.index(self._state))

    def _wanted_deg(self, sine: Sine) -> float:
        """Return the amplitude of the position that an amplitude of its state is."""
        per_deg = self._per_deg(sine)
        return sine.amplitude / per_deg if per_deg else 0.0

    def _position_deg(self, sine: Sine) -> float:
        wanted = self._wanted_deg(sine)
        return math.copysign(min(abs(wanted), self._bounds.amplitude_deg(sine.frequency_hz)), wanted)
