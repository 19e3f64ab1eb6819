"""Which drivers and emulators there are: entry points of this package and of others, found by role and kind."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint
from typing import Any

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of
from drivers.kit.config import ChamberConfig, DeviceConfig, GyroConfig, PlatformConfig, TableConfig

DRIVERS = "gyrobench.drivers"
"""The group of drivers: `<role>.<kind>`, a `TableKind`, `ChamberKind`, `GyroKind` or `PlatformKind`."""
EMULATORS = "gyrobench.emulators"
"""The group of their emulators, of the same names: a `simulators.interfaces.EmulatorMaker`."""
ROLES: Mapping[str, type[DeviceConfig]] = {
    "table": TableConfig,
    "chamber": ChamberConfig,
    "gyro": GyroConfig,
    "platform": PlatformConfig,
}
"""Role -> the configuration that all its drivers share."""
_OURS = ("drivers.", "simulators.")


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
    config: type[DeviceConfig] = ROLES[role] if point is None else point.load().config
    return config


def one_of(found: str, names: Iterable[str]) -> str:
    """Return "one of a, b, c", with the nearest to `found` pointed out."""
    names = sorted(names)
    near = difflib.get_close_matches(found, names, n=1)
    suggestion = f" (did you mean {near[0]!r}?)" if near else ""
    return f"{'one of ' if len(names) > 1 else ''}{', '.join(names)}{suggestion}"
