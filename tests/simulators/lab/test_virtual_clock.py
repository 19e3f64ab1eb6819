"""The virtual clock against bytes laid out by struct in this file, and against a scripted lab in a thread."""

import json
import os
import shutil
import socket
import struct
import tempfile
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import BenchError, ConfigurationError, LinkLost, RunAborted
from drivers.base.lab_time import NOT_OPEN, Codec
from drivers.base.virtual_clock import VirtualClock

pytestmark = pytest.mark.concurrent

INT64 = st.integers(-(2**63), 2**63 - 1)


def reply_bytes(now_ns, written, marks):
    """A reply as the module's text describes it."""
    data = struct.pack("<q", now_ns) + b"".join(struct.pack("<q", count) for count in written)
    data += struct.pack("<I", len(marks))
    return data + b"".join(struct.pack("<h", p) + struct.pack("<qq", count, t) for p, count, t in marks)


def test_a_request_is_laid_out_as_described():
    codec = Codec(3)
    expected = struct.pack("<qq", 4_000_000_000, 5_000_000_000) + struct.pack("<h", 1)
    expected += struct.pack("<qqq", 7, -1, 0)
    assert codec.pack_request((4_000_000_000, 5_000_000_000, 1, [7, NOT_OPEN, 0])) == expected
    assert len(expected) == codec.request_size == 8 + 8 + 2 + 3 * 8
    assert codec.unpack_request(expected) == (4_000_000_000, 5_000_000_000, 1, [7, -1, 0])


@settings(max_examples=60, deadline=None)
@given(
    now_ns=st.integers(0, 2**62),
    written=st.lists(st.integers(0, 2**62), min_size=1, max_size=5),
    data=st.data(),
)
def test_a_reply_is_laid_out_as_described_and_waits_until_whole(now_ns, written, data):
    port = st.integers(0, len(written) - 1)
    marks = data.draw(st.lists(st.tuples(port, INT64, INT64), max_size=4))
    codec = Codec(len(written))
    expected = reply_bytes(now_ns, written, marks)
    assert codec.pack_reply((now_ns, written, marks)) == expected
    assert codec.unpack_reply(expected) == (now_ns, written, marks)
    cut = data.draw(st.integers(0, len(expected) - 1))
    assert codec.unpack_reply(expected[:cut]) is None


def test_an_error_reply_is_raised_with_its_text_once_it_is_whole():
    data = struct.pack("<qI", -1, 11) + "plant bröke".encode()[:11]
    codec = Codec(2)
    assert codec.unpack_reply(data[:15]) is None
    with pytest.raises(BenchError, match="the emulated lab failed: plant br"):
        codec.unpack_reply(data)
    assert Codec.pack_error("abc") == struct.pack("<qI", -1, 3) + b"abc"


class Port:
    """A port over a pipe, as a clock needs it."""

    def __init__(self, name):
        self.name = name
        self.bytes_sent = self.bytes_received = 0
        self.read_end, self.write_end = os.pipe()
        os.set_blocking(self.read_end, False)
        self.delivered = []

    def fileno(self):
        return self.read_end

    def receive(self):
        try:
            data = os.read(self.read_end, 65536)
        except BlockingIOError:
            return b""
        self.bytes_received += len(data)
        return data

    def deliver(self, data, arrival_s):
        self.delivered.append((data, arrival_s))


