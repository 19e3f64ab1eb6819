"""What a bench file may hold: frozen models, a description for every key (the text an error quotes).

The sections of devices are their drivers' own models (`drivers.kit.config`).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    PrivateAttr,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from bench.record.benchfile._calibration import Calibration
from bench.record.shown import Shown
from drivers.base.constants import earth_rate_north_dph
from drivers.base.errors import ConfigurationError
from drivers.kit.config import (
    ChamberConfig,
    DeviceConfig,
    GyroConfig,
    InstrumentConfig,
    PlatformConfig,
    SupplyConfig,
    TableConfig,
    UnderTestConfig,
)
from drivers.kit.registry import config_class, instrument_roles, roles


def _by_driver(role: str) -> PlainValidator:
    """Have a section checked by the configuration of the driver that it names."""

    def checked(value: Any) -> Any:
        if isinstance(value, roles()[role]):
            return value
        kind = value.get("driver") if isinstance(value, dict) else None
        return config_class(role, kind).adapter().validate_python(value)

    return PlainValidator(checked)


def _plain(section: DeviceConfig, info: SerializationInfo) -> Any:
    mode: Any = info.mode
    return type(section).adapter().dump_python(section, mode=mode, exclude_none=bool(info.exclude_none))


def _of_a_role(value: Any) -> Any:
    """Have an instrument's section, which comes with its role, checked by the driver that it names."""
    if isinstance(value, InstrumentConfig):
        return value
    role, section = value
    kind = section.get("driver") if isinstance(section, dict) else None
    return config_class(role, kind).adapter().validate_python(section)


_PLAIN = PlainSerializer(_plain)
_Table = Annotated[TableConfig, _by_driver("table"), _PLAIN]
_Chamber = Annotated[ChamberConfig, _by_driver("chamber"), _PLAIN]
_Gyro = Annotated[GyroConfig, _by_driver("gyro"), _PLAIN]
_Platform = Annotated[PlatformConfig, _by_driver("platform"), _PLAIN]
_Instrument = Annotated[InstrumentConfig, PlainValidator(_of_a_role), _PLAIN]


class Section(BaseModel):
    """A section of a bench file: frozen, no type is converted, no unknown key, no number that is not finite."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


class Emulated(Section):
    """What stands behind the ports of an emulated lab, so that no run there reads as a real one."""

    seed: int = Field(description="the lab's seed")
    model: str = Field(description="what it emulates, in words")


class BenchSection(Section):
    """`[bench]`: the place."""

    name: str = Field(min_length=1, description="a name for the bench, as text")
    latitude_deg: float = Field(ge=-90, le=90, description="the bench's latitude in degrees, north positive")
    clock: str | None = Field(
        default=None,
        pattern=r"^virtual://(127\.0\.0\.1:[0-9]+)?/.+$",
        description="'virtual:///...', the clock of an emulated lab; leave it out for the wall clock",
    )
    emulated: Emulated | None = Field(
        default=None, description="seed and model of an emulated lab; leave it out for real devices"
    )

    @property
    def earth_rate_north_dph(self) -> float:
        """Horizontal component of the Earth's rate at the bench, deg/h."""
        return earth_rate_north_dph(self.latitude_deg)


class Band(Section):
    """A stretch of a quantity in a rule: above a value, below one, or both."""

    above: float | None = Field(default=None, description="more than this, a number")
    below: float | None = Field(default=None, description="less than this, a number")

    @model_validator(mode="after")
    def _says_something(self) -> Band:
        if self.above is None and self.below is None:
            raise ValueError("neither above nor below")
        return self

    @property
    def arc_deg(self) -> tuple[float, float]:
        """Of angles on a circle: where the band begins, and its width; above 350 and below 10 passes 0.

        One end alone goes on to 0, the end of the turn.
        """
        begin = 0.0 if self.above is None else self.above
        end = 360.0 if self.below is None else self.below
        return begin, (end - begin) % 360.0 or 360.0

    @property
    def text(self) -> str:
        """The band in words."""
        parts = [("above", self.above), ("below", self.below)]
        return " and ".join(f"{word} {value:g}" for word, value in parts if value is not None)


_BAND_TEXT = "{ above = number }, { below = number } or both"


