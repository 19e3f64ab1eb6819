"""What a table stands on: a floor or pier in the field, a ship, a vehicle with its engine on. It moves and turns.

Velocity and attitude in level axes east, north, up are functions of time alone, so that samples do not depend on
how they are asked for. Wind and waves: many sines about one frequency, narrow-band noise. A step: the floor is
pushed, tips, and rings down. The sun: a tilt that comes and goes in a day. An engine: one line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD
from simulators.config import Ground
from simulators.plant.gimbals import rotations
from simulators.plant.noise import NoiseSource

_SINES = 32
_QUALITY = 20.0
"""Width of the sway is its frequency over this; a push rings down in as many radians."""
_MINUTE_S, _DAY_S = 60.0, 86_400.0


class MovingGround:
    """A ground that moves by its parameters; `source` fixes phases, and when and whither people step."""

    def __init__(self, parameters: Ground, source: NoiseSource) -> None:
        self.parameters = parameters
        self._source = source.substream(source.stream + 1)
        self._sway = _Sines(parameters.sway_hz, 2, source.generator(0))
        turning = source.substream(source.stream + 2).generator(0)
        self._rock = _Sines(parameters.rock_hz, 3, turning)
        self._sun_phase = turning.uniform(0.0, 2.0 * math.pi, 2)
        self._engine_phase = turning.uniform(0.0, 2.0 * math.pi, 3)
        self._pushes: dict[int, Array] = {}

    def velocity_mps(self, time_s: Array) -> Array:
        """Return the velocity east, north and up at times (n,), m/s, (n, 3)."""
        p = self.parameters
        found = np.zeros((len(time_s), 3))
        if p.sway_mps:
            found[:, :2] += p.sway_mps * self._sway.at(time_s)
        if p.step_mps:
            for heading, rings, course in self._rings(time_s):
                found[rings, 0] += p.step_mps * math.sin(heading) * course
                found[rings, 1] += p.step_mps * math.cos(heading) * course
                found[rings, 2] -= 0.5 * p.step_mps * course
        return found

    def turned_rad(self, time_s: Array) -> Array:
        """Return the rotation vector from a level ground about east, north and up, at times (n,), rad, (n, 3)."""
        p = self.parameters
        found = np.zeros((len(time_s), 3))
        if any(p.rock_arcsec):
            found += np.array(p.rock_arcsec) * self._rock.at(time_s)
        if p.sun_arcsec:
            day = 2.0 * math.pi / _DAY_S * time_s[:, None] + self._sun_phase
            found[:, :2] += p.sun_arcsec * (np.sin(day) - np.sin(self._sun_phase))  # level at first
        if p.engine_arcsec:
            angle = 2.0 * math.pi * p.engine_hz * time_s[:, None] + self._engine_phase
            found += p.engine_arcsec * np.sin(angle)
        if p.step_arcsec:
            for heading, rings, course in self._rings(time_s):
                # towards where it is pushed: about the level axis to the right of that, which is 90 deg on
                found[rings, 0] -= p.step_arcsec * math.cos(heading) * course
                found[rings, 1] += p.step_arcsec * math.sin(heading) * course
        return np.asarray(found * ARCSEC_RAD)

    def attitude(self, time_s: Array) -> Array:
        """Return C at times (n,), axes of the ground to east, north, up, (n, 3, 3)."""
        return rotations(self.turned_rad(time_s))

    def _rings(self, time_s: Array) -> Iterator[tuple[float, NDArray[np.bool_], Array]]:
        """Yield of each step (heading rad, at which times it rings, what of its push there is then)."""
        p = self.parameters
        if not p.steps_per_min or not len(time_s):
            return
        ring_s = _QUALITY / (2.0 * math.pi * p.step_hz)
        first, last = int((time_s[0] - 10.0 * ring_s) // _MINUTE_S), int(time_s[-1] // _MINUTE_S)
        for minute in range(first, last + 1):
            for at_s, heading in self._steps(minute).tolist():
                since = time_s - at_s
                rings = (since > 0.0) & (since < 10.0 * ring_s)
                course = np.exp(-since[rings] / ring_s) * np.sin(2.0 * math.pi * p.step_hz * since[rings])
                yield heading, rings, course

    def _steps(self, minute: int) -> Array:
        """Return (time s, heading rad) of the steps in a minute, (k, 2)."""
        if minute < 0:
            return np.zeros((0, 2))
        if minute not in self._pushes:
            rng = self._source.generator(minute)
            count = rng.poisson(self.parameters.steps_per_min)
            at_s = _MINUTE_S * (minute + rng.uniform(0.0, 1.0, count))
            self._pushes[minute] = np.column_stack([at_s, rng.uniform(0.0, 2.0 * math.pi, count)])
        return self._pushes[minute]


class _Sines:
    """Narrow-band noise about a frequency on so many axes, of rms 1 each."""

    def __init__(self, about_hz: float, axes: int, rng: np.random.Generator) -> None:
        spread = about_hz / (2.0 * _QUALITY)
        self._rad_s = 2.0 * math.pi * (about_hz + spread * rng.standard_normal((_SINES, axes)))
        self._phase = rng.uniform(0.0, 2.0 * math.pi, (_SINES, axes))

    def at(self, time_s: Array) -> Array:
        """Return it at times (n,), (n, axes)."""
        total = np.zeros((len(time_s), self._phase.shape[1]))
        for rad_s, phase in zip(self._rad_s, self._phase, strict=True):
            total += np.cos(time_s[:, None] * rad_s + phase)
        return total * math.sqrt(2.0 / _SINES)
