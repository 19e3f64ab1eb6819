"""What a bench file says of a device: one model for each role, which drivers derive their configurations from.

A role's model has the keys that the bench itself reads, and those that several drivers share. A driver adds its
own keys, narrows those it has, and names its model in its kind (`drivers.kit.kinds`). The description of a key
is the text that an error quotes.

The models are frozen dataclasses. pydantic checks them where a file is read, and only there: an emulated lab
reads them too, and starts without it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, dataclass_transform

from drivers.base.errors import ConfigurationError
from drivers.kit.places import VISA_EXAMPLE, check_place

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter
    from pydantic_core import CoreSchema


def key(
    *, default: Any = dataclasses.MISSING, default_factory: Any = dataclasses.MISSING, **checks: Any
) -> Any:
    """Return a field of a section; `checks` are those of `pydantic.Field`: description, ge, pattern, ..."""
    return dataclasses.field(default=default, default_factory=default_factory, metadata=checks)


class _Checked:
    """Annotation of a type that a function checks: it makes its own schema of pydantic's schema of the type."""

    def __init__(self, schema: Callable[[CoreSchema], CoreSchema]) -> None:
        self._schema = schema

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return self._schema(handler(source))


def _place(visa: bool, text: CoreSchema) -> CoreSchema:
    from pydantic_core import core_schema

    def checked(value: str) -> str:
        if not value:
            raise ValueError("no port")
        try:
            check_place(value, "", visa=visa)
        except ConfigurationError as error:
            raise ValueError(str(error)) from error
        return value

    return core_schema.no_info_after_validator_function(checked, text)


def _sensors(_: CoreSchema) -> CoreSchema:
    from pydantic_core import core_schema

    def numbered(value: Any) -> Any:
        """Turn TOML's keys, which are always text, into sensor numbers; leave what is none for the check."""
        if not isinstance(value, dict):
            return value
        return {
            int(key) if isinstance(key, str) and key.isdecimal() else key: text for key, text in value.items()
        }

    table = core_schema.dict_schema(core_schema.int_schema(ge=1), core_schema.str_schema())
    return core_schema.no_info_before_validator_function(numbered, table)


Port = Annotated[str, _Checked(partial(_place, False))]
MeterPort = Annotated[str, _Checked(partial(_place, True))]
"""A port that may be a VISA resource: of a device that answers lines with a question mark and nothing else."""
NumberedTexts = Annotated[dict[int, str], _Checked(_sensors)]
"""A table whose keys are numbers: sensor or channel = text."""
_NAME = r"^[a-z][a-z0-9_]{0,31}$"
_PORT_TEXT = "a port: a serial device such as '/dev/ttyUSB0', or 'socket://host:port'"
_METER_PORT_TEXT = f"{_PORT_TEXT}, or a VISA resource such as '{VISA_EXAMPLE}'"


def _baudrate(default: int) -> Any:
    return key(default=default, ge=50, le=12_000_000, description="the baud rate, a whole number of bit/s")


@dataclass(frozen=True)
class Mistake:
    """One thing wrong with a bench file or a section of it."""

    key: str
    found: str
    expected: str


def refusal(what: str, where: str, mistakes: Sequence[Mistake]) -> ConfigurationError:
    """Return the error that says all that is wrong with a file; `what`: the file, in words."""
    if len(mistakes) == 1:
        only = mistakes[0]
        return ConfigurationError(
            f"{only.key} cannot be used", where=where, found=only.found, expected=only.expected
        )
    lines = [f"  {mistake.key}: found {mistake.found}, expected {mistake.expected}" for mistake in mistakes]
    return ConfigurationError("\n".join([f"{len(mistakes)} mistakes in {what}", *lines]), where=where)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(key, _baudrate))
