"""The lab's event loop, ports and control channel: order of events, counting, exact marks."""

import json
import os
import socket
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.interfaces import Reply, StreamBlock
from simulators.lab._adapter import Adapter
from simulators.lab._control_channel import ControlChannel
from simulators.lab._core import Lab
from simulators.lab._ports import PtyPort, TcpPort

pytestmark = pytest.mark.concurrent


class Plant:
    def __init__(self):
        self.times = []

    def advance(self, to_s):
        self.times.append(to_s)


class MemoryPort:
    url = "memory"
    is_open = True
    received = written = 0

    def __init__(self, name):
        self.name, self.data = name, b""

    def write(self, data):
        self.data += data
        self.written += len(data)


class Echo:
    """Answers every byte after a delay of its own value in ms."""

    def __init__(self):
        self.heard = []

    def receive(self, data, now_s):
        self.heard.append((data, now_s))
        return [Reply(now_s + byte * 1e-3, bytes([byte])) for byte in data]


class Ticker:
    """Sends a byte every 100 ms, k at (k + 1) / 10 s."""

    sent = 0

    def receive(self, data, now_s):
        return []

    def stream(self, until_s):
        count = int(until_s * 10 + 1e-9) - self.sent
        if not count:
            return None
        marks = [(k + 1, (self.sent + k + 1) * 100_000_000) for k in range(count)]
        self.sent += count
        return StreamBlock(bytes(count), np.array(marks, np.int64))


def make(delivery_s=1.0):
    echo, ticker = Echo(), Ticker()
    ports = [MemoryPort("table"), MemoryPort("gyro")]
    lab = Lab(Plant(), ports, {"table": echo, "gyro": ticker}, {"gyro": ticker}, delivery_s=delivery_s)
    return lab, ports, echo


def test_replies_leave_at_their_own_times_in_order():
    lab, ports, echo = make()
    lab.advance(500_000_000)
    lab.take_input(0, b"\x1e\x0a\x14")
    assert echo.heard == [(b"\x1e\x0a\x14", 0.5)]
    marks = lab.advance(700_000_000)
    assert ports[0].data == b"\x0a\x14\x1e"
    assert marks == [(0, 1, 510_000_000), (0, 2, 520_000_000), (0, 3, 530_000_000)]
    assert lab.now_ns == 700_000_000


def test_an_advance_stops_at_the_first_byte_on_the_port_that_is_waited_for():
    lab, _, _ = make()
    lab.take_input(0, b"\x32\x64")
    assert lab.advance(10_000_000_000, stop_port=0) == [(0, 1, 50_000_000)]
    assert lab.now_ns == 50_000_000
    assert lab.advance(10_000_000_000, stop_port=0) == [(0, 2, 100_000_000)]
    marks = lab.advance(10_000_000_000, stop_port=1)
    assert lab.now_ns == 1_000_000_000
    assert marks == [(1, k, k * 100_000_000) for k in range(1, 11)]


def test_what_an_adapter_held_is_gone_when_its_port_was_shut():
    """A byte every 100 ms, handed over every 350 ms: that of 0.4 s is held when the port is shut."""
    ticker, port = Ticker(), MemoryPort("gyro")
    adapters = {"gyro": Adapter(0.35)}
    lab = Lab(Plant(), [port], {"gyro": ticker}, {"gyro": ticker}, delivery_s=0.1, adapters=adapters)
    marks = lab.advance(400_000_000)
    assert marks == [(0, 3, 350_000_000)] and port.data == bytes(3)
    port.is_open = False
    lab.advance(900_000_000)
    port.is_open = True
    assert lab.advance(1_100_000_000) == [(0, 4, 1_050_000_000)] and port.data == bytes(4)


def test_a_closed_port_gets_nothing():
    lab, ports, _ = make()
    ports[1].is_open = False
    assert lab.advance(3_000_000_000) == []
    assert ports[1].data == b""


