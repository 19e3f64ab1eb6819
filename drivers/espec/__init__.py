"""ESPEC chambers with a P-300 or SCP-220 controller, ASCII over RS-232, RS-485 or TCP port 10001."""

from functools import partial

from drivers.espec._driver import EspecChamber, EspecConfig
from drivers.espec._transcript import decode_transcript
from drivers.kit.kinds import ChamberKind, Probe

EspecP300 = ChamberKind(
    partial(EspecChamber, model="P-300", rom="P3"), decode_transcript, EspecConfig, probes=lambda: [Probe(30)]
)
EspecScp220 = ChamberKind(
    partial(EspecChamber, model="SCP-220", rom=""), decode_transcript, EspecConfig, probes=lambda: [Probe(31)]
)

__all__ = ["EspecConfig", "EspecP300", "EspecScp220"]