class Section:
    """A section of a file, a frozen dataclass. No type is converted when it is read, no unknown key taken."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = {"strict": True, "extra": "forbid"}

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema = handler(source)
        resolved: Any = handler.resolve_ref_schema(schema)
        resolved["strict"] = False  # a table of a file is no instance yet
        return schema

    @classmethod
    @cache
    def adapter(cls) -> TypeAdapter[Self]:
        """Return what checks a table of a file (pydantic's ValidationError), and makes one of a section again."""
        from pydantic import TypeAdapter

        return TypeAdapter(cls)


Parity = Literal["N", "E", "O"]


class DeviceConfig(Section):
    """A device's section. `parity`: how the driver sets a serial port; no key of the file."""

    parity: ClassVar[Parity] = "N"

    @classmethod
    def with_files(cls, given: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
        """Return a section with the content of the files it names in place of their paths, and what is wrong.

        `given` is what the bench file says, not checked yet; `folder`: where relative paths start. A run keeps
        what is returned here, so that it can be decoded without these files.
        """
        return dict(given), []

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield what is wrong between the keys of a section as it was given, by key.

        What a single key may be is for its type to say. `given` is not checked yet: one bad type hides nothing
        else.
        """
        return iter(())


Direction = Literal["east", "west", "north", "south", "up", "down"]
Mounting = Literal["axis_horizontal", "axis_up", "z_up"]
"""How a unit lies on the table: its axis under test level or up, or its own z up whichever axis is under test."""


class AxisConfig(Section):
    """`[[table.axes]]`: one axis of the table, outermost first; the last one carries the unit."""

    name: str = key(
        pattern=r"^[a-z][a-z0-9]{0,15}$", description="a short name, e.g. 'outer', 'middle', 'inner'"
    )
    number: int = key(ge=1, le=9, description="the axis' number on the controller")
    direction: Direction = key(
        description="where the axis points with all axes at 0, positive turns right-handed about it: 'east', "
        "'west', 'north', 'south', 'up' or 'down'"
    )
    max_rate_dps: float | None = key(
        default=None, gt=0, allow_inf_nan=False, description="the highest rate of this axis, deg/s"
    )
    max_acceleration_dps2: float | None = key(
        default=None, gt=0, allow_inf_nan=False, description="the highest acceleration of this axis, deg/s2"
    )
    min_angle_deg: float | None = key(
        default=None, ge=-360, le=360, description="the lower stop of an axis of limited motion, deg"
    )
    max_angle_deg: float | None = key(
        default=None, ge=-360, le=360, description="the upper stop of an axis of limited motion, deg"
    )


class TableConfig(DeviceConfig):
    """`[table]`: the rate table, with `axis` for a table of one axis, up, or `axes`."""

    driver: str = key(description="the kind of table driver")
    port: Port = key(description=_PORT_TEXT)
    baudrate: int = _baudrate(9600)
    axis: int = key(default=1, ge=1, le=9, description="the number of the table axis that carries the unit")
    axes: tuple[AxisConfig, ...] = key(
        default=(),
        max_length=3,
        strict=False,
        exclude_if=lambda axes: not axes,
        description="one to three [[table.axes]], outermost first, with name, number and direction",
    )

    @property
    def all_axes(self) -> tuple[AxisConfig, ...]:
        """The axes, outermost first; a table without `axes` has one, vertical, called 'table'."""
        return self.axes or (AxisConfig(name="table", number=self.axis, direction="up"),)


class ChamberConfig(DeviceConfig):
    """`[chamber]`: the thermal chamber. `auxiliary` maps a sensor's number to what it is glued to."""

    driver: str = key(description="the kind of chamber driver")
    port: Port = key(description=_PORT_TEXT)
    baudrate: int = _baudrate(9600)
    address: int | None = key(
        default=None, ge=0, le=247, description="the chamber's bus address, 0 to 247; left out: 1"
    )
    door_message: str | None = key(
        default=None,
        min_length=3,
        description="part of the alarm or warning the chamber shows while its door is open, e.g. 'door'",
    )
    auxiliary: NumberedTexts = key(
        default_factory=dict,
        description='sensor number (1, 2, ...) = what it is glued to, e.g. {1 = "fog_1 case"}',
    )


class UnderTestConfig(DeviceConfig):
    """A unit under test."""

    name: str = key(
        pattern=_NAME,
        description="a short name of lower-case letters, digits and _ that starts with a letter",
    )
    driver: str = key(description="the kind of driver")
    unit: str = key(min_length=1, description="the serial number or id of the unit under test, as text")


class GyroConfig(UnderTestConfig):
    """`[[gyro]]`: a unit under test, on a serial port (`port`) or a CAN bus (`interface`, `channel`)."""

    axis: Literal["x", "y", "z"] = key(description="the axis under test: 'x', 'y' or 'z'")
    axes: str = key(
        default="x",
        pattern=r"^(x|y|z|xy|xz|yz|xyz)$",
        description="the axes the unit has, in order: 'x', 'xyz', ...",
    )
    port: Port | None = key(default=None, description=_PORT_TEXT)
    baudrate: int = _baudrate(921_600)
    frame_format: str | None = key(
        default=None, min_length=1, description="which of its messages the unit sends"
    )
    description: str | dict[str, Any] | None = key(
        default=None,
        description="a frame description: a name that `gyrobench frames list` shows, or a path to a TOML file",
    )
    settings: dict[str, str] = key(
        default_factory=dict,
        description="how the unit was ordered or set up, e.g. { gyro_output = 'incremental_angle' }: of the "
        "settings that `gyrobench frames check` shows",
    )
    interface: str | None = key(
        default=None,
        min_length=1,
        description="a python-can interface, e.g. 'socketcan' or 'gyrobench_slcan'",
    )
    channel: Port | None = key(
        default=None, description="the CAN channel, e.g. 'can0', or the slcan adapter's port"
    )
    bitrate: int = key(
        default=500_000, ge=10_000, le=1_000_000, description="the CAN bit rate, a whole number of bit/s"
    )
    layout: str | dict[str, Any] | None = key(
        default=None,
        description="a shipped CAN layout's name, or a mapping file's path from the bench file's folder",
    )
    source_address: int | None = key(
        default=None, ge=0, le=253, description="the J1939 address of the unit, 0 to 253; left out: any"
    )
    rate_hz: float = key(
        default=100.0, gt=0, le=20_000, allow_inf_nan=False, description="the sample rate in Hz"
    )
    pulse_interval_s: float = key(
        default=1.0,
        gt=0,
        le=3600,
        allow_inf_nan=False,
        description="seconds from pulse to pulse at the unit's trigger input, where its message tells of them",
    )
    case_sensor: int | None = key(
        default=None, ge=1, description="the number of the chamber's auxiliary sensor on the unit's case"
    )

    reads: ClassVar[frozenset[str]] = frozenset()
    """Which of `description`, `settings`, `layout` and `pulse_interval_s` the driver reads; given to another,
    they are a mistake."""
    only_on_can: ClassVar[bool] = False
    """Whether the driver has no serial port."""

    @property
    def on_can(self) -> bool:
        """Whether the unit is on a CAN bus rather than a serial port."""
        return self.port is None

    @property
    def technology(self) -> Literal["fog", "rlg", "mems"]:
        """What kind of gyro it is, as far as the driver can tell; an emulated unit has such a one's physics."""
        return "fog"

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield keys that say what a unit sends where the driver knows it by itself."""
        driver = f"driver {given.get('driver')!r}"
        if given.get("description") is not None and "description" not in cls.reads:
            yield Mistake("description", "a frame description", "driver = 'frames' with it, or none")
        if given.get("settings") and "settings" not in cls.reads:
            yield Mistake("settings", driver, "settings only of a described gyro")
        if given.get("layout") is not None and "layout" not in cls.reads:
            yield Mistake("layout", driver, "a layout only with driver 'can_dbc'")
        if given.get("pulse_interval_s", 1.0) != 1.0 and "pulse_interval_s" not in cls.reads:
            yield Mistake("pulse_interval_s", driver, "the interval only of a unit that tells of pulses")


class PlatformConfig(UnderTestConfig):
    """`[[platform]]`: a platform INS under test, on a serial port."""

    port: Port = key(description=_PORT_TEXT)
    baudrate: int = _baudrate(38_400)
    period_s: int = key(default=60, ge=1, le=60, description="seconds from sample to sample, whole, 1 to 60")
    longitude_deg: float = key(
        default=0.0,
        ge=-180,
        lt=180,
        allow_inf_nan=False,
        description="the longitude that the platform is given, in degrees, east positive",
    )


class InstrumentConfig(DeviceConfig):
    """An instrument beside table and chamber, read while a run goes on: `[[supply]]`, `[[logger]]`, others."""

    name: str = key(
        pattern=_NAME,
        description="a short name of lower-case letters, digits and _ that starts with a letter",
    )
    driver: str = key(description="the kind of driver")
    port: MeterPort = key(description=_METER_PORT_TEXT)
    baudrate: int = _baudrate(9600)
    period_s: float = key(
        default=1.0, ge=1.0, le=3600.0, description="seconds from reading to reading, 1 to 3600"
    )


class OutputConfig(Section):
    """`[[supply.outputs]]`: one output of a supply, and the units that it feeds."""

    number: int = key(ge=1, le=9, description="the output's number on the supply")
    voltage_v: float = key(gt=0, le=1000, allow_inf_nan=False, description="the voltage, V")
    current_limit_a: float = key(gt=0, le=1000, allow_inf_nan=False, description="the current limit, A")
    units: tuple[str, ...] = key(
        default=(), strict=False, description="names of the units that it feeds, e.g. ['fog_1']"
    )
    safe: Literal["leave", "off"] = key(
        default="leave",
        description="what becomes of it when the bench is made safe: 'leave' (as it is) or 'off'",
    )


class SupplyConfig(InstrumentConfig):
    """`[[supply]]`: a power supply that feeds units under test."""

    outputs: tuple[OutputConfig, ...] = key(
        strict=False,
        description="one or more [[supply.outputs]] with number, voltage_v, current_limit_a and units",
    )
    start_s: float = key(
        default=10.0, ge=0, le=600, description="seconds that its units need from power to their first word"
    )

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield outputs that are named twice, and that there is none."""
        outputs = given.get("outputs")
        if outputs == []:
            yield Mistake("outputs", "an empty list", "one [[supply.outputs]] at least")
        sections = (
            [entry for entry in outputs if isinstance(entry, dict)] if isinstance(outputs, list) else []
        )
        numbers = [section.get("number") for section in sections]
        for place, number in enumerate(numbers):
            if (first := numbers.index(number)) < place:
                expected = f"one of its own (outputs[{first}] has this one)"
                yield Mistake(f"outputs[{place}].number", repr(number), expected)


class LoggerConfig(InstrumentConfig):
    """`[[logger]]`: a temperature logger. `sensors` maps a channel's number to what the sensor is glued to."""

    sensors: NumberedTexts = key(
        min_length=1, description='channel = what its sensor is glued to, e.g. {101 = "fog_1 case"}'
    )
