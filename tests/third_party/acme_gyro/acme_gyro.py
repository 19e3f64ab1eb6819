"""A driver of somebody else's: ACME GY1, 12 bytes a sample: A5 5A, rate, temperature, counter, sum."""

import numpy as np

from drivers.kit.framing import FrameSplitter
from drivers.kit.instruments import FrameBatch, GyroKind, Identity
from drivers.kit.link import Link

FRAME = np.dtype([("sync", ">u2"), ("rate", ">f4"), ("temp", ">i2"), ("counter", ">u2"), ("sum", ">u2")])


def checksum(rows):
    return rows[:, 2:10].sum(axis=1, dtype=np.uint16)


class AcmeDecoder:
    counter_modulo, counter_step = 1 << 16, 1.0

    def __init__(self, settings):
        self.nominal_rate_hz = settings["rate_hz"]
        self._frames = FrameSplitter(
            b"\xa5\x5a", FRAME.itemsize, lambda r: checksum(r) == r.view(FRAME)["sum"][:, 0]
        )
        self.counts = self._frames.counts

    def feed(self, data):
        rows, ends = self._frames.feed(data)
        f = rows.view(FRAME)[:, 0]
        columns = {"counter": f["counter"].astype(np.int64), "rate_dps": f["rate"].astype(np.float64)}
        columns |= {
            "temp_c": f["temp"] * 0.01,
            "valid": np.ones(len(f), bool),
            "status": np.zeros(len(f), np.uint8),
        }
        return FrameBatch(columns, ends)


class AcmeGyro:
    def __init__(self, settings, clock, tap):
        self.link = Link(
            settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"]
        )
        self.stop, self.close = lambda: None, self.link.close

    def identify(self):
        return Identity(
            "ACME", "GY1", details={"heard": self.link.read_exactly(FRAME.itemsize, 5.0).hex(" ")}
        )

    def start(self):
        self.link.streaming = True
        self.link.discard()


AcmeGy1 = GyroKind(
    AcmeGyro, AcmeDecoder, lambda settings, columns, rate_hz: {settings["axis"]: columns["rate_dps"]}
)
