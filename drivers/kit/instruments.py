"""What a turntable, a chamber and a gyro are to the bench: protocols, and the values that cross them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import LimitExceeded
from drivers.kit.link import Link


@dataclass(frozen=True)
class Identity:
    """Who a device says it is; `details` in the device's own words."""

    maker: str
    model: str
    serial_number: str = ""
    firmware: str = ""
    details: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TableLimits:
    """Limits of one axis as read from the table; positions are None on a continuous axis."""

    max_rate_dps: float
    max_acceleration_dps2: float
    min_angle_deg: float | None
    max_angle_deg: float | None


@dataclass(frozen=True)
class TableState:
    """Telemetry of the axis that carries the unit; `outer`: of the axes outside of it, by name."""

    angle_deg: float
    rate_dps: float
    outer: Mapping[str, TableState] = field(default_factory=dict)


@dataclass(frozen=True)
class ChamberLimits:
    """Set-point limits as read from the chamber."""

    min_temp_c: float
    max_temp_c: float


@dataclass(frozen=True)
class ChamberCapabilities:
    """What a chamber can do, known before anything moves.

    `temp_resolution_c`: step of its telemetry and set point. `ramp_k_per_min`: slowest and fastest ramp that
    it can be told, None if it cannot be told one. `auxiliary`: numbers of the sensors it can read besides the
    air, None if it does not say.
    """

    temp_resolution_c: float
    ramp_k_per_min: tuple[float, float] | None
    auxiliary: tuple[int, ...] | None


@dataclass(frozen=True)
class ChamberState:
    """Telemetry: air temperature, set point in force, auxiliary sensors by number (1-based)."""

    air_temp_c: float
    set_point_c: float
    auxiliary_c: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Rest:
    """What a device says when it is asked whether it is at rest.

    Of a table the rate of every axis by name; of a chamber whether it conditions and its set point; of a supply
    which outputs are on.
    """

    reached: bool
    rates_dps: Mapping[str, float] = field(default_factory=dict)
    running: bool | None = None
    set_point_c: float | None = None
    outputs: Mapping[str, bool] = field(default_factory=dict)


class Instrument(Protocol):
    """What all polled instruments share. `link` is the one port it owns."""

    link: Link

    def identify(self) -> Identity:
        """Ask the device who it is; WrongDevice if it is something else."""

    def alarms(self) -> list[str]:
        """Return the alarms and faults in force, in words; empty when healthy."""

    def halt(self) -> None:
        """Write what stops the device and wait for nothing; `make_safe` must follow."""

    def make_safe(self) -> None:
        """Tell the device to rest until it says yes, with few bytes and whatever state it is in."""

    def read_rest(self) -> Rest:
        """Read back whether the device is at rest: a table turns on until it has braked."""


def alarms_in_words(device: Instrument) -> str:
    """Return the alarms in force as one text: "no alarm", or that this device cannot tell (`tells_alarms`)."""
    if not getattr(device, "tells_alarms", True):
        return "its controller tells no alarms, look at its panel"
    return "; ".join(device.alarms()) or "no alarm"


class Turntable(Instrument, Protocol):
    """A rate table of one or more axes. Demands return when the device accepted them, not when the motion
    ended.

    `axes`: their names, outermost first; the last one carries the unit. A verb's `axis` is one of these
    names, "" the one that carries the unit. Angles are as the table's encoders count them, right-handed about
    the axis.
    """

    axes: tuple[str, ...]

    def limits(self, axis: str = "") -> TableLimits:
        """Read the limits in force."""

    def limit_turns(
        self, max_rate_dps: float, axis: str = "", max_acceleration_dps2: float | None = None
    ) -> None:
        """Have the device itself keep turns to an angle at or below a rate and, if given, an acceleration."""

    def servo_on(self) -> None:
        """Reset and close the interlock of every axis."""

    def home(self, axis: str = "") -> None:
        """Demand the reference position from which angles count, looked for where the device has to."""

    def point(self, angle_deg: float, axis: str = "") -> None:
        """Demand an angle in position mode, by the shortest way that the axis allows."""

    def turn(self, by_deg: float, axis: str = "") -> None:
        """Demand a turn from where the axis stands at rest, in the sense of its sign; a whole turn, too."""

    def spin(self, rate_dps: float, axis: str = "", acceleration_dps2: float | None = None) -> None:
        """Demand a rate in rate mode, approached at `acceleration_dps2` (None: as set before)."""

    def request_state(self) -> None:
        """Ask for telemetry of all axes; other devices may be asked before `read_state` collects the answer."""

    def read_state(self) -> TableState:
        """Read angle and rate, asked for by `request_state`."""


