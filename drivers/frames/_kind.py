"""A gyro described by a TOML file as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.base.errors import ConfigurationError
from drivers.frames._decode import FrameDecoder, celsius, channels, messages_of
from drivers.frames._driver import FrameGyro
from drivers.frames._form import Form
from drivers.frames._load import FrameFamily, family_of
from drivers.frames._model import ACCEL_ROLES
from drivers.frames._units import factor
from drivers.kit.instruments import GyroKind, Settings
from drivers.kit.link import Link, Tap

Columns = Mapping[str, NDArray[Any]]


def family_in(settings: Settings) -> FrameFamily:
    """Return the description that a gyro's section names; ConfigurationError if it names none."""
    description = settings.get("description")
    if description is None:
        raise ConfigurationError(
            "this driver needs a frame description",
            where=str(settings.get("name", "")),
            found="no description",
            expected='description = "stim300" or another name that `gyrobench frames list` shows, or a TOML file',
        )
    return family_of(description, settings.get("settings"))


def _open(settings: Settings, clock: Clock, tap: Tap) -> FrameGyro:
    family = family_in(settings)
    line = family.description.link
    link = Link(
        settings["port"],
        clock,
        name=settings["name"],
        tap=tap,
        baudrate=settings["baudrate"],
        bytesize=line.bytesize,
        parity=line.parity,
        stopbits=line.stopbits,
    )
    return FrameGyro(link, family, _decoder(settings), baudrate=settings["baudrate"])


def _decoder(settings: Settings) -> FrameDecoder:
    return FrameDecoder(
        family_in(settings),
        rate_hz=settings["rate_hz"],
        axes=settings["axes"],
        axis=settings["axis"],
        message=settings.get("frame_format"),
    )


def _form_of(family: FrameFamily, settings: Settings, columns: Columns) -> Form:
    """Return the message that `columns` came from."""
    if named := messages_of(family, settings.get("frame_format")):
        return named[0]
    kept = {
        form.name: set(channels(family, form, settings["axes"]).values())
        | {spec.name for spec in form.fields if spec.role in (*ACCEL_ROLES, "temp", "case_temp")}
        for form in family.forms
        if form.measures
    }
    fits = {name: len(names) for name, names in kept.items() if names <= set(columns)}
    return family.form(max(fits, key=lambda name: fits[name]))


def _rates(settings: Settings, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    family = family_in(settings)
    form = _form_of(family, settings, columns)
    by_name = {spec.name: spec for spec in form.fields}
    rates = {}
    for axis, name in channels(family, form, settings["axes"]).items():
        spec = by_name[name]
        scale = factor(spec.unit) * (1.0 if spec.role == "rate" else sample_rate_hz)
        with np.errstate(invalid="ignore", over="ignore"):
            rates[axis] = np.multiply(columns[name], scale, dtype=np.float64)
    return rates


def _accelerations(settings: Settings, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    family = family_in(settings)
    found: dict[str, NDArray[Any]] = {}
    for spec in _form_of(family, settings, columns).fields:
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


def _temperatures(settings: Settings, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    """Return `case_temp_c`, and `<field>_c` of every sensor where the frame carries more than one."""
    form = _form_of(family_in(settings), settings, columns)
    temps = [spec for spec in form.fields if spec.role == "temp"]
    found = {f"{spec.name}_c": celsius(spec, columns) for spec in temps} if len(temps) > 1 else {}
    found |= {name: columns[name] for name in ("case_temp_c",) if name in columns}
    return found


Frames = GyroKind(
    open=_open, decoder=_decoder, rates=_rates, accelerations=_accelerations, temperatures=_temperatures
)
"""Settings used: `name`, `port`, `baudrate`, `rate_hz`, `axes`, `axis`, `description`,
`settings`, `frame_format`."""
