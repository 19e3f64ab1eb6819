"""One gyro unit at work: its thermal state and errors tick by tick, and the samples its electronics measure.

The record keeps, per tick of 1 s, bias, flicker and scale-factor error of each axis, the two temperature readings
and the model's truth columns: 8 float64 for a fibre-optic gyro, 12 for a three-axis unit, i.e. below
1.6 MB for the 16,000 s of a cold shock.
"""

from __future__ import annotations

import math
from collections import deque, namedtuple
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import gravity_mps2
from drivers.base.errors import ConfigurationError
from drivers.kit.config import Mounting
from simulators.effects import SamplePath
from simulators.interfaces import GyroSignal
from simulators.plant.gimbals import NORTH_WEST_UP, Gimbals, about_up, earth_rate_rad_s, simpson
from simulators.plant.gimbals import turned_rad as turned_between
from simulators.plant.ground import MovingGround
from simulators.plant.model import UnitModel
from simulators.plant.mounting import Mount, turned_rad
from simulators.plant.noise import BLOCK, GyroNoise, NoiseSource, flicker
from simulators.plant.table import TableAxis

_FLICKER, _SAMPLES, _SENSORS, _TURN_ON = 0, 100, 200, 300
"""Noise streams of a unit; an axis adds its number (samples: two an axis)."""
_READINGS = ("sensor_temp_c", "case_temp_c")
_Channel = tuple[tuple[Callable[[Any], float], ...], float]


class SampleTimes:
    """When the samples of a unit begin.

    A measurement whose start is where the last one ended continues its sample count, so that any chunking of a
    stream gives the same bits; after a gap the count restarts at `start_s / period_s`.
    """

    def __init__(self) -> None:
        self._anchor_s, self._period_s = 0.0, 0.0
        self._anchor_index = self._next_index = 0

    def take(self, start_s: float, count: int, period_s: float) -> int:
        """Return the index of the first of `count` samples from `start_s` on."""
        expected = self._anchor_s + period_s * (self._next_index - self._anchor_index)
        if period_s != self._period_s or abs(start_s - expected) > 0.25 * period_s:
            self._anchor_s, self._period_s = start_s, period_s
            self._anchor_index = self._next_index = round(start_s / period_s)
        self._next_index += count
        return self._next_index - count

    def time_s(self, index: Array | NDArray[np.int64]) -> Array:
        """Return the times at which samples of these indices begin, (n,); halves are the middles."""
        return np.asarray(self._anchor_s + self._period_s * (index - self._anchor_index))


def check_advanced(where: str, end_s: float, ticks: int) -> None:
    """Raise ConfigurationError for samples up to a time that a plant of so many ticks has not reached."""
    if end_s > ticks - 1 + 1e-9:
        raise ConfigurationError(
            "samples were asked for that the plant has not reached",
            where=where,
            found=f"samples up to {end_s:.6f} s, plant at {ticks - 1} s",
            expected="the plant advanced past the last sample's end",
        )


