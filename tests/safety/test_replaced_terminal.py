"""The watchdog of a run whose emulated lab is gone lets the next lab alone, which has its terminals' numbers."""

import os
from pathlib import Path

import pytest

from bench.control.watchdog._process import _of, _Replaced


def made_ns(name):
    return Path(name).stat().st_ctime_ns if Path(name).exists() else 0


@pytest.mark.concurrent
def test_a_terminal_is_opened_only_while_it_is_the_one_that_was_guarded():
    ends = os.openpty()
    name, opened = os.ttyname(ends[1]), []
    before_ns = made_ns(name)
    opener = _of(name, lambda clock, tap: opened.append(name))
    opener(None, None)
    assert opened == [name]
    while made_ns(name) == before_ns:  # the file system's clock goes in steps of some milliseconds
        for end in ends:
            os.close(end)
        ends = os.openpty()
    with pytest.raises(_Replaced, match="no more"):
        opener(None, None)
    assert opened == [name]
    for end in ends:
        os.close(end)


def test_a_serial_port_may_go_and_come_back():
    opened = []
    opener = _of("/dev/ttyUSB0", lambda clock, tap: opened.append(1))
    opener(None, None)
    assert opened == [1]


@pytest.mark.parametrize("other", [(0, 1, 1), (9, 9, 9), None])
def test_any_other_device_of_the_name_is_let_alone(monkeypatch, other):
    """Whether it is older or newer than the one that was guarded, or is gone."""
    devices = iter([(5, 5, 5), (5, 5, 5), other])
    monkeypatch.setattr("bench.control.watchdog._process.device_at", lambda port: next(devices))
    opened = []
    opener = _of("/dev/pts/7", lambda clock, tap: opened.append(1))
    opener(None, None)
    with pytest.raises(_Replaced):
        opener(None, None)
    assert opened == [1]
