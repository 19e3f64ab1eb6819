"""The door of a lab's clock where there are no Unix sockets: who does not say the word stays outside."""

from __future__ import annotations

import socket
from contextlib import suppress

import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.lab_time import connect
from simulators.lab import _door
from simulators.lab._door import Door

pytestmark = pytest.mark.concurrent


@pytest.fixture
def door(monkeypatch: pytest.MonkeyPatch) -> Door:
    monkeypatch.delattr(socket, "AF_UNIX")
    monkeypatch.setattr(_door, "_SAID_S", 0.05)
    return Door()


@pytest.mark.parametrize(
    "said", [b"", b"x", b"\n", b"GET / HTTP/1.1\r\n\r\n" + 40 * b"x", b"right but one letter"]
)
def test_a_stranger_is_not_let_in(door: Door, said: bytes) -> None:
    address, word = door.url.removeprefix("virtual://127.0.0.1:").split("/")
    assert len(word) == 32
    if said == b"right but one letter":
        said = word[:-1].encode() + b"g\n"
    with socket.create_connection(("127.0.0.1", int(address))) as stranger:
        stranger.sendall(said)
        assert door.accept() is None
        stranger.settimeout(5.0)
        with suppress(ConnectionError):  # hung up with what it said unread
            assert stranger.recv(1) == b""
    door.close()


def test_whoever_has_the_url_is_let_in(door: Door) -> None:
    address, word = door.url.removeprefix("virtual://127.0.0.1:").split("/")
    with socket.create_connection(("127.0.0.1", int(address))) as bench:
        bench.sendall(word[:5].encode())
        bench.sendall(word[5:].encode() + b"\nrequest")
        lab = door.accept()
        assert lab is not None and lab.gettimeout() is None
        with lab:
            assert lab.recv(100) == b"request"
    door.close()


def test_two_labs_have_two_words(door: Door) -> None:
    other = Door()
    assert other.url.rpartition("/")[2] != door.url.rpartition("/")[2]
    for each in (door, other):
        each.close()


@pytest.mark.parametrize(
    "url", ["virtual:///somewhere/clock", "virtual://127.0.0.1/word", "virtual://127.0.0.1:x/w"]
)
def test_a_url_that_leads_nowhere_is_refused_in_words(door: Door, url: str) -> None:
    door.close()
    with pytest.raises(ConfigurationError, match="no emulated lab answers at the clock URL"):
        connect(url)
