"""The platform INS of a lab: the space-stable plant on the lab's own table, sampled at any times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.base.arrays import Array
from simulators.plant.space_stable import Navigation, PlatformParameters, SpaceStablePlatform


@dataclass(frozen=True, eq=False)
class PlatformSignal:
    """What the unit computed and measured at sample times, shape (n,) each; NaN temperature: sensor dead.

    `force_mps2` (n, 3): specific force by its accelerometers, in the platform's axes.
    """

    latitude_deg: Array
    longitude_deg: Array
    temp_c: Array
    cabinet_temp_c: Array
    force_mps2: Array


class LabPlatform:
    """A platform at a place.

    `heading_deg(time_s)` is the table's angle, asked for with times that never decrease. The plant moves in
    steps of `step_s` from lab time 0; between steps its outputs are linear.
    """

    def __init__(
        self,
        parameters: PlatformParameters,
        seed: int,
        heading_deg: Callable[[float], float],
        *,
        longitude_deg: float = 0.0,
        step_s: float = 60.0,
        navigation: Navigation = "nonlinear",
    ) -> None:
        self._heading_deg, self._longitude_deg, self._step_s = heading_deg, longitude_deg, step_s
        self._latitude_deg = parameters.latitude_deg
        self._plant = SpaceStablePlatform(
            parameters, seed, step_s, angle_rad=math.radians(longitude_deg), navigation=navigation
        )
        self._rows = np.empty((0, 8))
        self._steps = 0

    def align(self, now_s: float) -> None:
        """End the alignment at the plant's next step."""
        self._advance(now_s)
        self._plant.align()

    def measure(self, times_s: Array) -> PlatformSignal:
        """Return position, temperatures and specific force at `times_s`, shape (n,)."""
        self._advance(float(times_s[-1]))
        time_s, north, east, temp, cabinet, *force = (
            np.interp(times_s, self._rows[:, 0], self._rows[:, column]) for column in range(8)
        )
        self._rows = self._rows[self._rows[:, 0] >= time_s[-1] - 2.0 * self._step_s]
        level = math.cos(math.radians(self._latitude_deg))
        return PlatformSignal(
            latitude_deg=self._latitude_deg + north / 3600.0,
            longitude_deg=self._longitude_deg + east / 3600.0 / level,
            temp_c=temp,
            cabinet_temp_c=cabinet,
            force_mps2=np.stack(force, axis=1),
        )

    def _advance(self, to_s: float) -> None:
        last = math.ceil(to_s / self._step_s)
        times = [step * self._step_s for step in range(self._steps, last + 1)]
        if not times:
            return
        self._steps = last + 1
        moved = self._plant.advance(np.array([self._heading_deg(min(time_s, to_s)) for time_s in times]))
        scalars = (moved.time_s, moved.north_as, moved.east_as, moved.temp_c, moved.ambient_c)
        self._rows = np.concatenate([self._rows, np.column_stack([*scalars, moved.force_mps2])])
