"""Thermotron chambers with an 8200, 8800 or 3800 controller, ASCII over RS-232, RS-485 or TCP port 8888."""

from drivers.kit.kinds import ChamberKind, Probe
from drivers.thermotron._driver import ThermotronChamber, ThermotronConfig
from drivers.thermotron._transcript import decode_transcript

Thermotron8200 = ChamberKind(
    ThermotronChamber,
    decode_transcript,
    ThermotronConfig,
    probes=lambda: [
        Probe(32, keys={"controller": name}, name=f"controller {name}") for name in ("8800", "8200", "3800")
    ],
)

__all__ = ["Thermotron8200", "ThermotronConfig"]
