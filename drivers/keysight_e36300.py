"""Keysight E36300 supplies (E36311A to E36313A): SCPI over TCP port 5025, every command with a channel list.

Source: Keysight E36300 Series Programming Guide (E36311-90008). The sessions that the tests replay are those of
pymeasure's KeysightE36312A.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from drivers.base.errors import ProtocolError
from drivers.kit.config import MeterPort, SupplyConfig, key
from drivers.kit.kinds import Connection, Exchange, MeterKind, Probe, Transcript
from drivers.kit.matching import polled
from drivers.kit.places import VISA_EXAMPLE, VISA_RESOURCE
from drivers.kit.scpi import channel_list, flags, numbers, query_exchanges
from drivers.kit.supply import ANY_OUTPUT, ScpiSupply, Setting, columns_of

_TRIPS = {"VOLT": "overvoltage protection has tripped", "CURR": "overcurrent protection has tripped"}


class E36300Config(SupplyConfig):
    """`[[supply]]` of a Keysight E36300: it has no serial line."""

    port: MeterPort = key(
        pattern=rf"^(socket://.+|{VISA_RESOURCE})$",
        description=f"its instrument socket, 'socket://host:5025', or a VISA resource such as '{VISA_EXAMPLE}'",
    )


class E36300Supply(ScpiSupply):
    """One supply (`drivers.kit.instruments.Supply`)."""

    _product = "a Keysight E36300 supply"
    _models = ("E3631",)

    def __init__(self, config: E36300Config, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate), config)

    def is_on(self, output: int) -> bool:
        """Read whether an output is on."""
        return self._query(f"OUTP? (@{output})", lambda reply: flags(reply, 1))[0]

    def _poll(self) -> Sequence[str]:
        return (_poll(self.outputs),)

    def _take_readings(self) -> Mapping[str, float]:
        return self._read(lambda reply: _readings(reply, self.columns))

    def _setting(self, output: int) -> Setting:
        volts = self._query(f"VOLT? (@{output})", lambda reply: numbers(reply, 1))
        amperes = self._query(f"CURR? (@{output})", lambda reply: numbers(reply, 1))
        return Setting(volts[0], amperes[0])

    def _set(self, output: int, setting: Setting) -> str:
        channel = f"(@{output})"
        return f"VOLT {setting.voltage_v:g},{channel}\nCURR {setting.current_limit_a:g},{channel}"

    def _switching(self, output: int, on: bool) -> str:
        return f"OUTP {'ON' if on else 'OFF'},(@{output})"

    def _tripped(self, output: int) -> str:
        for quantity, words in _TRIPS.items():
            if self._query(f"{quantity}:PROT:TRIP? (@{output})", lambda reply: flags(reply, 1))[0]:
                return words
        return ""


def _poll(outputs: Iterable[int]) -> str:
    channels = channel_list(outputs)
    return f"MEAS:VOLT? {channels};:MEAS:CURR? {channels}"


def _readings(reply: str, columns: tuple[str, ...]) -> dict[str, float]:
    parts = reply.split(";")
    if len(parts) != 2:
        raise ProtocolError("not two answers", found=repr(reply[:80]), expected="voltages; currents")
    half = len(columns) // 2
    volts, amperes = (numbers(part, half) for part in parts)
    return dict(
        zip(columns, (value for pair in zip(volts, amperes, strict=True) for value in pair), strict=True)
    )


def decode_transcript(exchanges: Iterable[Exchange], config: E36300Config) -> Transcript:
    """Return one row an answered poll and counts; never raises on bytes."""
    poll, columns = _poll(output.number for output in config.outputs), columns_of(config)
    return polled(
        query_exchanges(exchanges),
        lambda request: request.rpartition("\n")[2] == poll,
        lambda reply: _readings(reply, columns),
        columns,
    )


E36300 = MeterKind(
    E36300Supply, decode_transcript, E36300Config, probes=lambda: [Probe(32, ANY_OUTPUT)], made_safe=True
)