@settings(max_examples=40, deadline=None)
@given(
    steps=st.lists(
        st.tuples(st.integers(0, 3_000_000_000), st.binary(max_size=3), st.sampled_from([-1, 0, 1])),
        max_size=8,
    )
)
def test_however_it_is_driven_time_goes_forward_and_marks_are_in_order(steps):
    lab, ports, _ = make(delivery_s=0.25)
    plant, all_marks = lab._plant, []
    for forward, data, stop in steps:
        lab.take_input(0, data)
        all_marks += lab.advance(lab.now_ns + forward, stop)
    all_marks += lab.advance(lab.now_ns + 10_000_000_000)
    assert plant.times == sorted(plant.times)
    for index, port in enumerate(ports):
        counts = [count for at, count, _ in all_marks if at == index]
        times = [t for at, _, t in all_marks if at == index]
        assert counts == sorted(set(counts)) and times == sorted(times)
        assert (counts[-1] if counts else 0) == port.written == len(port.data)
    assert len(ports[0].data) == sum(len(data) for _, data, _ in steps)
    assert ports[1].written == int(lab.now_ns / 1e9 / 0.25 + 1e-9) * 0.25 * 10 // 1


def test_a_pty_port_is_raw_and_counts_both_ways():
    port = PtyPort("table")
    bench = os.open(port.url, os.O_RDWR | os.O_NOCTTY)
    try:
        port.write(b"lost: nobody has it open")
        port.open()
        everything = bytes(range(256))
        os.write(bench, everything)
        data = b""
        while len(data) < 256:
            data += port.read()
        assert data == everything and port.received == 256
        port.write(everything[::-1])
        data = b""
        while len(data) < 256:
            data += os.read(bench, 256)
        assert data == everything[::-1] and port.written == 256
        assert port.read() == b""
        port.shut()
        port.write(b"x")
        port.open()
        assert (port.received, port.written) == (0, 0)
    finally:
        os.close(bench)
        port.close()


def test_an_impatient_port_loses_what_does_not_fit_as_a_uart_does():
    port = PtyPort("gyro")
    port.open()
    port.write(bytes(1 << 20))
    assert 0 < port.written < 1 << 20
    port.close()


def test_a_tcp_port_serves_one_bench_after_another():
    port = TcpPort("chamber")
    try:
        for text in (b"first", b"second"):
            with socket.create_connection(("127.0.0.1", int(port.url.rsplit(":", 1)[1]))) as bench:
                port.open()
                bench.sendall(text)
                data = b""
                while len(data) < len(text):
                    data += port.read()
                assert data == text
                port.write(b"1\r\n")
                assert bench.recv(10) == b"1\r\n"
                assert (port.received, port.written) == (len(text), 3)
            while port.is_open:
                assert port.read() == b""
    finally:
        port.close()


def test_a_bench_that_resets_its_connection_costs_the_lab_nothing():
    port = TcpPort("chamber")
    try:
        address = ("127.0.0.1", int(port.url.rsplit(":", 1)[1]))
        bench = socket.create_connection(address)
        port.open()
        bench.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        bench.close()  # RST
        port.write(b"an answer that was on its way\r\n")
        assert not port.is_open
        with socket.create_connection(address) as bench:
            port.open()
            port.write(b"1\r\n")
            assert bench.recv(10) == b"1\r\n"
    finally:
        port.close()


@pytest.fixture
def door():
    (in_read, in_write), (out_read, out_write) = os.pipe(), os.pipe()

    def fail(request):
        raise KeyError(request["what"])

    door = ControlChannel(
        {"double": lambda request: {"value": 2 * request["value"]}, "fail": fail},
        input_fd=in_read,
        output_fd=out_write,
    )
    yield door, in_write, out_read
    for descriptor in (in_read, out_read, out_write):
        os.close(descriptor)


def test_the_stage_door_answers_every_line_and_survives_nonsense(door):
    door, write, read = door
    os.write(
        write,
        b'{"act": "double", "value": 21}\n\n{"act": "fail", "what": "x"}\nnonsense\n[1]\n{"act": "fly"}\n{"a',
    )
    assert door.answer()
    os.write(write, b'ct": "double", "value": 1}\n')
    assert door.answer()
    answers = [json.loads(line) for line in os.read(read, 65536).splitlines()]
    assert answers[0] == {"ok": True, "value": 42}
    assert [answer["ok"] for answer in answers] == [True, False, False, False, False, True]
    assert answers[-1] == {"ok": True, "value": 2}
    os.close(write)
    assert door.answer() is False
