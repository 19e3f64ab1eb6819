"""Its emulator, so that `gyrobench rehearse` works without the unit: what it sends of what the plant measures."""

import numpy as np
from acme_gyro import FRAME, checksum

from simulators.faults import WireShape
from simulators.interfaces import StreamBlock


class AcmeEmulator:
    wire = WireShape(frame_bytes=FRAME.itemsize, check_bytes=2)

    def __init__(self, config, plant, installed):
        self._plant, self._period_s, self._sent = plant, 1.0 / config.rate_hz, 0
        self._gain = config.gain

    def receive(self, data, now_s):
        return []

    def stream(self, until_s):
        count = int(until_s / self._period_s + 1e-6) - self._sent
        if count <= 0:
            return None
        signal = self._plant.measure(self._sent * self._period_s, count, self._period_s)
        numbers = self._sent + np.arange(count)
        self._sent += count
        frames = np.zeros(count, FRAME)
        frames["sync"], frames["counter"] = 0xA55A, numbers % 65536
        frames["rate"] = self._gain * np.degrees(signal.angle_increment_rad[:, 0]) / self._period_s
        frames["temp"] = np.rint(signal.temp_c * 100.0)
        frames["sum"] = checksum(frames.view(np.uint8).reshape(count, FRAME.itemsize))
        ends = np.arange(1, count + 1)
        marks = np.column_stack((ends * FRAME.itemsize, np.rint((numbers + 1) * self._period_s * 1e9)))
        return StreamBlock(frames.tobytes(), marks.astype(np.int64))