class Chamber(Instrument, Protocol):
    """A thermal chamber. Demands return when the device accepted them."""

    def capabilities(self) -> ChamberCapabilities:
        """Return what this chamber can do; `identify` must have been called."""

    def limits(self) -> ChamberLimits:
        """Read the set-point limits."""

    def start(self) -> None:
        """Start air conditioning at the set point in force."""

    def stop(self) -> None:
        """Stop air conditioning."""

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, approached at `ramp_k_per_min` or, when None, as fast as the device can."""

    def request_state(self) -> None:
        """Ask for telemetry; other devices may be asked before `read_state` collects the answer."""

    def read_state(self) -> ChamberState:
        """Read telemetry, asked for by `request_state`, at the best resolution the device offers."""


class Meter(Instrument, Protocol):
    """An instrument beside table and chamber that is read while a run goes on.

    `columns`: what it reads, units in the names: `aux_101_temp_c`, `output_1_current_a`.
    """

    columns: tuple[str, ...]

    def prepare(self) -> None:
        """Set it up as the bench file says; `identify` must have been called."""

    def request_readings(self) -> None:
        """Ask for readings; other devices may be asked before `read` collects the answer."""

    def read(self) -> Mapping[str, float]:
        """Return the readings by column, asked for by `request_readings`; NaN for a sensor that has none."""


class Supply(Meter, Protocol):
    """A power supply. `prepare` sets voltages and current limits, and switches nothing."""

    def is_on(self, output: int) -> bool:
        """Read whether an output is on."""

    def switch(self, output: int, on: bool) -> None:
        """Switch an output on or off and read back that it is."""


def require_ramp(
    can: ChamberCapabilities, set_point_c: float, ramp_k_per_min: float | None, where: str
) -> None:
    """Raise LimitExceeded for a set point that is no number or a ramp that a chamber cannot be told."""
    slowest, fastest = can.ramp_k_per_min or (math.inf, 0.0)
    if math.isfinite(set_point_c) and (ramp_k_per_min is None or slowest <= ramp_k_per_min <= fastest):
        return
    ramps = f"a ramp of {slowest:g} .. {fastest:g} K/min, or none" if can.ramp_k_per_min else "no ramp"
    raise LimitExceeded(
        "the chamber cannot be told that",
        where=where,
        found=f"{set_point_c:g} degC" + ("" if ramp_k_per_min is None else f" at {ramp_k_per_min:g} K/min"),
        expected=f"a finite set point and {ramps}",
        remedy="correct the procedure's parameters, or use a chamber that can",
    )


@dataclass
class FrameBatch:
    """Decoded frames of a stream, in order.

    `columns`: name -> array of shape (n,); always `counter` (the device's own frame counter or time, already
    widened to int64 but not unwrapped). `end_offset`, int64 (n,): offset in the byte stream just past each
    frame's last byte, which ties a frame to its arrival time.
    """

    columns: dict[str, NDArray[Any]]
    end_offset: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.end_offset)


@dataclass
class StreamCounts:
    """What a stream decoder met; `rejected` by reason ('checksum', 'length', 'text', ...)."""

    frames: int = 0
    bytes_skipped: int = 0
    rejected: dict[str, int] = field(default_factory=dict)

    def reject(self, reason: str, times: int = 1) -> None:
        """Count what was refused; a reason that never came up is not listed."""
        if times:
            self.rejected[reason] = self.rejected.get(reason, 0) + times


LossSide = Literal["before", "after"]


def loss_taints(decoder: StreamDecoder) -> frozenset[LossSide]:
    """Return which samples beside lost ones may be made up of two samples' messages.

    The one before the loss, the one after it, or neither: that of a decoder without the attribute `loss_taints`,
    whose samples are one message each.
    """
    found: frozenset[LossSide] = getattr(decoder, "loss_taints", frozenset())
    return found


def has_counter(decoder: StreamDecoder) -> bool:
    """Return whether the unit counts its samples; False where `counter` is counted here, by frames received."""
    found: bool = getattr(decoder, "has_counter", True)
    return found


def pulse_resolution_s(decoder: StreamDecoder) -> float:
    """Return the step of the time since a pulse, s; 0 where the unit tells of none, or its decoder of no step."""
    found: float = getattr(decoder, "pulse_resolution_s", 0.0)
    return found


class StreamDecoder(Protocol):
    """Incremental decoder: any chunking of the same bytes gives the same frames; never raises on bytes."""

    counts: StreamCounts
    counter_modulo: int
    """Value at which `counter` wraps to 0."""
    counter_step: float
    """Counter units a sample at the nominal rate: 1 for a sequence number, 10000 for us at 100 Hz."""
    nominal_rate_hz: float

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes of the stream; an incomplete frame is kept for the next call."""


class Gyro(Protocol):
    """A gyro that streams. After `start` every byte on `link` belongs to the stream."""

    link: Link

    def identify(self) -> Identity:
        """Ask the device, or its stream where it cannot be asked, who it is; WrongDevice if not it."""

    def start(self) -> None:
        """Configure rate, format and units, then start streaming."""

    def stop(self) -> None:
        """Stop streaming where the device can."""

    def close(self) -> None:
        """Let go of the port, and of a bus behind it; never raises for a port that is already gone."""


class Platform(Gyro, Protocol):
    """A platform INS: a stream of positions and temperatures, free once its alignment has been ended."""

    def navigate(self) -> None:
        """End the alignment: the position runs free from here on."""
