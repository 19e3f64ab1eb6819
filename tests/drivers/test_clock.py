"""The wall clock: waits end by time, bytes or interrupt; streams are read by a thread whose failures are told."""

import os
import threading

import pytest

from drivers.base.clock import Interrupt, WallClock
from drivers.base.errors import LinkLost, RunAborted

pytestmark = pytest.mark.concurrent


class Pipe:
    """A port over a pipe; `delivered` is what the clock handed on."""

    name = "pipe"
    bytes_sent = bytes_received = 0

    def __init__(self):
        self.read_end, self.write_end = os.pipe()
        os.set_blocking(self.read_end, False)
        self.delivered = []
        self.arrived = threading.Event()
        self.failure = None

    def fileno(self):
        return self.read_end

    def receive(self):
        if self.failure is not None:
            raise self.failure
        return os.read(self.read_end, 4096)

    def deliver(self, data, arrival_s):
        self.delivered.append((data, arrival_s))
        self.arrived.set()

    def close(self):
        os.close(self.read_end)
        os.close(self.write_end)


@pytest.fixture
def clock():
    clock = WallClock()
    yield clock
    clock.close()


@pytest.fixture
def port():
    port = Pipe()
    yield port
    port.close()


def test_sleep_lasts_at_least_what_was_asked_and_time_never_goes_back(clock):
    start = clock.now()
    assert start >= 0.0
    clock.sleep(0.01)
    assert clock.now() - start >= 0.01
    clock.sleep(-1.0)


def test_bytes_end_a_wait_and_are_delivered_with_their_arrival(clock, port):
    os.write(port.write_end, b"abc")
    before = clock.now()
    assert clock.wait_for(port, before + 60.0) is True
    ((data, arrival_s),) = port.delivered
    assert data == b"abc" and before <= arrival_s <= clock.now()
    assert clock.wait_for(port, clock.now()) is False


def test_a_request_from_another_thread_ends_a_wait(clock, port):
    for wait in (lambda: clock.sleep(60.0), lambda: clock.wait_for(port, clock.now() + 60.0)):
        presser = threading.Thread(target=clock.interrupt.request, args=("stopped by a test",))
        presser.start()
        with pytest.raises(RunAborted, match="stopped by a test"):
            wait()
        presser.join()
        clock.interrupt.clear()
        clock.sleep(0.0)


def test_a_standing_request_ends_every_wait_at_once(clock, port):
    clock.interrupt.request("now")
    with pytest.raises(RunAborted):
        clock.sleep(60.0)
    with pytest.raises(RunAborted):
        clock.wait_for(port, clock.now() + 60.0)


def test_an_interrupt_can_be_requested_without_end_and_cleared_at_once():
    interrupt = Interrupt()
    for _ in range(100_000):  # more than a pipe holds
        interrupt.wake()
    interrupt.request("stop")
    with pytest.raises(RunAborted):
        interrupt.check()
    interrupt.clear()
    interrupt.check()
    interrupt.close()


def test_streams_are_read_while_nobody_waits_for_them(clock, port):
    clock.stream(port)
    os.write(port.write_end, b"12")
    assert port.arrived.wait(10.0)
    assert port.delivered[0][0] == b"12"
    clock.detach(port)
    port.arrived.clear()
    os.write(port.write_end, b"34")
    assert os.read(port.read_end, 10) == b"34"


def test_a_stream_that_fails_ends_whoever_waits_next(clock, port):
    port.failure = LinkLost("the port is gone")
    clock.stream(port)
    os.write(port.write_end, b"x")
    with pytest.raises(LinkLost):
        while True:
            clock.sleep(60.0)
    clock.sleep(0.0)  # told once


@pytest.mark.timeout(60)
def test_a_polled_port_that_goes_away_ends_whatever_is_waited_for_once(clock, port):
    """Nobody has asked it anything: it is known at once all the same, not at the next question."""
    clock.attach(port)
    port.failure = LinkLost("the port is gone")
    os.write(port.write_end, b"!")  # stands for the hang-up that makes it readable
    with pytest.raises(LinkLost):
        clock.sleep(3600.0)
    clock.sleep(0.01)


@pytest.mark.timeout(60)
def test_what_a_polled_port_sends_is_taken_while_another_is_waited_for(clock, port):
    other = Pipe()
    try:
        clock.attach(port)
        clock.attach(other)
        os.write(port.write_end, b"early")
        assert clock.wait_for(other, clock.now() + 0.05) is False
        assert [data for data, _ in port.delivered] == [b"early"]
        clock.detach(port)
        os.write(port.write_end, b"late")
        clock.sleep(0.01)
        assert len(port.delivered) == 1
    finally:
        other.close()
