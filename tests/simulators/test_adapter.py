"""An adapter with a latency timer: bytes keep their order, and none waits longer than the timer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simulators.interfaces import StreamBlock
from simulators.lab._adapter import Adapter


@given(
    steps=st.lists(st.tuples(st.integers(1, 400), st.integers(0, 300)), min_size=1, max_size=12),
    period_ms=st.sampled_from([1, 7, 16, 100]),
)
def test_bytes_come_in_order_at_whole_periods_and_no_later_than_one(steps, period_ms):
    """Steps of some ms in which some bytes are sent, evenly."""
    adapter, sent, got, now_s = Adapter(1e-3 * period_ms), b"", b"", 0.0
    for length_ms, count in steps:
        since_s, now_s = now_s, now_s + 1e-3 * length_ms
        data = bytes((len(sent) + k) % 251 for k in range(count))
        sent += data
        marks = np.array([[count, round(now_s * 1e9)]], np.int64)
        given_over = adapter.block(StreamBlock(data, marks) if count else None, since_s, now_s)
        if given_over is None:
            continue
        got += given_over.data
        at_ms = given_over.marks[:, 1] / 1e6
        assert np.abs(at_ms - period_ms * np.rint(at_ms / period_ms)).max() < 1e-5
        assert (np.diff(given_over.marks, axis=0) > 0).all() and given_over.marks[-1, 0] == len(
            given_over.data
        )
        assert at_ms[-1] <= 1e3 * now_s + 1e-5
    assert sent.startswith(got)
    rest = adapter.block(None, now_s, now_s + 1e-3 * period_ms)
    assert got + (rest.data if rest else b"") == sent


def test_what_streams_behind_an_answer_was_sent_after_it():
    adapter = Adapter(0.1)
    adapter.answered(0.95)
    block = adapter.block(StreamBlock(bytes(50), np.array([[50, 2_000_000_000]], np.int64)), 0.0, 2.0)
    assert block is not None and block.marks[0, 1] == 1_000_000_000 and block.marks[0, 0] == 2
    assert block.marks[-1].tolist() == [50, 2_000_000_000]
