"""An adapter pulled and put back, on the wall clock and a real terminal, under the name that it had."""

from __future__ import annotations

import contextlib
import os
import pty
import tty
from pathlib import Path

import numpy as np
import pytest

from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, LinkLost
from drivers.kit.link import Link
from drivers.kvh import KvhDecoder, encode_frames

pytestmark = pytest.mark.concurrent


def plugged_in(name: Path) -> tuple[int, int]:
    """Return both ends of a terminal that has `name`, as udev names an adapter."""
    far, near = pty.openpty()
    tty.setraw(near)
    name.unlink(missing_ok=True)
    name.symlink_to(os.ttyname(near))
    return far, near


def frames(first: int) -> bytes:
    return encode_frames("A", np.full((20, 3), 1e-4), counter=np.arange(first, first + 20), temp_c=20.0)


def counters(link: Link, decoder: KvhDecoder, wanted: int) -> list[int]:
    """Read until so many frames have come, at most 10 s."""
    found: list[int] = []
    deadline_s = link.clock.now() + 10.0
    while len(found) < wanted and link.clock.now() < deadline_s:
        found += decoder.feed(link.read_some(1.0)).columns["counter"].tolist()
    return found


def test_a_gyro_unplugged_is_lost_and_put_back_is_read_again(tmp_path: Path) -> None:
    name, clock = tmp_path / "ttyGYRO", WallClock()
    far, near = plugged_in(name)
    try:
        link = Link(str(name), clock, name="fog", baudrate=921_600)
        os.write(far, frames(0) + frames(20)[:17])  # pulled in the middle of a message
        decoder = KvhDecoder(nominal_rate_hz=100.0)
        assert counters(link, decoder, 20) == list(range(20))
        os.close(near)
        os.close(far)
        name.unlink()
        with pytest.raises(LinkLost, match="the port is gone"):
            while True:
                link.read_some(1.0)
        link.close()  # never raises for a port that is gone
        with pytest.raises(ConfigurationError) as refused:
            Link(str(name), clock, name="fog", baudrate=921_600)
        assert "ttyGYRO" in str(refused.value)
        far, near = plugged_in(name)
        again = Link(str(name), clock, name="fog", baudrate=921_600)
        os.write(far, frames(21)[9:])  # switched on in the middle of a message
        # The decoder that lived through it loses what was cut, and no other.
        assert counters(again, decoder, 19) == list(range(22, 41))
        assert decoder.counts.frames == 39
        again.close()
    finally:
        for end in (far, near):
            with contextlib.suppress(OSError):
                os.close(end)
        clock.close()