class ScriptedLab:
    """A lab that answers the n-th request with the n-th step of its script and keeps what it was asked."""

    def __init__(self, names, steps, greeting=None, now_ns=0):
        self.names, self.steps, self.requests = names, list(steps), []
        self.written_at = []
        self.greeting = greeting or json.dumps(
            {"protocol": "gyrobench-clock", "version": 1, "ports": names, "now_ns": now_ns}
        )
        self.folder = tempfile.mkdtemp()
        self.server = socket.socket(socket.AF_UNIX)
        self.server.bind(f"{self.folder}/clock")
        self.server.listen()
        self.url = f"virtual://{self.folder}/clock"
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        connection, _ = self.server.accept()
        with connection:
            connection.sendall(self.greeting.encode() + b"\n")
            size = 18 + 8 * len(self.names)
            for step in self.steps:
                data = b""
                while len(data) < size:
                    more = connection.recv(size - len(data))
                    if not more:
                        return
                    data += more
                at_ns, *request = struct.unpack(f"<qqh{len(self.names)}q", data)
                self.written_at.append(at_ns)
                self.requests.append(tuple(request))
                for part in step():
                    connection.sendall(part)

    def close(self):
        self.server.close()
        shutil.rmtree(self.folder)
        self.thread.join(10.0)
        assert not self.thread.is_alive()


@pytest.fixture
def labs():
    made = []

    def make(*arguments, **options):
        made.append(ScriptedLab(*arguments, **options))
        return made[-1]

    yield make
    for lab in made:
        lab.close()


def test_bytes_are_delivered_with_the_times_of_their_marks_before_time_moves_on(labs):
    port = Port("gyro")

    def step():
        os.write(port.write_end, b"aaabbbbcc")
        yield reply_bytes(
            2_000_000_000, [0, 9], [(1, 3, 500_000_000), (1, 7, 900_000_001), (1, 9, 2_000_000_000)]
        )

    lab = labs(["table", "gyro"], [step])
    clock = VirtualClock(lab.url)
    clock.attach(port)
    clock.sleep(2.0)
    assert port.delivered == [(b"aaa", 0.5), (b"bbbb", 0.900000001), (b"cc", 2.0)]
    assert clock.now() == 2.0
    assert lab.requests == [(2_000_000_000, -1, -1, 0)]
    clock.close()


def test_a_wait_names_its_port_says_what_was_sent_and_ends_at_the_first_byte(labs):
    port = Port("table")

    def answer():
        os.write(port.write_end, b"OK")
        yield reply_bytes(1_002_000_000, [2], [(0, 2, 1_002_000_000)])

    lab = labs(["table"], [answer, lambda: [reply_bytes(3_000_000_000, [2], [])]], now_ns=1_000_000_000)
    clock = VirtualClock(lab.url)
    assert clock.now() == 0.0, "bench time begins when the bench comes, not when the lab was started"
    clock.attach(port)
    port.bytes_sent = 7
    assert clock.wait_for(port, 2.0) is True
    assert port.delivered == [(b"OK", 0.002)] and clock.now() == 0.002
    assert clock.wait_for(port, 2.0) is False
    assert lab.written_at == [1_000_000_000, 1_002_000_000]
    assert lab.requests == [(3_000_000_000, 0, 7), (3_000_000_000, 0, 7)]
    clock.close()


def test_bytes_that_come_after_the_reply_are_waited_for(labs):
    port = Port("gyro")
    late = threading.Event()

    def step():
        yield reply_bytes(1_000_000_000, [4], [(0, 4, 1_000_000_000)])
        late.wait(10.0)
        os.write(port.write_end, b"late")

    lab = labs(["gyro"], [step])
    clock = VirtualClock(lab.url)
    clock.attach(port)
    threading.Timer(0.05, late.set).start()
    clock.sleep(1.0)
    assert port.delivered == [(b"late", 1.0)]
    clock.close()


def test_a_lab_that_finds_a_port_full_gets_room_before_it_answers(labs):
    port = Port("gyro")
    size = 300_000  # more than a pipe holds

    def step():
        yield struct.pack("<q", -2)
        written = 0
        while written < size:
            written += os.write(port.write_end, b"x" * min(65536, size - written))
        yield reply_bytes(1_000_000_000, [size], [(0, size, 1_000_000_000)])

    lab = labs(["gyro"], [step])
    clock = VirtualClock(lab.url)
    clock.attach(port)
    clock.sleep(1.0)
    assert sum(len(data) for data, _ in port.delivered) == size
    clock.close()


