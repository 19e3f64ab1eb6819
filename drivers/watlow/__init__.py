"""Chambers with a Watlow F4 (Modbus RTU) or F4T (Modbus TCP or RTU) controller."""

from drivers.kit.kinds import ChamberKind, Probe
from drivers.watlow._driver import F4Chamber, F4Config, F4TChamber, F4TConfig
from drivers.watlow._transcript import decode_f4, decode_f4t


def _f4_probes() -> list[Probe]:
    return [Probe(50, baudrate=baud, ends_line=False) for baud in (19_200, 9600)]


WatlowF4 = ChamberKind(F4Chamber, decode_f4, F4Config, probes=_f4_probes)
WatlowF4T = ChamberKind(
    F4TChamber, decode_f4t, F4TConfig, probes=lambda: [Probe(51, baudrate=9600, ends_line=False)]
)

__all__ = ["F4Config", "F4TConfig", "WatlowF4", "WatlowF4T"]
