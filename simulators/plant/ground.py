"""A floor or pier in the field: it sways in the wind, and people walk past.

Its velocity in level axes east, north, up is a function of time alone, so that samples do not depend on how
they are asked for. Wind: many sines about the pier's own frequency, narrow-band noise. A step: the pier is
pushed and rings down. It does not rock: what a pier turns by is not in here.
"""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from simulators.config import Ground
from simulators.plant.noise import NoiseSource

_SINES = 32
_QUALITY = 20.0
"""Width of the sway is its frequency over this; a push rings down in as many radians."""
_MINUTE_S = 60.0


class MovingGround:
    """A ground that moves by its parameters; `source` fixes phases, and when and whither people step."""

    def __init__(self, parameters: Ground, source: NoiseSource) -> None:
        self.parameters = parameters
        self._source = source.substream(source.stream + 1)
        rng = source.generator(0)
        spread = parameters.sway_hz / (2.0 * _QUALITY)
        self._rad_s = 2.0 * math.pi * (parameters.sway_hz + spread * rng.standard_normal((_SINES, 2)))
        self._phase = rng.uniform(0.0, 2.0 * math.pi, (_SINES, 2))
        self._pushes: dict[int, Array] = {}

    def velocity_mps(self, time_s: Array) -> Array:
        """Return the velocity east, north and up at times (n,), m/s, (n, 3)."""
        p = self.parameters
        found = np.zeros((len(time_s), 3))
        if p.sway_mps:
            angle = time_s[:, None, None] * self._rad_s + self._phase
            found[:, :2] += p.sway_mps * math.sqrt(2.0 / _SINES) * np.cos(angle).sum(axis=1)
        if p.step_mps and p.steps_per_min and len(time_s):
            ring_s = _QUALITY / (2.0 * math.pi * p.step_hz)
            for minute in range(
                int((time_s[0] - 10.0 * ring_s) // _MINUTE_S), int(time_s[-1] // _MINUTE_S) + 1
            ):
                for at_s, heading in self._steps(minute):
                    since = time_s - at_s
                    rings = (since > 0.0) & (since < 10.0 * ring_s)
                    course = np.exp(-since[rings] / ring_s) * np.sin(2.0 * math.pi * p.step_hz * since[rings])
                    found[rings, 0] += p.step_mps * math.sin(heading) * course
                    found[rings, 1] += p.step_mps * math.cos(heading) * course
                    found[rings, 2] -= 0.5 * p.step_mps * course
        return found

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
