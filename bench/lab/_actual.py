"""Devices of an emulated lab that are set otherwise than the bench file says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from bench.record.benchfile import BenchFile
from drivers.base.errors import ConfigurationError, one_of
from drivers.kit.config import DeviceConfig
from drivers.kit.places import is_serial
from simulators.config import SerialFormat

_D = TypeVar("_D", bound=DeviceConfig)
_FORMAT = ("bytesize", "parity", "stopbits")


def refuse_strangers(file: BenchFile, said: Mapping[str, Iterable[str]]) -> None:
    """Raise ConfigurationError if a plant file says something of a gyro that the bench has not.

    `said`: key of the plant file -> the gyros' names that it has.
    """
    gyros = [gyro.name for gyro in file.gyro]
    for key, names in said.items():
        for name in names:
            if name not in gyros:
                raise ConfigurationError(
                    "the bench has no such gyro",
                    where=f"plant file, {key}",
                    found=name,
                    expected=one_of(name, gyros),
                )


def as_they_are(
    file: BenchFile, actual: Mapping[str, Mapping[str, Any]]
) -> tuple[BenchFile, dict[str, SerialFormat]]:
    """Return a bench file with the settings that devices really have, and how their serial lines are set.

    `actual`: port name -> keys. ConfigurationError for a port or key that there is not.
    """
    sections: dict[str, Any] = {"table": file.table, "chamber": file.chamber}
    sections |= {gyro.name: gyro for gyro in file.gyro}
    sections |= {platform.name: platform for platform in file.platform}
    sections |= {name: section for name, (_, section) in file.all_instruments.items()}
    if unknown := sorted(set(actual) - set(sections)):
        raise ConfigurationError(
            "the emulated lab has no such port",
            where="actual",
            found=", ".join(unknown),
            expected="one of " + ", ".join(sections),
        )

    def real(section: _D, name: str) -> _D:
        keys = {key: value for key, value in actual.get(name, {}).items() if key not in _FORMAT}
        try:
            return type(section).adapter().validate_python({**vars(section), **keys}) if keys else section
        except ValidationError as error:
            raise _unusable(name, error) from error

    changed = file.model_copy(
        update={
            "table": real(file.table, "table"),
            "chamber": real(file.chamber, "chamber"),
            "gyro": tuple(real(gyro, gyro.name) for gyro in file.gyro),
            "platform": tuple(real(platform, platform.name) for platform in file.platform),
            "instruments": {
                role: tuple(real(section, section.name) for section in sections)
                for role, sections in file.instruments.items()
            },
        }
    )
    lines = {
        name: _format(name, real(sections[name], name), actual[name])
        for name in actual
        if sections[name].port is not None and is_serial(sections[name].port)
    }
    return changed, lines


def _format(name: str, section: Any, keys: Mapping[str, Any]) -> SerialFormat:
    usual = {"baudrate": section.baudrate, "parity": section.parity}
    given = {key: value for key, value in keys.items() if key in _FORMAT}
    try:
        return TypeAdapter(SerialFormat).validate_python(usual | given)
    except ValidationError as error:
        raise _unusable(name, error) from error


def _unusable(name: str, error: ValidationError) -> ConfigurationError:
    return ConfigurationError(
        "what a device really has cannot be used",
        where=f"actual.{name}",
        found=str(error),
        expected="keys of its section in the bench file, bytesize, parity or stopbits",
    )
