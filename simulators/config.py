"""What an emulated lab is made of: the message that starts one; parts of it are sections of a plant file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, ClassVar, Literal, get_args, get_origin, get_type_hints

from drivers.kit.config import (
    ChamberConfig,
    GyroConfig,
    InstrumentConfig,
    Mounting,
    PlatformConfig,
    Section,
    TableConfig,
    key,
)
from drivers.kit.registry import config_class, roles
from simulators.faults import Fault


class _PlantSection(Section):
    __pydantic_config__: ClassVar[Mapping[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}


class Rotation(_PlantSection):
    """The table's motion and its encoder.

    Ripple is the peak change of the rate, 1e-6 of it, once and twice a turn (50,000 is 5 %); the encoder has
    white noise and a ripple of so many lines a turn beside the eccentricity that every emulated table has.
    """

    ripple_once_ppm: float = key(default=5.0, ge=0, le=2e5)
    ripple_twice_ppm: float = key(default=2.0, ge=0, le=2e5)
    encoder_noise_arcsec: float = key(default=0.0, ge=0, le=3600)
    encoder_ripple_arcsec: float = key(default=0.0, ge=0, le=3600)
    encoder_ripple_lines: int = key(default=36, ge=1, le=1_000_000)


class Ground(_PlantSection):
    """What the table stands on (simulators.plant.ground): a floor or pier in the field, a ship, a vehicle.

    It moves: `sway_mps` is its rms velocity along east and along north, about `sway_hz`; `step_mps` the velocity
    of the push that each of `steps_per_min` steps gives it, on average so many, at random times; it rings down
    at `step_hz`. It turns: `rock_arcsec` is the rms angle about east, north and up, about `rock_hz`;
    `step_arcsec` the angle that a step tips it by, ringing down like the push; `sun_arcsec` the amplitude of a
    tilt about east and north that comes and goes in a day; `engine_arcsec` the amplitude about each axis of a
    line at `engine_hz`.
    """

    sway_mps: float = key(default=0.0, ge=0, le=1)
    sway_hz: float = key(default=0.15, gt=0, le=100)
    step_mps: float = key(default=0.0, ge=0, le=1)
    steps_per_min: float = key(default=0.0, ge=0, le=600)
    step_hz: float = key(default=8.0, gt=0, le=100)
    rock_arcsec: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rock_hz: float = key(default=0.05, gt=0, le=100)
    step_arcsec: float = key(default=0.0, ge=0, le=3600)
    sun_arcsec: float = key(default=0.0, ge=0, le=3600)
    engine_arcsec: float = key(default=0.0, ge=0, le=3600)
    engine_hz: float = key(default=25.0, gt=0, le=1000)

    @property
    def moves(self) -> bool:
        """Whether it has a velocity."""
        return self.sway_mps > 0.0 or (self.step_mps > 0.0 and self.steps_per_min > 0.0)

    @property
    def rocks(self) -> bool:
        """Whether it turns."""
        steps = self.step_arcsec > 0.0 and self.steps_per_min > 0.0
        return any(self.rock_arcsec) or steps or self.sun_arcsec > 0.0 or self.engine_arcsec > 0.0


class Accelerometers(_PlantSection):
    """The accelerometers of a platform INS (simulators.plant.accelerometers), sizes of a navigation-grade one.

    The unit's serial number draws bias, scale factor and what changes the bias by these standard deviations:
    `per_k_ug` with the platform's temperature, which goes with heading, `heading_ug` with cosine and sine of the
    heading. Both are nothing in a sound unit. A bias of `wander_ug` wanders with the correlation time `wander_h`.
    """

    bias_ug: float = key(default=50.0, ge=0, le=1e4)
    scale_ppm: float = key(default=50.0, ge=0, le=1e4)
    per_k_ug: float = key(default=0.0, ge=0, le=1e4)
    heading_ug: float = key(default=0.0, ge=0, le=1e4)
    white_ug_per_sqrt_hz: float = key(default=10.0, ge=0, le=1e4)
    wander_ug: float = key(default=2.0, ge=0, le=1e4)
    wander_h: float = key(default=20.0, gt=0, le=1e4)


class Bearing(_PlantSection):
    """The bearing that a unit of the model `ins_triad` turns in (simulators.plant.wobble).

    `lines_arcsec`: [m, x, y] each, a tilt of the unit about its x and y axes by x + jy turning m times a turn
    in body axes; none at all is a perfect bearing. `play_arcsec`: tilt added after a reversal, over
    `play_travel_deg`. `misalignment_arcsec`: angles of the sensors' x and y axes towards z.
    """

    lines_arcsec: tuple[tuple[float, float, float], ...]
    play_arcsec: tuple[float, float] = (0.0, 0.0)
    play_travel_deg: float = key(default=0.5, gt=0, le=90)
    misalignment_arcsec: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class SerialFormat:
    """How one end of a serial line is set."""

    baudrate: int
    bytesize: int = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = 1

    @property
    def parity_bits(self) -> int:
        """Return how many parity bits a byte has."""
        return int(self.parity != "N")

    @property
    def bits_a_byte(self) -> int:
        """Return the bits on the line for each byte: start, data, parity, stop."""
        return 1 + self.bytesize + self.parity_bits + self.stopbits


@dataclass(frozen=True, kw_only=True)
class GyroInLab:
    """A gyro unit: its section of the bench file, and which physics it has.

    `lean_deg`: its input-axis misalignment towards the next axis and the last one, `mount_tilt_deg` that of its
    fixture upwards. `bearing`: what an INS turns in; None for the one its seed draws. `on_ground`: it stands
    beside the table. `errors`: terms and noise of a fitted model in place of the unit's own errors.
    """

    config: GyroConfig
    model: str
    unit_seed: int
    mounting: Mounting | None = None
    mount_azimuth_error_deg: float = 0.0
    mount_tilt_deg: float = 0.0
    lean_deg: tuple[float, float] = (0.0, 0.0)
    clock_error_ppm: float = 0.0
    bearing: Bearing | None = None
    on_ground: bool = False
    errors: dict[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class PlatformInLab:
    """A platform INS: its section of the bench file; `unit_seed` draws its physics.

    `effect_dph`: rms over headings of the change of its mean drift; `north_deg`: table angle at heading 0;
    `start_k`: how much warmer than in equilibrium it is at power-on.
    `modelled`: its drift is that of a model, `heading_effect` the model's values (None: it has none).
    """

    config: PlatformConfig
    unit_seed: int
    effect_dph: float = 1e-3
    start_k: float = 0.0
    north_deg: float = 0.0
    modelled: bool = False
    heading_effect: list[float] | None = None
    accelerometers: Accelerometers = field(default_factory=Accelerometers)


@dataclass(frozen=True, kw_only=True)
class InstrumentInLab:
    """A supply, a logger or an instrument of another role: its section of the bench file."""

    role: str
    config: InstrumentConfig


@dataclass(frozen=True, kw_only=True)
class LabConfig:
    """A whole lab.

    `delivery_s`: how often adapters hand over streamed bytes. `cpu`: processor that lab and bench share in
    virtual time, None to leave that to the system. `lines`: devices, by port, that
    understand only what is sent with their own settings. `adapter_batch_s`: ports whose adapter hands streams
    over so often. `emulated`: seed and model, which a bench is told.
    """

    clock: Literal["virtual", "wall"]
    seed: int
    latitude_deg: float
    room_temp_c: float
    chamber_model: str
    table: TableConfig
    chamber: ChamberConfig
    gyros: tuple[GyroInLab, ...]
    platforms: tuple[PlatformInLab, ...] = ()
    instruments: tuple[InstrumentInLab, ...] = ()
    faults: tuple[Fault, ...] = ()
    lines: dict[str, SerialFormat] = field(default_factory=dict)
    adapter_batch_s: dict[str, float] = field(default_factory=dict)
    rotation: Rotation = field(default_factory=Rotation)
    ground: Ground = field(default_factory=Ground)
    imu_error_scale: float = 1.0
    delivery_s: float = 1.0
    cpu: int | None = None
    emulated: dict[str, Any] | None = None

    def to_line(self) -> bytes:
        """Return the message that starts such a lab, without its end of line."""
        return json.dumps(dataclasses.asdict(self)).encode()

    @classmethod
    def from_line(cls, line: bytes) -> LabConfig:
        """Return what `to_line` made a message of."""
        config: LabConfig = _restored(cls, json.loads(line))
        return config


def _restored(kind: Any, value: Any) -> Any:
    """Return what a field of a type held before it was JSON; of a union, the first type counts."""
    if isinstance(kind, UnionType):
        kind = get_args(kind)[0]
    if isinstance(value, list) and get_origin(kind) is tuple:
        return tuple(_restored(get_args(kind)[0], member) for member in value)
    if not isinstance(value, dict):
        return value
    if get_origin(kind) is dict and get_args(kind)[1] is SerialFormat:
        return {name: SerialFormat(**content) for name, content in value.items()}
    if get_origin(kind) is dict and get_args(kind)[0] is int:
        return {int(number): content for number, content in value.items()}
    for role, shared in roles().items():
        if kind is shared:
            kind = config_class(role, value["driver"])
    if kind is InstrumentInLab:
        config = _restored(config_class(value["role"], value["config"]["driver"]), value["config"])
        return InstrumentInLab(role=value["role"], config=config)
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        return value
    types = get_type_hints(kind)
    return kind(**{name: _restored(types[name], content) for name, content in value.items()})