class ForbiddenState(Section):
    """`[[limits.forbid]]`: a state that must not be: all conditions given, together."""

    name: str = Field(min_length=1, description="what is forbidden, in words, e.g. 'spin with the door open'")
    rate_dps: Band | None = Field(
        default=None, description=f"the table's rate in deg/s, without sign: {_BAND_TEXT}"
    )
    angle_deg: Band | None = Field(
        default=None,
        description="the table's angle in deg, on the circle; { above = 350, below = 10 } passes 0: "
        f"{_BAND_TEXT}",
    )
    air_temp_c: Band | None = Field(default=None, description=f"the chamber's air in degC: {_BAND_TEXT}")
    set_point_c: Band | None = Field(
        default=None, description=f"the chamber's set point in degC: {_BAND_TEXT}"
    )
    aux_temp_c: Band | None = Field(
        default=None, description=f"any sensor of chamber or logger besides the air in degC: {_BAND_TEXT}"
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


class LimitsSection(Section):
    """`[limits]`: what nobody may demand of this bench, whatever its devices could do."""

    max_rate_dps: float = Field(default=20.0, gt=0, description="the highest table rate allowed, deg/s")
    min_temp_c: float = Field(default=-60.0, ge=-200, description="the lowest set point allowed, degC")
    max_temp_c: float = Field(default=85.0, le=400, description="the highest set point allowed, degC")
    max_ramp_k_per_min: float = Field(
        default=25.0, gt=0, description="the fastest temperature ramp allowed, K/min"
    )
    overdue: Literal["say", "refuse"] = Field(
        default="say", description="'say' or 'refuse': a run with a [[calibration]] that is overdue"
    )
    forbid: tuple[ForbiddenState, ...] = Field(
        default=(),
        strict=False,
        max_length=100,
        description="[[limits.forbid]]: name, and what must not be true together",
    )


class SafeSection(Section):
    """`[safe]`: where the bench is left when something goes wrong."""

    chamber_set_point_c: float = Field(default=25.0, description="the chamber's set point after a stop, degC")
    watchdog: bool = Field(
        default=True,
        description="true for a process that makes the bench safe if the controller dies; wall clock only",
    )
    last_unit_s: float = Field(
        default=60.0,
        ge=0.0,
        le=3600.0,
        description="seconds that a run goes on when no unit it tests speaks any more, for a cable to come back; "
        "0: the loss of the last unit's port ends it at once",
    )


class RecordingSection(Section):
    """`[recording]`: how soon bytes reach the disk."""

    flush_interval_s: float = Field(
        default=1.0, gt=0, le=1, description="seconds of data that a crash may cost"
    )


class BenchFile(Shown, Section):
    """A bench, as its file describes it. `sha256` is the checksum of the file as it was read.

    `instruments`: sections of every role beside table, chamber and units: `[[supply]]`, `[[logger]]` and those
    that other packages register. In the file they stand beside the others.
    """

    bench: BenchSection = Field(description="a [bench] section with name and latitude_deg")
    table: _Table = Field(description="a [table] section with driver and port")
    chamber: _Chamber = Field(description="a [chamber] section with driver and port")
    gyro: tuple[_Gyro, ...] = Field(
        default=(), strict=False, description="at least one [[gyro]] with name, driver, unit, axis and a port"
    )
    platform: tuple[_Platform, ...] = Field(
        default=(), strict=False, description="[[platform]] with name, driver, unit and a port"
    )
    instruments: dict[str, tuple[_Instrument, ...]] = Field(default_factory=dict)
    limits: LimitsSection = Field(default=LimitsSection(), description="a [limits] section")
    safe: SafeSection = Field(default=SafeSection(), description="a [safe] section")
    recording: RecordingSection = Field(default=RecordingSection(), description="a [recording] section")
    calibration: tuple[Calibration, ...] = Field(
        default=(),
        strict=False,
        description="[[calibration]] with quantity, instrument, certificate, date, due, uncertainty",
    )
    _sha256: str = PrivateAttr(default="")

    @field_validator("calibration")
    @classmethod
    def _one_each(cls, calibrations: tuple[Calibration, ...]) -> tuple[Calibration, ...]:
        if len({item.quantity for item in calibrations}) < len(calibrations):
            raise ValueError("a quantity twice")
        return calibrations

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, data: Any) -> Any:
        """Put the sections of instruments under `instruments`, each with its role."""
        if not isinstance(data, dict):
            return data
        given = {role: data[role] for role in instrument_roles() if role in data}
        pairs = {
            role: tuple((role, section) for section in value) if isinstance(value, list | tuple) else value
            for role, value in given.items()
        }
        rest = {name: value for name, value in data.items() if name not in given}
        return {**rest, "instruments": pairs} if pairs else rest

    @model_serializer(mode="wrap")
    def _spread(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write the sections of instruments beside the others, as they stand in the file."""
        plain: dict[str, Any] = handler(self)
        instruments: dict[str, Any] = plain.pop("instruments", {})
        return plain | instruments

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes this was read from, in hexadecimal."""
        return self._sha256

    def shown(self) -> dict[str, object]:
        """Return the bench, its devices and its units."""
        return {
            "bench": self.bench.name,
            "table": self.table.driver,
            "chamber": self.chamber.driver,
            **{f"{section.name}, {section.driver}": section.unit for section in (*self.gyro, *self.platform)},
        }

    @property
    def units(self) -> dict[str, str]:
        """Name on this bench -> serial number or id of every unit under test."""
        sections: tuple[UnderTestConfig, ...] = (*self.gyro, *self.platform)
        return {section.name: section.unit for section in sections}

    @property
    def all_instruments(self) -> dict[str, tuple[str, InstrumentConfig]]:
        """Name -> role and section of every instrument."""
        roles = self.instruments.items()
        return {section.name: (role, section) for role, sections in roles for section in sections}

    @property
    def supplies(self) -> tuple[SupplyConfig, ...]:
        """The power supplies."""
        return tuple(
            section for _, section in self.all_instruments.values() if isinstance(section, SupplyConfig)
        )

    @property
    def ports(self) -> dict[str, str]:
        """Name of every device on this bench -> its port, or its CAN channel."""
        devices: tuple[PlatformConfig | InstrumentConfig, ...] = (
            *self.platform,
            *(section for _, section in self.all_instruments.values()),
        )
        return (
            {"table": self.table.port, "chamber": self.chamber.port}
            | {gyro.name: gyro.port or gyro.channel or "" for gyro in self.gyro}
            | {device.name: device.port for device in devices}
        )

    def gyro_named(self, name: str | None) -> GyroConfig:
        """Return the gyro of that name, the first for None; ConfigurationError if there is none."""
        for gyro in self.gyro:
            if name in (None, gyro.name):
                return gyro
        raise ConfigurationError(
            "the bench has no such gyro",
            where=self.bench.name,
            found=str(name),
            expected=", ".join(gyro.name for gyro in self.gyro) or "at least one [[gyro]]",
        )
