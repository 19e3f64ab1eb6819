"""Which drivers and emulators there are: entry points of this package and of others, found by role and kind."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint
from typing import Any

from drivers.base.errors import ConfigurationError, one_of
from drivers.base.plugins import entry_points_of
from drivers.kit.config import (
    ChamberConfig,
    DeviceConfig,
    GyroConfig,
    InstrumentConfig,
    LoggerConfig,
    PlatformConfig,
    SupplyConfig,
    TableConfig,
)

DRIVERS = "gyrobench.drivers"
"""The group of drivers: `<role>.<kind>`, a `TableKind`, `ChamberKind`, `GyroKind`, `PlatformKind` or
`MeterKind`."""
EMULATORS = "gyrobench.emulators"
"""The group of their emulators, of the same names: a `simulators.interfaces.EmulatorMaker`."""
INSTRUMENT_ROLES = "gyrobench.roles"
"""The group of further roles: `<role>`, an `InstrumentConfig`; a bench file then has `[[<role>]]`."""
_ROLES: Mapping[str, type[DeviceConfig]] = {
    "table": TableConfig,
    "chamber": ChamberConfig,
    "gyro": GyroConfig,
    "platform": PlatformConfig,
}
_OURS = ("drivers.", "simulators.")


@cache
def instrument_roles() -> Mapping[str, type[InstrumentConfig]]:
    """Return the roles beside table, chamber and units -> the configuration that all their drivers share."""
    points = sorted(entry_points_of(INSTRUMENT_ROLES), key=lambda point: point.name)
    others = {point.name: point.load() for point in points if point.name.isidentifier()}
    return {**others, "supply": SupplyConfig, "logger": LoggerConfig}


@cache
def roles() -> Mapping[str, type[DeviceConfig]]:
    """Return every role -> the configuration that all its drivers share."""
    return {**instrument_roles(), **_ROLES}


def registered(group: str, role: str) -> dict[str, EntryPoint]:
    """Return what is registered for a role, by kind in order of name.

    One of ours cannot be replaced by another package: a bench file means the same on every machine.
    """
    found: dict[str, EntryPoint] = {}
    for point in entry_points_of(group):
        point_role, _, kind = point.name.partition(".")
        if point_role == role and (kind not in found or point.value.startswith(_OURS)):
            found[kind] = point
    return dict(sorted(found.items()))


def load_kind(role: str, kind: str) -> Any:
    """Return the driver `kind` of a role; ConfigurationError with the nearest name if there is none."""
    known = registered(DRIVERS, role)
    if kind not in known:
        raise ConfigurationError(
            f"there is no {role} driver of that kind", found=repr(kind), expected=one_of(kind, known)
        )
    return known[kind].load()


def config_class(role: str, kind: object) -> type[DeviceConfig]:
    """Return the driver's configuration; what its role's drivers share if there is no such driver."""
    point = registered(DRIVERS, role).get(kind) if isinstance(kind, str) else None
    config: type[DeviceConfig] = roles()[role] if point is None else point.load().config
    return config
