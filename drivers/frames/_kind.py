"""A gyro described by a TOML file as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.frames._decode import FrameDecoder, celsius, channels, messages_of
from drivers.frames._driver import FrameGyro
from drivers.frames._form import Form
from drivers.frames._load import FrameFamily, family_from, family_of, is_path, load_toml, shipped
from drivers.frames._model import ACCEL_ROLES
from drivers.frames._units import factor
from drivers.kit.config import GyroConfig, Mistake, key
from drivers.kit.instruments import Gyro
from drivers.kit.kinds import Columns, Connection, GyroKind, Probe


class FramesConfig(GyroConfig):
    """`[[gyro]]` of a unit that a frame description describes; `frame_format` is one of its messages."""

    description: str | dict[str, Any] = key(
        description="a frame description: a name that `gyrobench frames list` shows, or a path to a TOML file",
    )
    reads: ClassVar[frozenset[str]] = frozenset({"description", "settings"})

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


def _open(config: FramesConfig, connection: Connection) -> FrameGyro:
    family = config.family
    line = family.description.link
    link = connection.link(
        config.port, config.baudrate, bytesize=line.bytesize, parity=line.parity, stopbits=line.stopbits
    )
    return FrameGyro(link, family, _decoder(config), baudrate=config.baudrate)


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
    temps = [spec for spec in form.fields if spec.role == "temp"]
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
    _open,
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
