"""What a bench file may hold: frozen models, a description for every key (the text an error quotes)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    model_validator,
)

from drivers.base.constants import earth_rate_north_dph
from drivers.base.errors import ConfigurationError
from drivers.kit.link import check_place


def _place(value: str) -> str:
    try:
        check_place(value, "")
    except ConfigurationError as error:
        raise ValueError(str(error)) from error
    return value


Baudrate = Annotated[int, Field(ge=50, le=12_000_000)]
Port = Annotated[str, Field(min_length=1), AfterValidator(_place)]
_NAME = r"^[a-z][a-z0-9_]{0,31}$"
_PORT_TEXT = "a port: a serial device such as '/dev/ttyUSB0', or 'socket://host:port'"


def _sensor_numbers(value: Any) -> Any:
    """Turn TOML's keys, which are always text, into sensor numbers; leave what is none for the check."""
    if not isinstance(value, dict):
        return value
    return {
        int(key) if isinstance(key, str) and key.isdecimal() else key: text for key, text in value.items()
    }


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Emulated(_Section):
    """What stands behind the ports of an emulated lab, so that no run there reads as a real one."""

    seed: int = Field(description="the lab's seed")
    model: str = Field(description="what it emulates, in words")


class BenchSection(_Section):
    """`[bench]`: the place."""

    name: str = Field(min_length=1, description="a name for the bench, as text")
    latitude_deg: float = Field(
        ge=-90, le=90, allow_inf_nan=False, description="the bench's latitude in degrees, north positive"
    )
    clock: str | None = Field(
        default=None,
        pattern=r"^virtual:///.+$",
        description="'virtual:///...', the clock of an emulated lab; leave it out for the wall clock",
    )
    emulated: Emulated | None = Field(
        default=None, description="seed and model of an emulated lab; leave it out for real devices"
    )

    @property
    def earth_rate_north_dph(self) -> float:
        """Horizontal component of the Earth's rate at the bench, deg/h."""
        return earth_rate_north_dph(self.latitude_deg)


Direction = Literal["east", "west", "north", "south", "up", "down"]


class AxisSection(_Section):
    """`[[table.axes]]`: one axis of the table, outermost first; the last one carries the unit."""

    name: str = Field(
        pattern=r"^[a-z][a-z0-9]{0,15}$", description="a short name, e.g. 'outer', 'middle', 'inner'"
    )
    number: int = Field(ge=1, le=9, description="the axis' number on the controller")
    direction: Direction = Field(
        description="where the axis points with all axes at 0, positive turns right-handed about it: 'east', "
        "'west', 'north', 'south', 'up' or 'down'"
    )
    max_rate_dps: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="the highest rate of this axis, deg/s"
    )
    max_acceleration_dps2: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="the highest acceleration of this axis, deg/s2"
    )
    min_angle_deg: float | None = Field(
        default=None, ge=-360, le=360, description="the lower stop of an axis of limited motion, deg"
    )
    max_angle_deg: float | None = Field(
        default=None, ge=-360, le=360, description="the upper stop of an axis of limited motion, deg"
    )


class TableSection(_Section):
    """`[table]`: the rate table, with `axis` for a table of one axis, up, or `axes`."""

    driver: str = Field(description="the kind of table driver")
    port: Port = Field(description=_PORT_TEXT)
    baudrate: Baudrate = Field(default=9600, description="the baud rate, a whole number of bit/s")
    axis: int = Field(default=1, ge=1, le=9, description="the number of the table axis that carries the unit")
    axes: tuple[AxisSection, ...] = Field(
        default=(),
        max_length=3,
        strict=False,
        exclude_if=lambda axes: not axes,
        description="one to three [[table.axes]], outermost first, with name, number and direction",
    )

    @property
    def all_axes(self) -> tuple[AxisSection, ...]:
        """The axes, outermost first; a table without `axes` has one, vertical, called 'table'."""
        return self.axes or (AxisSection(name="table", number=self.axis, direction="up"),)


class ChamberSection(_Section):
    """`[chamber]`: the thermal chamber. `auxiliary` maps a sensor's number to what it is glued to."""

    driver: str = Field(description="the kind of chamber driver")
    port: Port = Field(description=_PORT_TEXT)
    baudrate: Baudrate = Field(default=9600, description="the baud rate, a whole number of bit/s")
    address: int | None = Field(
        default=None,
        ge=0,
        le=247,
        description="the chamber's bus address, 0 to 247; left out: 1, or none for an ESPEC on RS-232 or TCP",
    )
    simserv: bool = Field(default=True, description="true if the chamber's port also answers SimServ")
    start_channel: int = Field(
        default=1, ge=1, le=32, description="the number of the digital output that starts the chamber"
    )
    door_message: str | None = Field(
        default=None,
        min_length=3,
        description="part of the alarm or warning the chamber shows while its door is open, e.g. 'door'",
    )
    auxiliary: Annotated[dict[Annotated[int, Field(ge=1)], str], BeforeValidator(_sensor_numbers)] = Field(
        default_factory=dict,
        description='sensor number (1, 2, ...) = what it is glued to, e.g. {1 = "fog_1 case"}',
    )


