"""The ring of recent telemetry against a plain list."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.control.history import History

pytestmark = pytest.mark.concurrent


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.floats(0.0, 10.0), max_size=30),
    capacity=st.integers(1, 8),
    start=st.floats(-1.0, 120.0),
)
def test_the_last_rows_come_back_oldest_first(steps, capacity, start):
    history, rows = History(("value",), capacity), []
    time_s = 0.0
    for k, step in enumerate(steps):
        time_s += step
        history.append(time_s, float(k))
        rows.append((time_s, float(k)))
    kept = rows[-capacity:]
    assert len(history) == len(kept)
    assert history.last == (dict(zip(("time_s", "value"), kept[-1], strict=True)) if kept else {})
    found = history.since(start)
    assert list(zip(found["time_s"], found["value"], strict=True)) == [row for row in kept if row[0] >= start]


def test_what_is_read_does_not_change_afterwards():
    history = History(("value",), 4)
    for k in range(4):
        history.append(float(k), float(k))
    found = history.since(0.0)
    history.append(4.0, 99.0)
    assert found["value"].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_reading_while_a_thread_appends_gives_rows_in_order():
    history = History(("value",), 64)
    done = threading.Event()

    def append():
        for k in range(30_000):
            history.append(float(k), float(k))
        done.set()

    thread = threading.Thread(target=append)
    thread.start()
    while not done.is_set():
        rows = history.since(-1.0)
        assert np.array_equal(rows["time_s"], rows["value"])
        assert np.all(np.diff(rows["time_s"]) == 1.0)
    thread.join()


@given(st.lists(st.integers(0, 9), max_size=8), st.integers(1, 7))
def test_rows_in_blocks_are_rows_one_by_one(blocks, capacity):
    one, many, time_s = History(("value",), capacity), History(("value",), capacity), 0.0
    for size in blocks:
        rows = np.array([[time_s + k, 10.0 * (time_s + k)] for k in range(size)]).reshape(-1, 2)
        many.extend(rows)
        for row in rows:
            one.append(*row)
        time_s += size
    assert len(one) == len(many) and one.last == many.last
    for name, column in one.since(0.0).items():
        np.testing.assert_array_equal(column, many.since(0.0)[name])
