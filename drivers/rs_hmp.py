"""Rohde & Schwarz (Hameg) HMP supplies: SCPI over TCP port 5025 or RS-232; an output is selected, then spoken to.

Source: R&S HMP Series SCPI Programmers Manual (5800.5760.02). The sessions that the tests replay are those of
pymeasure's HMP4040. An output gives power when it is selected (OUTP:SEL) and the main switch (OUTP:GEN) is on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TypeVar

from drivers.base.errors import ProtocolError
from drivers.kit.config import SupplyConfig
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Connection, Exchange, MeterKind, Probe, Transcript
from drivers.kit.matching import transcript
from drivers.kit.retry import query_with_retry
from drivers.kit.scpi import flags, numbers, query_exchanges
from drivers.kit.supply import ANY_OUTPUT, ScpiSupply, Setting, columns_of

_T = TypeVar("_T")
_TRIPS = {"VOLT:PROT:TRIP?": "overvoltage protection has tripped", "FUSE:TRIP?": "its fuse has tripped"}


class HmpConfig(SupplyConfig):
    """`[[supply]]` of an HMP."""


class HmpSupply(ScpiSupply):
    """One supply (`drivers.kit.instruments.Supply`)."""

    _product = "a Rohde & Schwarz HMP supply"
    _models = ("HMP",)

    def __init__(self, config: HmpConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate), config)
        self._count = max(self.outputs)

    def _introduction(self) -> Identity:
        identity = super()._introduction()
        self._count = int(identity.model[5]) if identity.model[5:6].isdecimal() else self._count
        return identity

    def prepare(self) -> None:
        """Set the outputs; if the main switch is off, deselect all and close it: it must not switch others on."""
        super().prepare()
        if not self._query("OUTP:GEN?", lambda reply: flags(reply, 1))[0]:
            for output in range(1, self._count + 1):
                self._tell(f"INST:NSEL {output}\nOUTP:SEL 0")
            self._tell("OUTP:GEN 1")

    def is_on(self, output: int) -> bool:
        """Read whether an output is selected and the main switch is on."""
        selected = self._of(output, "OUTP:SEL?", lambda reply: flags(reply, 1))[0]
        return selected and self._query("OUTP:GEN?", lambda reply: flags(reply, 1))[0]

    def _poll(self) -> Sequence[str]:
        questions = ("MEAS:VOLT?", "MEAS:CURR?")
        return [line for output in self.outputs for line in (f"INST:NSEL {output}", *questions)]

    def _take_readings(self) -> Mapping[str, float]:
        return {name: self._read(lambda reply: numbers(reply, 1))[0] for name in self.columns}

    def _setting(self, output: int) -> Setting:
        volts = self._of(output, "VOLT?", lambda reply: numbers(reply, 1))
        amperes = self._of(output, "CURR?", lambda reply: numbers(reply, 1))
        return Setting(volts[0], amperes[0])

    def _set(self, output: int, setting: Setting) -> str:
        return f"INST:NSEL {output}\nVOLT {setting.voltage_v:.3f}\nCURR {setting.current_limit_a:.4f}"

    def _switching(self, output: int, on: bool) -> str:
        return f"INST:NSEL {output}\nOUTP:SEL {int(on)}" + ("\nOUTP:GEN 1" if on else "")

    def _tripped(self, output: int) -> str:
        for query, words in _TRIPS.items():
            if self._of(output, query, lambda reply: flags(reply, 1))[0]:
                return words
        return ""

    def _of(self, output: int, query: str, read: Callable[[str], list[_T]]) -> list[_T]:
        """Ask something of an output: selected with every question, since the panel selects, too."""

        def ask() -> list[_T]:
            self._settle_input()
            self._write(f"INST:NSEL {output}", query)
            return self._read(read)

        return query_with_retry(self.link, ask)


def decode_transcript(exchanges: Iterable[Exchange], config: HmpConfig) -> Transcript:
    """Return one row a whole poll and counts; never raises on bytes."""
    columns = columns_of(config)
    rows: list[tuple[int, dict[str, float]]] = []
    row: dict[str, float] = {}
    polls, output = 0, 0
    for at_ns, request, reply in query_exchanges(exchanges):
        *before, query = request.split("\n")
        output = next(
            (
                int(line.removeprefix("INST:NSEL ") or 0)
                for line in reversed(before)
                if line.startswith("INST:NSEL ")
            ),
            output,
        )
        quantity = {"MEAS:VOLT?": "voltage_v", "MEAS:CURR?": "current_a"}.get(query)
        name = f"output_{output}_{quantity}"
        if name not in columns:
            continue
        if name == columns[0]:
            polls, row = polls + 1, {}
        with suppress(ProtocolError):
            row[name] = numbers(reply or "", 1)[0]
        if name == columns[-1] and len(row) == len(columns) and all(map(math.isfinite, row.values())):
            rows.append((at_ns, row))
    return transcript(rows, columns, polls)


Hmp = MeterKind(
    HmpSupply, decode_transcript, HmpConfig, probes=lambda: [Probe(33, ANY_OUTPUT)], made_safe=True
)