class GyroUnit:
    """A unit (see `simulators.interfaces.GyroPlant`), switched on at 0 s at the room's temperature.

    `table`: the axis that carries it; `gimbals`: all of them, unless that is the only one, and up. Mountings are
    told with all axes at 0. Its accelerometers, and the gyros that the model lacks, are without errors. `ground`:
    what turns below the table, None for a floor at rest.
    """

    def __init__(
        self,
        model: UnitModel,
        mount: Mount,
        table: TableAxis,
        latitude_deg: float,
        source: NoiseSource,
        *,
        gimbals: Gimbals | None = None,
        ground: MovingGround | None = None,
    ) -> None:
        self.model = model
        self.axes = mount.axis if len(model.axes) == 1 else model.axes
        self._own = ["xyz".index(axis) for axis in self.axes]
        self._table, self._gimbals = table, gimbals
        self._ground = ground if ground is not None and ground.parameters.rocks else None
        self._latitude_deg = latitude_deg
        self._mounts = [(0.0, mount, mount.axes_in_table())]
        self._flicker = [
            flicker(source.substream(_FLICKER + index), axis.noise.bias_instability_dph)
            for index, axis in enumerate(model.axis_models)
        ]
        self._noise = [
            GyroNoise(source.substream(_SAMPLES + 2 * index), axis.noise)
            for index, axis in enumerate(model.axis_models)
        ]
        self._turn_on = source.substream(_TURN_ON)
        self._bias, self._scale = _terms(model, self._turn_on, 0)
        self._power_ons = 0
        self._switches: deque[tuple[int, UnitModel | None]] = deque()
        """Power to come: (tick, model from then on, None for off)."""
        self._state: Callable[..., Any] = namedtuple("State", model.outputs)  # type: ignore[misc]
        self._reading_at = [model.outputs.index(name) for name in _READINGS]
        self._truth_at = [model.outputs.index(name) for name in model.truth]
        self._sensor_source = source.substream(_SENSORS)
        self._sensor_noise: list[list[float]] = []
        self._states = model.step.shape[1] - 2
        self._input = np.empty(self._states + 2)
        self._output = np.empty(model.step.shape[0])
        self.columns = _columns(model)
        self._record = np.empty((BLOCK, len(self.columns)))
        self._ticks = 0
        self._samples = SampleTimes()

    def start(self, temp_c: float) -> None:
        """Put every node at `temp_c` and record tick 0."""
        self._input[: self._states] = temp_c
        self._input[-1] = 1.0
        self._keep([temp_c if name.endswith("temp_c") else 0.0 for name in self.model.outputs], temp_c)

    def tick(self, air_temp_c: float) -> None:
        """Advance by 1 s in air of the given temperature."""
        while self._switches and self._ticks >= self._switches[0][0]:
            self._switch(self._switches.popleft()[1])
        states = self._states
        self._input[states] = air_temp_c
        np.dot(self.model.step, self._input, out=self._output)
        self._input[:states] = self._output[:states]
        self._keep(self._output[states:].tolist(), air_temp_c)

    def mount(self, now_s: float, mounting: Mounting, roll_deg: float = 0.0) -> None:
        """Turn the unit on its bracket at `now_s`; its mounting errors stay."""
        last = self._mounts[-1][1]
        mount = replace(last, mounting=mounting, roll_deg=roll_deg)
        self._mounts.append((now_s, mount, mount.axes_in_table()))

    def switch(self, at_s: float, model: UnitModel | None) -> None:
        """Switch the unit off at a time (None), or on: `model` and a bias drawn anew hold from there.

        While it is off its heat sources are cold. Times of successive calls never decrease; ConfigurationError if
        one does: the unit is being switched already.
        """
        tick = math.ceil(at_s)
        if self._switches and tick < self._switches[-1][0]:
            raise ConfigurationError(
                "the unit is being switched already", where="gyro plant", expected="a unit that is on"
            )
        self._switches.append((tick, model))

    def case_reading_c(self, now_s: float) -> float:
        """Return the reading of the sensor on the case, held from the last tick."""
        return float(self._record[min(int(now_s), self._ticks - 1), self.columns.index("case_temp_c")])

    def truth(self) -> Mapping[str, Array]:
        """Return every recorded column, float64 (ticks,), tick k at k s; names as in `columns`."""
        table = self._record[: self._ticks]
        return {name: table[:, index].copy() for index, name in enumerate(self.columns)}

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        """Return `count` samples (see `GyroPlant`); ConfigurationError beyond the last tick."""
        if count == 0:
            none = np.empty((0, 3))
            return GyroSignal(self.axes, none[:, self._own], np.empty(0), none, none)
        index = self._samples.take(start_s, count, period_s)
        edges_s = self._samples.time_s(index + np.arange(count + 1))
        check_advanced("gyro plant", float(edges_s[-1]), self._ticks)
        middle_s = 0.5 * (edges_s[1:] + edges_s[:-1])
        axes = len(self.axes)
        values = self._between_ticks(middle_s)
        bias_dph = values[:axes] + values[axes : 2 * axes]
        felt, velocity = self._motion(edges_s, middle_s, period_s)
        turned = felt[self._own]
        sf_ppm = values[2 * axes :] + self._rate_errors_ppm(turned, period_s)
        increments = turned * (1.0 + 1e-6 * sf_ppm) + bias_dph * (math.radians(period_s) / 3600.0)
        for axis, noise in enumerate(self._noise):
            increments[axis] += noise.increments_rad(index, count, period_s)
        self._add_sample_effects(increments, edges_s, middle_s, period_s)
        # a sample that ends on a tick holds that tick's reading, whatever the rounding of its end
        held = (edges_s[1:] + 1e-9).astype(np.int64)
        angle = np.ascontiguousarray(increments.T)
        return GyroSignal(self.axes, angle, self._record[held, 3 * axes], velocity.T, felt.T)

    def _between_ticks(self, times_s: Array) -> Array:
        """Return the recorded errors at `times_s`, linear between ticks; float64 (3 axes, n)."""
        errors = self._record[:, : 3 * len(self.axes)]
        tick = int(times_s[0])
        if times_s[-1] < tick + 1:
            low, high = errors[tick], errors[min(tick + 1, self._ticks - 1)]
            return np.asarray(low[:, None] + (high - low)[:, None] * (times_s - tick))
        before = times_s.astype(np.int64)
        low, high = errors[before].T, errors[np.minimum(before + 1, self._ticks - 1)].T
        return np.asarray(low + (high - low) * (times_s - before))

    def _motion(self, edges_s: Array, middle_s: Array, period_s: float) -> tuple[Array, Array]:
        """Return what x, y, z truly turn through an interval, and their velocity; rad, m/s, float64 (3, n)."""
        times_s = np.empty(2 * len(middle_s) + 1)
        times_s[::2], times_s[1::2] = edges_s, middle_s
        if self._ground is not None:
            return self._rocked(times_s, period_s)
        velocity = np.empty((3, len(middle_s)))
        gravity = gravity_mps2(self._latitude_deg) * period_s
        if self._gimbals is None or self._gimbals.upright(edges_s):
            for first, _, matrix in self._mounts_from(middle_s):
                velocity[:, first:] = gravity * matrix[:, 2:]
            return self._turned(edges_s, middle_s, period_s), velocity
        turned = np.empty_like(velocity)
        for first, mount, matrix in self._mounts_from(middle_s):
            lines = about_up(mount.azimuth_error_deg) @ NORTH_WEST_UP @ matrix.T
            rest_s = times_s[2 * first :]
            turned[:, first:] = self._gimbals.turned_rad(rest_s, lines, self._latitude_deg).T
            up = self._gimbals.attitude(self._gimbals.angles_rad(rest_s), lines)[:, 2]
            velocity[:, first:] = gravity * (up if len(up) == 1 else simpson(up)).T
        return turned, velocity

    def _rocked(self, times_s: Array, period_s: float) -> tuple[Array, Array]:
        """Return what `_motion` does, on a ground that turns; `times_s`: ends and middles, (2 n + 1,)."""
        assert self._ground is not None
        turned = np.empty((3, len(times_s) // 2))
        velocity = np.empty_like(turned)
        gravity = gravity_mps2(self._latitude_deg) * period_s
        c = self._ground.attitude(times_s) @ self._attitude(times_s)
        angle = turned_between(c[::2].transpose(0, 2, 1), earth_rate_rad_s(self._latitude_deg), period_s)
        up = simpson(c[:, 2]).T
        for first, _, matrix in self._mounts_from(times_s[1::2]):
            sensed = self._sensed(matrix)
            turned[:, first:] = sensed @ angle[:, first:]
            velocity[:, first:] = gravity * sensed @ up[:, first:]
        return turned, velocity

    def _attitude(self, times_s: Array) -> Array:
        """Return C of what carries the unit: its own axes to east, north, up of the ground, (n, 3, 3).

        Times do not go back from call to call.
        """
        gimbals = self._gimbals or Gimbals([("up", self._table)])
        level = about_up(self._mounts[0][1].azimuth_error_deg) @ NORTH_WEST_UP
        return gimbals.attitude(gimbals.angles_rad(times_s), level)

    def _sensed(self, matrix: Array) -> Array:
        """Return what is sensed as x, y, z in the axes of `_attitude`, (3, 3)."""
        return matrix

    def _turned(self, edges_s: Array, middle_s: Array, period_s: float) -> Array:
        """Return the true angle each of x, y, z turns through on a table whose axis points up, rad, (3, n)."""
        turned = np.empty((3, len(middle_s)))
        for first, angles_deg, matrix in self._mounted(edges_s, middle_s):
            turned[:, first:] = turned_rad(matrix, angles_deg, self._latitude_deg, period_s)
        return turned

    def _mounts_from(self, middle_s: Array) -> Iterator[tuple[int, Mount, Array]]:
        """Yield the interval from which a mounting holds, and that mounting with its matrix."""
        for since_s, mount, matrix in self._mounts:
            first = 0 if since_s <= middle_s[0] else int(np.searchsorted(middle_s, since_s))
            if first == len(middle_s):
                break
            yield first, mount, matrix

    def _mounted(self, edges_s: Array, middle_s: Array) -> Iterator[tuple[int, Array, Array]]:
        """Yield the interval from which a mounting holds, the table's angle at edges from there, its matrix.

        A table at rest gives one pair of equal angles, good for every interval.
        """
        angles = self._table.total_angles_deg(edges_s)
        for first, mount, matrix in self._mounts_from(middle_s):
            scale_deg = angles if len(angles) == 2 else angles[first:]
            yield first, scale_deg + mount.azimuth_error_deg, matrix

    def _add_sample_effects(
        self, increments: Array, edges_s: Array, middle_s: Array, period_s: float
    ) -> None:
        if not any(model.sample_rad for model in self.model.axis_models):
            return
        before = increments.copy()
        for first, angles_deg, matrix in self._mounted(edges_s, middle_s):
            own_s = edges_s[first:]
            angle = angles_deg if len(angles_deg) == len(own_s) else np.full(len(own_s), angles_deg[0])
            for axis, model in enumerate(self.model.axis_models):
                up = min(max(float(matrix[self._own[axis], 2]), -1.0), 1.0)
                elevation = math.degrees(math.asin(up))
                path = SamplePath(own_s, angle, elevation, self._latitude_deg, period_s)
                added = [effect(path) for effect in model.sample_rad.values()]
                increments[axis, first:] = before[axis, first:] + sum(added)

    def _rate_errors_ppm(self, turned_rad: Array, period_s: float) -> Array:
        errors = np.zeros_like(turned_rad)
        for axis, model in enumerate(self.model.axis_models):
            if model.rate_ppm:
                rate_dps = turned_rad[axis] * math.degrees(1.0 / period_s)
                for effect in model.rate_ppm.values():
                    errors[axis] += effect(rate_dps)
        return errors

    def _switch(self, model: UnitModel | None) -> None:
        """Switch the unit off (None), or on as `model`."""
        self._input[-1] = 0.0 if model is None else 1.0
        if model is not None:
            self._power_ons += 1
            self.model = model
            self._bias, self._scale = _terms(model, self._turn_on, self._power_ons)

    def _keep(self, outputs: list[float], air_temp_c: float) -> None:
        """Record one tick from the network's outputs."""
        tick = self._ticks
        if tick == len(self._record):
            self._record = np.concatenate((self._record, np.empty_like(self._record)))
        if tick % BLOCK == 0:
            normals = self._sensor_source.generator(tick // BLOCK).standard_normal((BLOCK, 2))
            self._sensor_noise = (normals * self.model.sensor_noise_c).tolist()
        if self.model.readings is not None:
            sensor, case = self._reading_at
            outputs[sensor], outputs[case] = self.model.readings(air_temp_c, outputs[sensor], outputs[case])
        state = self._state(*outputs)
        row = [sum([term(state) for term in terms], constant) for terms, constant in self._bias]
        row += [process.value(tick) for process in self._flicker]
        row += [sum([term(state) for term in terms], constant) for terms, constant in self._scale]
        lsb, noise = self.model.sensor_lsb_c, self._sensor_noise[tick % BLOCK]
        row += [round((outputs[at] + noise[k]) / lsb) * lsb for k, at in enumerate(self._reading_at)]
        row += [outputs[at] for at in self._truth_at]
        self._record[tick] = row
        self._ticks = tick + 1


def _columns(model: UnitModel) -> tuple[str, ...]:
    """Return the names of the record's columns; those of an axis end in _x, _y, _z if there are several."""
    ends = [""] if len(model.axes) == 1 else [f"_{axis}" for axis in model.axes]
    errors = ("bias_dph", "flicker_dph", "sf_error_ppm")
    return (*(name + end for name in errors for end in ends), *_READINGS, *model.truth)


def _terms(model: UnitModel, source: NoiseSource, power_on: int) -> tuple[list[_Channel], list[_Channel]]:
    """Return what to sum for each axis's bias and scale factor: functions of state, and this power-on's part."""
    drawn = source.generator(power_on).standard_normal((len(model.axis_models), 2)).tolist()
    bias: list[_Channel] = []
    scale: list[_Channel] = []
    for axis, (on_bias, on_scale) in zip(model.axis_models, drawn, strict=True):
        bias.append((tuple(axis.bias_dph.values()), on_bias * axis.turn_on_bias_dph))
        scale.append((tuple(axis.sf_error_ppm.values()), on_scale * axis.turn_on_sf_ppm))
    return bias, scale
