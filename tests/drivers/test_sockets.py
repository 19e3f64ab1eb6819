"""A port as a socket, as systems take it that wait for sockets only: over a pseudo-terminal and over TCP."""

from __future__ import annotations

import os
import select
import socket
import tty
from collections.abc import Iterator

import pytest

from drivers.kit.sockets import SocketPort

pytestmark = pytest.mark.concurrent


def heard(port: SocketPort, count: int) -> bytes:
    """Return `count` bytes of a port, or fewer if it ends before."""
    data = b""
    while len(data) < count and select.select([port], [], [], 10.0)[0]:
        more = port.read(count - len(data))
        if not more:
            break
        data += more
    return data


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue


def test_bytes_of_a_serial_port_go_both_ways(terminal: tuple[int, str]) -> None:
    master, name = terminal
    port = SocketPort(name, baudrate=115200)
    with pytest.raises(BlockingIOError):
        port.read(1)
    sent = bytes(range(256)) * 40
    os.write(master, sent[:4000])
    assert heard(port, 4000) == sent[:4000]
    assert port.write(memoryview(sent[:3000])) == 3000
    found = b""
    while len(found) < 3000:
        found += os.read(master, 4096)
    assert found == sent[:3000]
    assert port.is_open
    port.close()
    assert not port.is_open


def test_a_port_that_goes_away_is_met_as_its_end(terminal: tuple[int, str]) -> None:
    master, name = terminal
    port = SocketPort(name, baudrate=9600)
    os.close(master)
    assert heard(port, 1) == b"" and select.select([port], [], [], 0.0)[0]
    port.close()


def test_bytes_of_a_device_server_go_both_ways() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = SocketPort(f"socket://127.0.0.1:{listener.getsockname()[1]}")
        device, _ = listener.accept()
        with device:
            device.sendall(b"hello")
            assert heard(port, 5) == b"hello"
            port.write(memoryview(b"there"))
            assert device.recv(5) == b"there"
        assert heard(port, 1) == b""
        port.close()


def test_a_device_server_may_have_an_ipv6_address() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as listener:
        port = SocketPort(f"socket://[::1]:{listener.getsockname()[1]}")
        device, _ = listener.accept()
        with device:
            device.sendall(b"hello")
            assert heard(port, 5) == b"hello"
        port.close()


@pytest.mark.parametrize(
    ("place", "says"),
    [
        ("socket://127.0.0.1", "not a host and a port"),
        ("socket://:5000", "not a host and a port"),
        ("socket://127.0.0.1:5000?logging=debug", "nothing else"),
        ("socket://127.0.0.1:5000/5001", "nothing else"),
        ("socket://127.0.0.1:0", "not a host and a port"),
        ("socket://127.0.0.1:99999", "out of range"),
        ("socket://127.0.0.1:tcp", "'tcp'"),
    ],
)
def test_what_is_no_host_and_port_is_told(place: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        SocketPort(place)
