"""From a bench file to open devices: driver kinds by name, the clock by URL."""

from __future__ import annotations

import importlib
from typing import Any, cast

from bench.record.benchfile import BenchFile, GyroSection, PlatformSection, driver_path
from drivers.base.clock import Clock, WallClock
from drivers.base.virtual_clock import VirtualClock
from drivers.kit.instruments import ChamberKind, GyroKind, PlatformKind, Settings, TableKind


def open_clock(url: str | None) -> Clock:
    """Return the clock of the bench file: an emulated lab's, or the wall clock when there is no URL."""
    return WallClock() if url is None else VirtualClock(url)


def table_kind(file: BenchFile) -> TableKind:
    """Return the table's driver."""
    return cast(TableKind, load_kind("table", file.table.driver))


def chamber_kind(file: BenchFile) -> ChamberKind:
    """Return the chamber's driver."""
    return cast(ChamberKind, load_kind("chamber", file.chamber.driver))


def gyro_kind(section: GyroSection) -> GyroKind:
    """Return a gyro's driver."""
    return cast(GyroKind, load_kind("gyro", section.driver))


def platform_kind(section: PlatformSection) -> PlatformKind:
    """Return a platform INS's driver."""
    return cast(PlatformKind, load_kind("platform", section.driver))


def table_settings(file: BenchFile) -> Settings:
    """Return the table's section as plain values; `axes` is there for a table of one axis, too."""
    axes = [axis.model_dump(mode="json") for axis in file.table.all_axes]
    return {"name": "table", **file.table.model_dump(mode="json"), "axes": axes}


def chamber_settings(file: BenchFile) -> Settings:
    """Return the chamber's section as plain values, with the set point it is left at."""
    safe = {"safe_set_point_c": file.safe.chamber_set_point_c}
    return {"name": "chamber", **file.chamber.model_dump(), **safe}


def gyro_settings(section: GyroSection) -> Settings:
    """Return a gyro's section as plain values."""
    return section.model_dump()


def load_kind(role: str, kind: str) -> Any:
    """Return the driver `kind` of a role, a `TableKind`, `ChamberKind` or `GyroKind`."""
    module, _, attribute = driver_path(role, kind).partition(":")
    return getattr(importlib.import_module(module), attribute)