def test_a_reply_in_pieces_is_put_together(labs):
    whole = reply_bytes(1_000_000_000, [0], [])
    lab = labs(["table"], [lambda: [whole[:8], whole[8:13], whole[13:]]])
    clock = VirtualClock(lab.url)
    clock.sleep(1.0)
    assert clock.now() == 1.0
    clock.close()


def test_a_long_sleep_is_cut_into_steps_and_a_request_to_stop_ends_it(labs):
    clock = None

    def first():
        clock.interrupt.request("Ctrl-C")
        yield reply_bytes(64_000_000_000, [0], [])

    lab = labs(["table"], [first])
    clock = VirtualClock(lab.url)
    with pytest.raises(RunAborted, match="Ctrl-C"):
        clock.sleep(1000.0)
    assert lab.requests == [(64_000_000_000, -1, -1)]
    assert clock.now() == 64.0
    clock.close()


def test_a_lab_that_hangs_up_or_fails_is_told(labs):
    lab = labs(["table"], [lambda: [struct.pack("<qI", -1, 5) + b"burnt"], lambda: []])
    clock = VirtualClock(lab.url)
    with pytest.raises(BenchError, match="burnt"):
        clock.sleep(1.0)
    with pytest.raises(LinkLost, match="the emulated lab is gone"):
        clock.sleep(1.0)
    clock.close()


@pytest.mark.parametrize(
    "greeting",
    [
        "HTTP/1.1 400 Bad Request",
        '{"protocol": "gyrobench-clock", "version": 99}',
        '{"protocol": "x"}',
        "[1]",
        "",
    ],
)
def test_something_else_at_the_clock_url_is_recognised(labs, greeting):
    lab = labs(["table"], [], greeting=greeting or " ")
    with pytest.raises(ConfigurationError, match="not an emulated lab of this version"):
        VirtualClock(lab.url)


@pytest.mark.parametrize(
    "url", ["virtual:///nowhere/clock", "virtual:///dev/null", "virtual://", "virtual:///" + 200 * "x"]
)
def test_nobody_at_the_clock_url_is_a_configuration_error(url):
    with pytest.raises(ConfigurationError, match="no emulated lab answers"):
        VirtualClock(url)


def test_a_port_the_lab_does_not_have_is_named(labs):
    lab = labs(["table", "chamber"], [])
    clock = VirtualClock(lab.url)
    with pytest.raises(ConfigurationError, match="no port 'fog_2'") as unknown:
        clock.attach(Port("fog_2"))
    assert unknown.value.found == "table, chamber"
    clock.close()


def test_idling_costs_no_round_trip_and_the_next_wait_says_when_bytes_were_written(labs):
    port = Port("gyro")

    def step():
        os.write(port.write_end, b"ab")
        yield reply_bytes(3_000_000_000, [2], [(0, 1, 900_000_000), (0, 2, 3_000_000_000)])

    lab = labs(["gyro"], [step])
    clock = VirtualClock(lab.url)
    clock.attach(port)
    clock.idle(1.5)
    assert clock.now() == 1.5 and lab.requests == []
    port.bytes_sent = 4
    assert clock.wait_for(port, 5.0)
    assert lab.written_at == [1_500_000_000] and lab.requests == [(5_000_000_000, 0, 4)]
    assert port.delivered == [(b"a", 0.9), (b"b", 3.0)] and clock.now() == 3.0
    clock.close()


def test_a_port_that_is_let_go_gets_what_arrived_while_the_bench_idled(labs):
    port = Port("gyro")

    def step():
        os.write(port.write_end, b"z")
        yield reply_bytes(1_000_000_000, [1], [(0, 1, 700_000_000)])

    lab = labs(["gyro"], [step])
    clock = VirtualClock(lab.url)
    clock.attach(port)
    clock.idle(1.0)
    clock.detach(port)
    assert port.delivered == [(b"z", 0.7)]
    clock.close()
