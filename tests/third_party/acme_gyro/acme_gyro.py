"""A driver of somebody else's: ACME GY1, 12 bytes a sample: A5 5A, rate, temperature, counter, sum."""

import numpy as np

from drivers.kit.config import GyroConfig, Mistake, key
from drivers.kit.framing import FrameSplitter
from drivers.kit.instruments import FrameBatch, Identity
from drivers.kit.kinds import GyroKind

FRAME = np.dtype([("sync", ">u2"), ("rate", ">f4"), ("temp", ">i2"), ("counter", ">u2"), ("sum", ">u2")])


def checksum(rows):
    return rows[:, 2:10].sum(axis=1, dtype=np.uint16)


class AcmeConfig(GyroConfig):
    gain: float = key(default=1.0, gt=0, le=8, description="what the unit's output was multiplied by, 0 to 8")

    @classmethod
    def mistakes(cls, given):
        yield from super().mistakes(given)
        if given.get("gain", 1) != 1 and given.get("rate_hz", 100) > 200:
            yield Mistake("gain", str(given["gain"]), "1 above 200 Hz: the unit has no gain there")


class AcmeDecoder:
    counter_modulo, counter_step = 1 << 16, 1.0

    def __init__(self, config):
        self.nominal_rate_hz = config.rate_hz
        self._scale = 1.0 / config.gain
        self._frames = FrameSplitter(
            b"\xa5\x5a", FRAME.itemsize, lambda r: checksum(r) == r.view(FRAME)["sum"][:, 0]
        )
        self.counts = self._frames.counts

    def feed(self, data):
        rows, ends = self._frames.feed(data)
        f = rows.view(FRAME)[:, 0]
        columns = {"counter": f["counter"].astype(np.int64), "rate_dps": f["rate"] * self._scale}
        columns |= {
            "temp_c": f["temp"] * 0.01,
            "valid": np.ones(len(f), bool),
            "status": np.zeros(len(f), np.uint8),
        }
        return FrameBatch(columns, ends)


class AcmeGyro:
    def __init__(self, config, connection):
        self.link = connection.link(config.port, config.baudrate)
        self.stop, self.close = lambda: None, self.link.close

    def identify(self):
        return Identity(
            "ACME", "GY1", details={"heard": self.link.read_exactly(FRAME.itemsize, 5.0).hex(" ")}
        )

    def start(self):
        self.link.streaming = True
        self.link.discard()


AcmeGy1 = GyroKind(
    AcmeGyro,
    AcmeDecoder,
    lambda config, columns, rate_hz: {config.axis: columns["rate_dps"]},
    AcmeConfig,
)
