"""The link on a real terminal and a real socket: deadlines, idle ports, ports that go away, sole use."""

import os
import pty
import socket
import termios
import tty

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, DeviceSilent, LinkLost, ProtocolError
from drivers.kit.link import Link
from tests.ptys import read_exactly, write_through

pytestmark = pytest.mark.concurrent


class Tap:
    def __init__(self):
        self.rows = []

    def received(self, data, arrival_s):
        self.rows.append(("received", data, arrival_s))

    def sent(self, data, time_s):
        self.rows.append(("sent", data, time_s))


class CountingClock(WallClock):
    """A clock that counts its waits and moves only by them, in whole ns."""

    now_ns = 123_456_789
    waits = 0

    def now(self):
        return self.now_ns / 1e9

    def wait_for(self, port, deadline_s):
        self.waits += 1
        assert self.waits < 1000, "waits without end"
        self.now_ns = max(self.now_ns, round(deadline_s * 1e9))
        data = port.receive()
        port.deliver(data, self.now())
        return bool(data)


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave), slave
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue


@pytest.fixture
def link(terminal):
    clock = CountingClock()
    link = Link(terminal[1], clock, name="port", tap=Tap(), baudrate=115_200)
    yield link
    link.close()
    clock.close()


def test_bytes_go_both_ways_and_past_the_tap(link, terminal):
    master = terminal[0]
    link.write(b"*IDN?\r\n")
    assert read_exactly(master, 7) == b"*IDN?\r\n"
    write_through(master, terminal[2], b"one\rtwo\rthree")
    assert link.read_until(b"\r", 1.0) == b"one\r"
    assert link.read_exactly(3, 1.0) == b"two"
    assert link.read_some(1.0) == b"\rthree"
    assert [(way, data) for way, data, _ in link.tap.rows] == [
        ("sent", b"*IDN?\r\n"),
        ("received", b"one\rtwo\rthree"),
    ]
    assert (link.bytes_sent, link.bytes_received) == (7, 13)


def test_an_idle_terminal_reads_empty_and_is_not_lost(link):
    assert link.receive() == b""
    assert link.read_some(0.5) == b""
    with pytest.raises(DeviceSilent, match=r"no complete reply within 0\.5 s") as silent:
        link.read_until(b"\r", 0.5)
    assert silent.value.found == "nothing"


def test_a_terminal_that_hangs_up_is_lost(link, terminal):
    master, _, slave = terminal
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkLost, match="the port is gone"):
        link.receive()
    link.close()


def test_a_socket_that_ends_is_lost_and_an_idle_one_is_not():
    clock = CountingClock()
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = Link(f"socket://127.0.0.1:{server.getsockname()[1]}", clock, name="chamber")
        peer, _ = server.accept()
        with peer:
            assert link.receive() == b""
            assert link.read_some(0.1) == b""
        with pytest.raises(LinkLost):
            link.read_exactly(1, 1.0)
        link.close()
    clock.close()


def test_a_socket_is_closed_at_once_and_its_peer_told(monkeypatch):
    def sleep(duration_s: float) -> None:
        raise AssertionError(f"closing slept {duration_s} s")

    clock = CountingClock()
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = Link(f"socket://127.0.0.1:{server.getsockname()[1]}", clock, name="chamber")
        peer, _ = server.accept()
        with peer:
            link.write(b"1?")
            monkeypatch.setattr("time.sleep", sleep)
            link.close()
            assert peer.recv(16) == b"1?"
            assert peer.recv(16) == b""
    clock.close()


def test_a_port_is_for_one_program(link, terminal):
    with pytest.raises(ConfigurationError, match="cannot be opened") as busy:
        Link(terminal[1], link.clock, name="second")
    assert "lock" in busy.value.found


@pytest.mark.parametrize("url", ["/dev/does-not-exist", "socket://127.0.0.1:1", "nonsense://x"])
def test_a_port_that_cannot_be_opened_is_named(url):
    clock = CountingClock()
    with pytest.raises(ConfigurationError) as missing:
        Link(url, clock, name="table")
    text = str(missing.value)
    assert text.startswith("table") and url in text
    clock.close()


