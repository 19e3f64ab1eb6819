"""A gyro described by a TOML file as the bench finds it by name: listened to, and checked to be that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.frames._decode import FrameDecoder, celsius, channels, messages_of, reader_of
from drivers.frames._form import Form
from drivers.frames._load import FrameFamily, family_from, family_of, is_path, load_toml, shipped
from drivers.frames._model import ACCEL_ROLES
from drivers.frames._units import factor
from drivers.kit.config import GyroConfig, Mistake, key
from drivers.kit.conversation import StreamingGyro
from drivers.kit.instruments import Gyro, Identity
from drivers.kit.kinds import Columns, Connection, GyroKind, Probe

_LISTEN_S = 5.0
_ENOUGH = 2
_KEPT = 8192
"""Bytes kept to say what was heard instead."""


class FramesConfig(GyroConfig):
    """`[[gyro]]` of a unit that a frame description describes; `frame_format` is one of its messages."""

    description: str | dict[str, Any] = key(
        description="a frame description: a name that `gyrobench frames list` shows, or a path to a TOML file",
    )
    reads: ClassVar[frozenset[str]] = frozenset({"description", "settings", "pulse_interval_s"})

    @property
    def technology(self) -> Literal["fog", "rlg", "mems"]:
        """A unit of several axes is usually a MEMS unit."""
        return "mems" if len(self.axes) > 1 else "fog"

    @property
    def family(self) -> FrameFamily:
        """The description with the settings chosen."""
        return family_of(self.description, self.settings)

    @classmethod
    def with_files(cls, given: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
        """Read the description in; without `baudrate` or `rate_hz` the unit gets its description's.

        ConfigurationError for a description that cannot be used.
        """
        description, settings = given.get("description"), given.get("settings", {})
        if not isinstance(settings, dict) or not all(isinstance(words, str) for words in settings.values()):
            return dict(given), []  # its type says what is wrong with it
        if not isinstance(description, (str, dict)):
            return dict(given), []
        if isinstance(description, str) and is_path(description):
            path = folder / description
            description = load_toml(path)
            family = family_from(description, str(path), settings)
        else:
            family = family_of(description, settings)
        link, axes = family.description.link, given.get("axes", "x")
        if isinstance(axes, str) and axes and set(axes) <= set("xyz"):
            message = given.get("frame_format")
            FrameDecoder(family, rate_hz=link.nominal_rate_hz, axes=axes, message=message)
        usual = {"baudrate": link.baud, "rate_hz": link.nominal_rate_hz}
        return {**usual, **given, "description": description}, []


def bits_a_byte(family: FrameFamily) -> int:
    """Return the bits on the line for each byte: start, data, parity, stop."""
    link = family.description.link
    return 1 + link.bytesize + (link.parity != "N") + link.stopbits


class FrameGyro(StreamingGyro):
    """A gyro on a serial port (`drivers.kit.instruments.Gyro`) that sends `rate_hz` frames a second, unasked."""

    def __init__(self, config: FramesConfig, connection: Connection) -> None:
        """Raise ConfigurationError for a frame rate that the line cannot carry."""
        self._family = family = config.family
        line = family.description.link
        link = connection.link(
            config.port, config.baudrate, bytesize=line.bytesize, parity=line.parity, stopbits=line.stopbits
        )
        super().__init__(link)
        self._decoder = _decoder(config)
        length = min(form.shortest for form in family.forms if form.measures)
        most_hz = config.baudrate / (length * bits_a_byte(family))
        if config.rate_hz > most_hz:
            raise ConfigurationError(
                "the line cannot carry that many frames",
                where=link.where,
                found=f"{config.rate_hz:g} Hz of {length} bytes at {config.baudrate} Bd",
                expected=f"at most {most_hz:.0f} Hz",
                remedy="correct rate_hz or baudrate in the bench file",
            )

    def identify(self) -> Identity:
        """Listen for two sound frames with rates, at most 5 s and two frame times.

        Raises DeviceSilent when nothing came, WrongDevice when what came are not such frames.
        """
        description, decoder, heard, frames = self._family.description, self._decoder, b"", 0
        limit_s = _LISTEN_S + _ENOUGH / decoder.nominal_rate_hz
        deadline_s = self.link.clock.now() + limit_s
        while frames < _ENOUGH and (left_s := deadline_s - self.link.clock.now()) > 0.0:
            data = self.link.read_some(left_s)
            heard = (heard + data)[:_KEPT]
            frames += len(decoder.feed(data))
        where = self.link.where
        if not heard:
            raise DeviceSilent(
                f"no byte within {limit_s:g} s",
                where=where,
                found="nothing",
                expected=f"frames of {description.title}",
                remedy=f"check power, cable and port{self.link.set_alike}",
            )
        if frames < _ENOUGH:
            everything = reader_of(self._family)
            everything.feed(heard)
            others = ", ".join(name for name, n in everything.by_form.items() if n)
            raise WrongDevice(
                f"what sends on this port is not {description.title}"
                + (f" with the message {decoder.expected}" if others else ""),
                where=where,
                found=f"messages {others}" if others else heard[:60].hex(" "),
                expected=_beginnings(self._family),
                remedy="check port, description and frame_format in the bench file" + self.link.set_alike,
            )
        messages = ", ".join(name for name, n in decoder.by_message.items() if n)
        return Identity(
            description.maker, description.model or description.title, details={"messages": messages}
        )


def _beginnings(family: FrameFamily) -> str:
    forms = [form for form in family.forms if form.measures]
    heads = ", ".join(sorted({sync.hex(" ") for form in forms for sync in form.syncs})[:6])
    return f"frames that begin with {heads} and carry a right check"


def _decoder(config: FramesConfig) -> FrameDecoder:
    return FrameDecoder(
        config.family,
        rate_hz=config.rate_hz,
        axes=config.axes,
        axis=config.axis,
        message=config.frame_format,
    )


def _form_of(family: FrameFamily, config: FramesConfig, columns: Columns) -> Form:
    """Return the message that `columns` came from."""
    if named := messages_of(family, config.frame_format):
        return named[0]
    kept = {
        form.name: set(channels(family, form, config.axes).values())
        | {spec.name for spec in form.fields if spec.role in (*ACCEL_ROLES, "temp", "case_temp")}
        for form in family.forms
        if form.measures
    }
    fits = {name: len(names) for name, names in kept.items() if names <= set(columns)}
    return family.form(max(fits, key=lambda name: fits[name]))


def _rates(config: FramesConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    family = config.family
    form = _form_of(family, config, columns)
    by_name = {spec.name: spec for spec in form.fields}
    rates = {}
    for axis, name in channels(family, form, config.axes).items():
        spec = by_name[name]
        scale = factor(spec.unit) * (1.0 if spec.role == "rate" else sample_rate_hz)
        with np.errstate(invalid="ignore", over="ignore"):
            rates[axis] = np.multiply(columns[name], scale, dtype=np.float64)
    return rates


def _accelerations(config: FramesConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    family = config.family
    found: dict[str, NDArray[Any]] = {}
    for spec in _form_of(family, config, columns).fields:
        if (
            spec.role in ACCEL_ROLES
            and spec.axis is not None
            and spec.axis not in found
            and spec.name in columns
        ):
            scale = factor(spec.unit) * (1.0 if spec.role == "accel" else sample_rate_hz)
            with np.errstate(invalid="ignore", over="ignore"):
                found[spec.axis] = columns[spec.name] * scale
    return found


def _temperatures(config: FramesConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    """Return `case_temp_c`, and `<field>_c` of every sensor where the frame carries more than one."""
    form = _form_of(config.family, config, columns)
    temps = [spec for spec in form.fields if spec.role == "temp" and spec.name in columns]
    found = {f"{spec.name}_c": celsius(spec, columns) for spec in temps} if len(temps) > 1 else {}
    found |= {name: columns[name] for name in ("case_temp_c",) if name in columns}
    return found


def _probes() -> list[Probe]:
    return [
        Probe(30, keys={"description": name, "axis": axis, "axes": axis}, name=name)
        for name in shipped()
        for axis in "xz"
    ]


Frames = GyroKind(
    FrameGyro,
    _decoder,
    _rates,
    FramesConfig,
    accelerations=_accelerations,
    temperatures=_temperatures,
    probes=_probes,
)


Described = TypeVar("Described", bound=GyroConfig)


def kind_as_described(
    config_class: type[Described],
    described: Callable[[Described], FramesConfig],
    open_gyro: Callable[[Described, Connection], Gyro],
    probes: Callable[[], Iterable[Probe]] = tuple,
) -> GyroKind[Described]:
    """Return the kind of a gyro with a name of its own whose stream is that of a `described` one."""
    return GyroKind(
        open_gyro,
        lambda config: _decoder(described(config)),
        lambda config, columns, rate_hz: _rates(described(config), columns, rate_hz),
        config_class,
        accelerations=lambda config, columns, rate_hz: _accelerations(described(config), columns, rate_hz),
        temperatures=lambda config, columns, rate_hz: _temperatures(described(config), columns, rate_hz),
        probes=probes,
    )
