"""Opened again after a loss, on the wall clock: slcan adapter, device server, buses of python-can."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, LinkLost
from drivers.kit.link import Link
from drivers.slcan import open_can
from drivers.slcan._messages import MessageLink
from tests.drivers.test_slcan_bus import SocketBus
from tests.ptys import read_exactly

pytestmark = pytest.mark.concurrent

OPENED = b"C\rS6\rO\r"


@pytest.fixture
def clock() -> Iterator[WallClock]:
    clock = WallClock()
    yield clock
    clock.close()


def lost(link: Link) -> None:
    with pytest.raises(LinkLost):
        while True:
            link.read_some(1.0)


def opened_again(link: Link) -> None:
    """Open as a run does: again and again while it is not there."""
    deadline_s = link.clock.now() + 20.0
    while True:
        try:
            link.reopen()
        except ConfigurationError:
            assert link.clock.now() < deadline_s
        else:
            return


def test_an_slcan_adapter_pulled_and_put_back_gets_its_bit_rate_again(
    tmp_path: Path, clock: WallClock
) -> None:
    name = tmp_path / "ttyCAN"

    def plugged_in() -> tuple[int, int]:
        far, near = pty.openpty()
        tty.setraw(near)
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(near))
        return far, near

    ends = plugged_in()
    try:
        bus, link = open_can("gyrobench_slcan", str(name), 500_000, clock, "can")
        assert read_exactly(ends[0], len(OPENED)) == OPENED
        os.write(ends[0], b"t1231AA\rt12")  # pulled in the middle of a line
        message = bus.recv(10.0)
        assert message is not None and message.data == b"\xaa"
        for end in ends:
            os.close(end)
        name.unlink()
        lost(link)
        with pytest.raises(ConfigurationError, match="ttyCAN"):
            link.reopen()
        ends = plugged_in()
        opened_again(link)
        assert read_exactly(ends[0], len(OPENED)) == OPENED
        assert link.bytes_received == 0
        os.write(ends[0], b"t1231AB\rt1231BB\r")  # a cut "t12" before it costs neither
        for expected in (b"\xab", b"\xbb"):
            message = bus.recv(10.0)
            assert message is not None and message.data == expected
        bus.shutdown()
    finally:
        for end in ends:
            with contextlib.suppress(OSError):
                os.close(end)


def test_a_device_server_that_was_switched_off_and_on(clock: WallClock) -> None:
    server = socket.create_server(("127.0.0.1", 0))
    port = server.getsockname()[1]
    link = Link(f"socket://127.0.0.1:{port}", clock, name="fog")
    there, _ = server.accept()
    there.sendall(b"before")
    assert link.read_exactly(6, 10.0) == b"before"
    there.close()
    server.close()
    lost(link)
    with pytest.raises(ConfigurationError, match="cannot be opened"):
        link.reopen()
    server = socket.create_server(("127.0.0.1", port))
    opened_again(link)
    there, _ = server.accept()
    there.sendall(b"behind")
    assert link.read_exactly(6, 10.0) == b"behind" and link.bytes_received == 6
    link.close()
    there.close()
    server.close()


@pytest.mark.parametrize("threaded", [False, True])
def test_a_bus_of_python_can_is_opened_again(clock: WallClock, threaded: bool) -> None:
    """With a descriptor as socketcan's, and without one: the interface comes back at the third try."""
    pipes = [os.pipe(), os.pipe()]
    for reading, _ in pipes:
        os.set_blocking(reading, False)

    class Bus(SocketBus):
        def fileno(self) -> int:
            if threaded:
                raise NotImplementedError
            return self.descriptor

        def shutdown(self) -> None:
            super().shutdown()
            raise can.CanOperationError("the network is down")  # as python-can's own slcan does

    tries: list[str] = []

    def opener() -> can.BusABC:
        tries.append("")
        if len(tries) < 3:
            raise OSError(19, "No such device")
        return Bus(pipes[1][0])

    link = MessageLink(Bus(pipes[0][0]), clock, name="can", opener=opener)
    os.write(pipes[0][1], b"\x01")
    assert link.read_until(b"\r", 10.0) == b"t0010\r"
    os.close(pipes[0][1])
    lost(link)
    with pytest.raises(ConfigurationError, match="No such device"):
        link.reopen()
    opened_again(link)
    assert len(tries) == 3 and link.bytes_received == 0
    os.write(pipes[1][1], b"\x02")
    assert link.read_until(b"\r", 10.0) == b"t0020\r"
    link.close()
    link.close()
    for end in (pipes[0][0], *pipes[1]):
        os.close(end)


def test_a_bus_that_takes_its_time_is_waited_for_without_holding_up_the_run(clock: WallClock) -> None:
    there = threading.Event()
    end = os.pipe()
    os.set_blocking(end[0], False)

    def opener() -> can.BusABC:
        assert there.wait(20.0)
        return SocketBus(end[0])

    gone = os.pipe()
    os.set_blocking(gone[0], False)
    link = MessageLink(SocketBus(gone[0]), clock, name="can", opener=opener)
    os.close(gone[1])
    lost(link)
    with pytest.raises(ConfigurationError, match="does not answer yet"):
        link.reopen()
    there.set()
    opened_again(link)
    os.write(end[1], b"\x07")
    assert link.read_until(b"\r", 10.0) == b"t0070\r"
    link.close()
    for each in (gone[0], *end):
        os.close(each)


def test_the_interface_of_a_bench_file_is_opened_again(clock: WallClock) -> None:
    bus, link = open_can("virtual", "again", 500_000, clock, "can")
    bus.shutdown()  # python-can's virtual bus goes away only so
    lost(link)
    opened_again(link)
    with can.Bus(interface="virtual", channel="again") as other:
        other.send(can.Message(arbitration_id=0x122, is_extended_id=False, data=b"\x01"))
        assert link.read_until(b"\r", 10.0) == b"t122101\r"
    link.close()