def test_a_line_is_opened_with_its_parity_and_a_terminal_as_often_as_wanted(terminal, monkeypatch):
    """Linux forgets parity on a pseudo-terminal, and the second setting fails (EINVAL)."""
    for _ in range(2):
        link = Link(terminal[1], WallClock(), name="port", baudrate=19_200, parity="O")
        assert link.spoken == "19200 Bd, 8O1"
        link.close()
    asked = {}

    def opened(url, **settings):
        asked.update(settings)
        raise OSError("no such port")

    monkeypatch.setattr("drivers.kit.link.serial.serial_for_url", opened)
    with pytest.raises(ConfigurationError):
        Link("/dev/ttyUSB0", WallClock(), name="port", baudrate=19_200, parity="O")
    assert asked["parity"] == "O"


def test_a_port_that_goes_away_while_it_is_being_set_is_named(terminal, monkeypatch):
    def gone(*_):
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr("serial.serialposix.termios.tcsetattr", gone)
    with pytest.raises(ConfigurationError, match="Input/output error"):
        Link(terminal[1], WallClock(), name="fog")


def test_a_reply_without_end_is_refused_at_its_limit(link, terminal):
    write_through(terminal[0], terminal[2], b"x" * 300)
    with pytest.raises(ProtocolError, match="in 200 bytes"):
        link.read_until(b"\r", 1.0, limit=200)


def test_what_came_of_a_reply_is_told(link, terminal):
    write_through(terminal[0], terminal[2], b"half a repl")
    with pytest.raises(DeviceSilent) as silent:
        link.read_until(b"\r", 1.0)
    assert "11 bytes" in silent.value.found and "half a repl" in silent.value.found
    assert link.discard() == b"half a repl"


def test_a_loop_of_waits_until_a_deadline_ends(link):
    """What rounding leaves of a deadline may be less than the clock counts."""
    for start_ns in (123_456_789, 999_999_999, 86_399_999_999_937):
        link.clock.now_ns, link.clock.waits = start_ns, 0
        deadline_s = link.clock.now() + 0.7
        while (left_s := deadline_s - link.clock.now()) > 0.0:
            assert link.read_some(left_s) == b""


def test_while_streaming_bytes_go_to_the_tap_only(link, terminal):
    link.streaming = True
    write_through(terminal[0], terminal[2], b"stream")
    assert link.read_some(1.0) == b""
    assert [(way, data) for way, data, _ in link.tap.rows] == [("received", b"stream")]


@settings(max_examples=50, deadline=None)
@given(chunks=st.lists(st.binary(min_size=1, max_size=9), max_size=12))
def test_any_chunking_gives_the_same_lines(chunks):
    class Memory(Link):
        def __init__(self):
            self._buffer = bytearray()
            self.tap, self.streaming, self.name, self.url = None, False, "m", "memory"
            self.clock = self
            self.waiting, self.time_s = list(chunks), 0.0

        def now(self):
            return self.time_s

        def wait_for(self, port, deadline_s):
            if not self.waiting:
                self.time_s = deadline_s
                return False
            self.deliver(self.waiting.pop(0), 0.0)
            return True

    link, found = Memory(), []
    try:
        while True:
            found.append(link.read_until(b"\r", 0.5))
    except DeviceSilent:
        pass
    whole = b"".join(chunks)
    assert found == [line + b"\r" for line in whole.split(b"\r")[:-1]]
    assert link.discard() == whole.split(b"\r")[-1]


def test_what_arrived_before_a_discard_is_recorded_and_not_read(link):
    link.clock.now_ns = 2_000_000_000
    link.discard()
    link.deliver(b"late answer", 1.5)
    link.deliver(b"answer", 2.0)
    assert link.discard() == b"answer"
    assert [row[1] for row in link.tap.rows] == [b"late answer", b"answer"]
