"""From a bench file to open devices: driver kinds by name, the clock by URL."""

from __future__ import annotations

from typing import Any

from bench.record.benchfile import BenchFile
from drivers.base.clock import Clock, WallClock
from drivers.base.virtual_clock import VirtualClock
from drivers.kit.instruments import Chamber, Meter, Turntable
from drivers.kit.kinds import ChamberKind, Connection, MeterKind, TableKind
from drivers.kit.link import Tap
from drivers.kit.registry import load_kind


def open_clock(url: str | None) -> Clock:
    """Return the clock of the bench file: an emulated lab's, or the wall clock when there is no URL."""
    return WallClock() if url is None else VirtualClock(url)


def open_table(file: BenchFile, clock: Clock, tap: Tap | None) -> Turntable:
    """Open the table's port."""
    kind: TableKind[Any] = load_kind("table", file.table.driver)
    return kind.open(file.table, Connection("table", clock, tap))


def open_chamber(file: BenchFile, clock: Clock, tap: Tap | None) -> Chamber:
    """Open the chamber's port."""
    connection = Connection("chamber", clock, tap, safe_set_point_c=file.safe.chamber_set_point_c)
    kind: ChamberKind[Any] = load_kind("chamber", file.chamber.driver)
    return kind.open(file.chamber, connection)


def open_instrument(file: BenchFile, name: str, clock: Clock, tap: Tap | None) -> Meter:
    """Open the port of a supply, a logger or an instrument of another role."""
    role, section = file.all_instruments[name]
    kind: MeterKind[Any] = load_kind(role, section.driver)
    return kind.open(section, Connection(name, clock, tap))


def made_safe(file: BenchFile) -> list[str]:
    """Return the names of the instruments that have a safe state of their own, in the file's order."""
    return [
        name
        for name, (role, section) in file.all_instruments.items()
        if load_kind(role, section.driver).made_safe
    ]