class _UnitSection(_Section):
    name: str = Field(
        pattern=_NAME,
        description="a short name of lower-case letters, digits and _ that starts with a letter",
    )
    driver: str = Field(description="the kind of driver")
    unit: str = Field(min_length=1, description="the serial number or id of the unit under test, as text")


class GyroSection(_UnitSection):
    """`[[gyro]]`: a unit under test, on a serial port (`port`) or a CAN bus (`interface`, `channel`)."""

    axis: Literal["x", "y", "z"] = Field(description="the axis under test: 'x', 'y' or 'z'")
    axes: str = Field(
        default="x",
        pattern=r"^(x|y|z|xy|xz|yz|xyz)$",
        description="the axes the unit has, in order: 'x', 'xyz', ...",
    )
    port: Port | None = Field(default=None, description=_PORT_TEXT)
    baudrate: Baudrate = Field(default=921_600, description="the baud rate, a whole number of bit/s")
    frame_format: str | None = Field(
        default=None,
        min_length=1,
        description="the message the unit sends: 'A', 'B' or 'C' of a KVH gyro, or one of its description's",
    )
    description: str | dict[str, Any] | None = Field(
        default=None,
        description="a frame description: a name that `gyrobench frames list` shows, or a path to a TOML file",
    )
    settings: dict[str, str] = Field(
        default_factory=dict,
        description="how the unit was ordered or set up, e.g. { gyro_output = 'incremental_angle' }: of the "
        "settings that `gyrobench frames check` shows",
    )
    interface: str | None = Field(
        default=None,
        min_length=1,
        description="a python-can interface, e.g. 'socketcan' or 'gyrobench_slcan'",
    )
    channel: Port | None = Field(
        default=None, description="the CAN channel, e.g. 'can0', or the slcan adapter's port"
    )
    bitrate: int = Field(
        default=500_000, ge=10_000, le=1_000_000, description="the CAN bit rate, a whole number of bit/s"
    )
    layout: str | dict[str, Any] | None = Field(
        default=None,
        description="a shipped CAN layout's name, or a mapping file's path from the bench file's folder",
    )
    source_address: int | None = Field(
        default=None, ge=0, le=253, description="the J1939 address of the unit, 0 to 253; left out: any"
    )
    rate_hz: float = Field(
        default=100.0, gt=0, le=20_000, allow_inf_nan=False, description="the sample rate in Hz"
    )
    case_sensor: int | None = Field(
        default=None, ge=1, description="the number of the chamber's auxiliary sensor on the unit's case"
    )

    @property
    def on_can(self) -> bool:
        """Whether the unit is on a CAN bus rather than a serial port."""
        return self.port is None


class Band(_Section):
    """A stretch of a quantity in a rule: above a value, below one, or both."""

    above: float | None = Field(default=None, allow_inf_nan=False, description="more than this, a number")
    below: float | None = Field(default=None, allow_inf_nan=False, description="less than this, a number")

    @model_validator(mode="after")
    def _says_something(self) -> Band:
        if self.above is None and self.below is None:
            raise ValueError("neither above nor below")
        return self

    @property
    def text(self) -> str:
        """The band in words."""
        parts = [("above", self.above), ("below", self.below)]
        return " and ".join(f"{word} {value:g}" for word, value in parts if value is not None)


_BAND_TEXT = "{ above = number }, { below = number } or both"


