"""The ACUTROL3000 as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.acutrol._driver import AcutrolTable
from drivers.acutrol._transcript import decode_transcript
from drivers.kit.config import TableConfig
from drivers.kit.kinds import Connection, Exchange, Probe, TableKind, Transcript


def _open(config: TableConfig, connection: Connection) -> AcutrolTable:
    return AcutrolTable(connection.link(config.port, config.baudrate), axes=_numbers(config))


def _decode(exchanges: Iterable[Exchange], config: TableConfig) -> Transcript:
    return decode_transcript(exchanges, _numbers(config))


def _numbers(config: TableConfig) -> dict[str, int]:
    return {axis.name: axis.number for axis in config.all_axes}


Acutrol3000 = TableKind(_open, _decode, TableConfig, probes=lambda: [Probe(10)])
