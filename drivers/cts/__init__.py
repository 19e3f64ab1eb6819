"""CTS (Clima Temperatur Systeme) chambers: ASCII frames on RS-232, or bare commands on TCP port 1080."""

from collections.abc import Iterable

from drivers.cts._driver import CtsChamber, CtsConfig
from drivers.cts._transcript import decode_transcript
from drivers.kit.kinds import ChamberKind, Probe


def _probes() -> Iterable[Probe]:
    """Frames, which a serial device server carries too, then bare commands."""
    return [
        Probe(45, keys={"framed": True}, baudrate=19_200, ends_line=False),
        Probe(46, keys={"framed": False}, baudrate=19_200, ends_line=False),
    ]


Cts = ChamberKind(CtsChamber, decode_transcript, CtsConfig, probes=_probes)

__all__ = ["Cts", "CtsConfig"]
