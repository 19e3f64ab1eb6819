"""From a bench file to open devices: driver kinds by name, the clock by URL."""

from __future__ import annotations

from typing import Any

from bench.record.benchfile import BenchFile
from drivers.base.clock import Clock, WallClock
from drivers.base.virtual_clock import VirtualClock
from drivers.kit.instruments import Chamber, Turntable
from drivers.kit.kinds import ChamberKind, Connection, TableKind
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