class ForbiddenState(_Section):
    """`[[limits.forbid]]`: a state that must not be: all conditions given, together."""

    name: str = Field(min_length=1, description="what is forbidden, in words, e.g. 'spin with the door open'")
    rate_dps: Band | None = Field(
        default=None, description=f"the table's rate in deg/s, without sign: {_BAND_TEXT}"
    )
    angle_deg: Band | None = Field(default=None, description=f"the table's angle in deg: {_BAND_TEXT}")
    air_temp_c: Band | None = Field(default=None, description=f"the chamber's air in degC: {_BAND_TEXT}")
    set_point_c: Band | None = Field(
        default=None, description=f"the chamber's set point in degC: {_BAND_TEXT}"
    )
    aux_temp_c: Band | None = Field(
        default=None, description=f"any of the chamber's auxiliary sensors in degC: {_BAND_TEXT}"
    )
    door: Literal["open", "closed"] | None = Field(
        default=None, description="'open' or 'closed', as chamber.door_message tells it"
    )

    @model_validator(mode="after")
    def _says_something(self) -> ForbiddenState:
        if not self.conditions:
            raise ValueError("no condition")
        return self

    @property
    def conditions(self) -> dict[str, Band | str]:
        """The conditions that are given, by quantity."""
        names = ("rate_dps", "angle_deg", "air_temp_c", "set_point_c", "aux_temp_c", "door")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def text(self) -> str:
        """The conditions in words."""
        return ", ".join(
            f"{name} {value if isinstance(value, str) else value.text}"
            for name, value in self.conditions.items()
        )


class PlatformSection(_UnitSection):
    """`[[platform]]`: a platform INS under test, on a serial port."""

    port: Port = Field(description=_PORT_TEXT)
    baudrate: Baudrate = Field(default=38_400, description="the baud rate, a whole number of bit/s")
    period_s: int = Field(
        default=60, ge=1, le=60, description="seconds from sample to sample, whole, 1 to 60"
    )
    longitude_deg: float = Field(
        default=0.0,
        ge=-180,
        lt=180,
        allow_inf_nan=False,
        description="the longitude that the platform is given, in degrees, east positive",
    )


class LimitsSection(_Section):
    """`[limits]`: what nobody may demand of this bench, whatever its devices could do."""

    max_rate_dps: float = Field(
        default=20.0, gt=0, allow_inf_nan=False, description="the highest table rate allowed, deg/s"
    )
    min_temp_c: float = Field(
        default=-60.0, ge=-200, allow_inf_nan=False, description="the lowest set point allowed, degC"
    )
    max_temp_c: float = Field(
        default=85.0, le=400, allow_inf_nan=False, description="the highest set point allowed, degC"
    )
    max_ramp_k_per_min: float = Field(
        default=25.0, gt=0, allow_inf_nan=False, description="the fastest temperature ramp allowed, K/min"
    )
    forbid: tuple[ForbiddenState, ...] = Field(
        default=(),
        strict=False,
        max_length=100,
        description="[[limits.forbid]]: name, and what must not be true together",
    )


class SafeSection(_Section):
    """`[safe]`: where the bench is left when something goes wrong."""

    chamber_set_point_c: float = Field(
        default=25.0, allow_inf_nan=False, description="the chamber's set point after a stop, degC"
    )
    watchdog: bool = Field(
        default=True,
        description="true for a process that makes the bench safe if the controller dies; wall clock only",
    )
    last_unit_s: float = Field(
        default=60.0,
        ge=0.0,
        le=3600.0,
        allow_inf_nan=False,
        description="seconds that a run goes on when no unit it tests speaks any more, for a cable to come back; "
        "0: the loss of the last unit's port ends it at once",
    )


class RecordingSection(_Section):
    """`[recording]`: how soon bytes reach the disk."""

    flush_interval_s: float = Field(
        default=1.0,
        gt=0,
        le=1,
        allow_inf_nan=False,
        description="seconds of data that a crash may cost",
    )


class BenchFile(_Section):
    """A bench, as its file describes it. `sha256` is the checksum of the file as it was read."""

    bench: BenchSection = Field(description="a [bench] section with name and latitude_deg")
    table: TableSection = Field(description="a [table] section with driver and port")
    chamber: ChamberSection = Field(description="a [chamber] section with driver and port")
    gyro: tuple[GyroSection, ...] = Field(
        default=(), strict=False, description="at least one [[gyro]] with name, driver, unit, axis and a port"
    )
    platform: tuple[PlatformSection, ...] = Field(
        default=(), strict=False, description="[[platform]] with name, driver, unit and a port"
    )
    limits: LimitsSection = Field(default=LimitsSection(), description="a [limits] section")
    safe: SafeSection = Field(default=SafeSection(), description="a [safe] section")
    recording: RecordingSection = Field(default=RecordingSection(), description="a [recording] section")
    _sha256: str = PrivateAttr(default="")

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes this was read from, in hexadecimal."""
        return self._sha256

    @property
    def units(self) -> dict[str, str]:
        """Name on this bench -> serial number or id of every unit under test."""
        sections: tuple[_UnitSection, ...] = (*self.gyro, *self.platform)
        return {section.name: section.unit for section in sections}

    def gyro_named(self, name: str) -> GyroSection:
        """Return the gyro of that name; raises KeyError."""
        return {gyro.name: gyro for gyro in self.gyro}[name]
