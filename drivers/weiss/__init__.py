"""Weiss Technik and Vötsch climatic chambers: SimServ and ASCII-2 on TCP port 2049 or RS-232."""

from drivers.kit.kinds import ChamberKind, Probe
from drivers.weiss._ascii2_chamber import Ascii2Chamber
from drivers.weiss._driver import WeissConfig
from drivers.weiss._simserv_chamber import SimServChamber
from drivers.weiss._transcript import decode_transcript

Weiss = ChamberKind(
    lambda config, connection: (SimServChamber if config.simserv else Ascii2Chamber)(config, connection),
    decode_transcript,
    WeissConfig,
    probes=lambda: [Probe(20), Probe(21, keys={"simserv": False})],
)

__all__ = ["Weiss", "WeissConfig"]
