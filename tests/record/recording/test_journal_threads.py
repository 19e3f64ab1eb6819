"""The journal with a stream's reader thread on one side and the writer on the other: no byte twice, none lost."""

import sys
import threading

import numpy as np
import pytest

from bench.record.recording import PortJournal

pytestmark = pytest.mark.concurrent

_BLOCKS = 60_000


def test_bytes_added_while_others_are_written_arrive_once_and_in_order(tmp_path):
    port = PortJournal(tmp_path, "gyro")
    sizes = 1 + 37 * np.arange(_BLOCKS) % 400
    ends = np.cumsum(sizes)
    stream = np.random.default_rng(7).integers(0, 256, ends[-1], np.uint8).tobytes()
    failures = []

    def read():
        try:
            for k, (size, end) in enumerate(zip(sizes.tolist(), ends.tolist(), strict=True), start=1):
                port.received(stream[end - size : end], k * 1e-3)
        except BaseException as error:
            failures.append(error)

    switch = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads change places as often as the interpreter can
    try:
        reader = threading.Thread(target=read)
        reader.start()
        flushes = 0
        while reader.is_alive():
            port.flush(sync=False)
            flushes += 1
        reader.join()
    finally:
        sys.setswitchinterval(switch)
    port.flush(sync=False)
    assert not failures
    assert flushes > 10
    assert (tmp_path / "raw" / "gyro.bin").read_bytes() == stream
    marks = np.fromfile(tmp_path / "raw" / "gyro.idx", "<i8").reshape(-1, 2)
    assert np.array_equal(marks[:, 0], ends)
    assert np.array_equal(marks[:, 1], 1_000_000 * np.arange(1, _BLOCKS + 1))
