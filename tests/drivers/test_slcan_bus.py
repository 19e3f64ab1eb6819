"""The slcan bus over a pseudo-terminal, and python-can buses as links, without threads of the test's own."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import pty
import tty
from collections.abc import Iterator

import can
import can.cli
import pytest

from drivers.base.clock import WallClock, epoch_seconds
from drivers.base.errors import ConfigurationError, DeviceSilent, LimitExceeded, LinkLost, ProtocolError
from drivers.slcan import BufferedSlcanBus, open_can
from drivers.slcan._messages import MessageLink
from tests.ptys import read_exactly

pytestmark = pytest.mark.concurrent


class Adapter:
    """The far end of a pseudo-terminal."""

    def __init__(self) -> None:
        self.fd, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.fd, False)
        self.path = os.ttyname(self._slave)

    def write(self, data: bytes) -> None:
        os.write(self.fd, data)

    def expect(self, wanted: bytes) -> None:
        assert read_exactly(self.fd, len(wanted)) == wanted

    def unplug(self) -> None:
        for descriptor in (self._slave, self.fd):
            with contextlib.suppress(OSError):
                os.close(descriptor)


class Recorder:
    def __init__(self) -> None:
        self.blocks: list[tuple[bytes, float]] = []
        self.written: list[bytes] = []

    def received(self, data: bytes, arrival_s: float) -> None:
        self.blocks.append((data, arrival_s))

    def sent(self, data: bytes, time_s: float) -> None:
        self.written.append(data)


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    adapter = Adapter()
    yield adapter
    adapter.unplug()


@pytest.fixture
def clock() -> Iterator[WallClock]:
    clock = WallClock()
    yield clock
    clock.close()


class StillClock(WallClock):
    """A clock that moves only when somebody waits; bytes arrive when the test delivers them."""

    time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def wait_for(self, port: object, deadline_s: float) -> bool:
        self.time_s = deadline_s
        return False


def test_python_can_finds_it_and_both_ends_understand_each_other(adapter: Adapter) -> None:
    before = epoch_seconds()
    with can.Bus(interface="gyrobench_slcan", channel=adapter.path, bitrate=250_000) as bus:
        assert isinstance(bus, BufferedSlcanBus)
        adapter.expect(b"C\rS5\rO\r")
        adapter.write(b"\r\r\rt1226640006FFE803\rT1FFFFFFF11AABCD\rr1234\rR000000010\r")
        messages = [bus.recv(2.0) for _ in range(4)]
        expected = [
            can.Message(arbitration_id=0x122, is_extended_id=False, data=b"\x64\0\x06\xff\xe8\x03"),
            can.Message(arbitration_id=0x1FFFFFFF, data=b"\x1a"),
            can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=4),
            can.Message(arbitration_id=1, is_remote_frame=True, dlc=0),
        ]
        for message, wanted in zip(messages, expected, strict=True):
            assert message is not None
            assert message.equals(wanted, timestamp_delta=None)
        assert bus.counts.rejected == {}
        assert messages[0] is not None
        assert before <= messages[0].timestamp <= epoch_seconds()
        bus.send(expected[0])
        bus.send(expected[3])
        adapter.expect(b"t1226640006FFE803\rR000000010\r")
    adapter.expect(b"C\r")


DAMAGE = [
    b"t12\r",
    b"t1232AAGG\r",
    b"\xff\xfe\x80\r",
    b"t10080011\r",
    b"t1009001122334455667788\r",
    b"\x00" * 500,
]


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_never_raises_and_the_next_frame_arrives(adapter: Adapter, damage: bytes) -> None:
    bus = BufferedSlcanBus(adapter.path)
    adapter.write(damage + b"\rt12316A\r" + damage + b"\rt12417B\r")
    received = [bus.recv(2.0), bus.recv(2.0)]
    assert [(m.arbitration_id, bytes(m.data)) for m in received if m] == [(0x123, b"\x6a"), (0x124, b"\x7b")]
    assert sum(bus.counts.rejected.values()) == 2
    bus.shutdown()


def test_what_is_sent_is_received_too_where_it_is_wanted(adapter: Adapter) -> None:
    sent = can.Message(arbitration_id=0x300, data=[2, 1, 3], is_extended_id=False)
    with can.Bus(adapter.path, interface="gyrobench_slcan", receive_own_messages=True) as bus:
        before_s = epoch_seconds()
        bus.send(sent)
        own = bus.recv(0.0)
        assert (
            own is not None
            and own is not sent
            and own.equals(sent, timestamp_delta=None, check_direction=False)
        )
        assert not own.is_rx and before_s - 1.0 < own.timestamp < epoch_seconds() + 1.0
    with can.Bus(adapter.path, interface="gyrobench_slcan") as bus:
        bus.send(sent)
        assert bus.recv(0.0) is None


def test_filters_and_timeout(adapter: Adapter) -> None:
    wanted = [{"can_id": 0x122, "can_mask": 0x7FF, "extended": False}]
    clock = StillClock()
    bus = BufferedSlcanBus(adapter.path, clock=clock, can_filters=wanted)
    bus.link.deliver(b"t1210\rT000001220\rt1220\rt1230\r", 0.0)
    message = bus.recv(60.0)
    assert message is not None
    assert (message.arbitration_id, message.is_extended_id) == (0x122, False)
    assert bus.recv(60.0) is None
    assert clock.time_s == 60.0
    bus.shutdown()
    clock.close()


def test_time_stamps_are_arrivals_on_the_given_clock(adapter: Adapter) -> None:
    """Lines are stamped with the arrival of the block that ended them, even if read later."""
    clock = StillClock()
    bus = BufferedSlcanBus(adapter.path, clock=clock)
    bus.link.deliver(b"t1230\rt12", 10.0)
    bus.link.deliver(b"40\rt1250\r", 11.0)
    assert bus.link.read_until(b"\r", 1.0) == b"t1230\r"
    bus.link.deliver(b"t1260\r", 12.0)
    clock.time_s = 50.0
    bus.link.deliver(b"t1270\r", 50.0)
    messages = [bus.recv(1.0) for _ in range(4)]
    assert [(m.arbitration_id, m.timestamp) for m in messages if m] == [
        (0x124, 11.0),
        (0x125, 11.0),
        (0x126, 12.0),
        (0x127, 50.0),
    ]
    bus.shutdown()
    clock.close()


def test_streaming_bytes_go_to_the_tap_alone(adapter: Adapter) -> None:
    clock, tap = StillClock(), Recorder()
    bus, link = open_can("gyrobench_slcan", adapter.path, 500_000, clock, "gyro", tap=tap)
    assert tap.written == [b"C\rS6\rO\r"]
    link.streaming = True
    link.deliver(b"t1230\r", 0.0)
    assert bus.recv(1.0) is None
    assert tap.blocks == [(b"t1230\r", 0.0)]
    link.close()
    adapter.expect(b"C\rS6\rO\rC\r")
    link.close()
    bus.shutdown()
    adapter.expect(b"")
    clock.close()


def test_a_port_that_is_gone(adapter: Adapter) -> None:
    bus = BufferedSlcanBus(adapter.path)
    adapter.unplug()
    with pytest.raises(LinkLost):
        bus.recv(1.0)
    bus.shutdown()
    bus.shutdown()


def test_bad_settings(adapter: Adapter, clock: WallClock) -> None:
    with pytest.raises(ConfigurationError, match="33333"):
        BufferedSlcanBus(adapter.path, bitrate=33_333)
    adapter.expect(b"")
    with pytest.raises(ConfigurationError, match="cannot be opened"):
        BufferedSlcanBus("/dev/no-such-port", clock=clock)
    with pytest.raises(ConfigurationError, match="cannot be opened"):
        open_can("no-such-interface", "x", 500_000, clock, "gyro")


def test_what_classic_can_cannot_carry_is_refused(adapter: Adapter) -> None:
    bus = BufferedSlcanBus(adapter.path)
    for message in (can.Message(is_fd=True, data=bytes(12)), can.Message(is_error_frame=True)):
        with pytest.raises(LimitExceeded):
            bus.send(message)
    bus.shutdown()
    adapter.expect(b"C\rS6\rO\rC\r")


@pytest.mark.parametrize(
    "message",
    [
        can.Message(is_fd=True, data=bytes(12)),
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=1, is_extended_id=False, dlc=12, is_remote_frame=True),
    ],
)
def test_what_cannot_be_sent_is_an_error_of_python_can_too(adapter: Adapter, message: can.Message) -> None:
    """python-can's users catch can.CanError, as in its own back-to-back tests."""
    with BufferedSlcanBus(adapter.path) as bus, pytest.raises(can.CanError):
        bus.send(message)
    with pytest.raises(can.CanError):
        can.Bus(interface="gyrobench_slcan", channel=adapter.path, fd=True)


def test_python_cans_own_programs_open_the_interface(adapter: Adapter) -> None:
    """`python -m can.logger -i gyrobench_slcan -c PORT -b 250000` builds its bus like this."""
    parser = argparse.ArgumentParser()
    can.cli.add_bus_arguments(parser)
    asked = parser.parse_args(["-i", "gyrobench_slcan", "-c", adapter.path, "-b", "250000"])
    with can.cli.create_bus_from_namespace(asked) as bus:
        assert isinstance(bus, BufferedSlcanBus)
        adapter.expect(b"C\rS5\rO\r")


def test_notifier_with_an_event_loop_misses_no_frame(adapter: Adapter) -> None:
    """A block of many frames arrives at once; a notifier that selected on the port would hand over the first."""
    bus = BufferedSlcanBus(adapter.path)

    async def listen() -> list[int]:
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
        adapter.write(b"".join(b"t%03X0\r" % n for n in range(20)))
        seen = [(await asyncio.wait_for(reader.get_message(), 10.0)).arbitration_id for _ in range(20)]
        notifier.stop()
        return seen

    assert asyncio.run(listen()) == list(range(20))
    bus.shutdown()


def test_a_virtual_bus_as_a_link(clock: WallClock) -> None:
    tap = Recorder()
    bus, link = open_can("virtual", "bench", 500_000, clock, "gyro", tap=tap)
    other = can.Bus(interface="virtual", channel="bench")
    assert isinstance(link, MessageLink)
    other.send(can.Message(is_error_frame=True))
    other.send(can.Message(arbitration_id=0x122, is_extended_id=False, data=b"\x64\0\x06\xff\xe8\x03"))
    other.send(can.Message(arbitration_id=0x18FEF100, is_remote_frame=True, dlc=3))
    expected = b"t1226640006FFE803\rR18FEF1003\r"
    assert link.read_exactly(29, 5.0) == expected
    assert link.bytes_received == 29
    assert link.left_out == {"error_frame": 1}
    assert b"".join(data for data, _ in tap.blocks) == expected
    link.write(b"t1232AABB\rT0000000111A\r")
    answers = [other.recv(5.0), other.recv(5.0)]
    assert [(m.arbitration_id, m.is_extended_id, bytes(m.data)) for m in answers if m] == [
        (0x123, False, b"\xaa\xbb"),
        (1, True, b"\x1a"),
    ]
    assert tap.written == [b"t1232AABB\rT0000000111A\r"]
    for text in (b"t1232AA\r", b"t1232AABB", b"O\r"):
        with pytest.raises(ProtocolError):
            link.write(text)
    assert bus.channel_info in link.url
    link.close()
    link.close()
    other.shutdown()


def test_many_messages_through_the_thread_in_order(clock: WallClock) -> None:
    """More than a pair of sockets holds: the reading thread waits for room, and nothing is lost."""
    _, link = open_can("virtual", "full", 500_000, clock, "gyro")
    other = can.Bus(interface="virtual", channel="full")
    for number in range(20_000):
        other.send(can.Message(arbitration_id=number, data=bytes(8)))
    text = link.read_exactly(20_000 * 27, 20.0)
    assert text == b"".join(b"T%08X8%016d\r" % (number, 0) for number in range(20_000))
    for number in range(20_000):
        other.send(can.Message(arbitration_id=number, data=bytes(8)))
    link.close()  # with the sockets full and the thread waiting
    other.shutdown()


@pytest.mark.parametrize(
    "error", [NameError("no canOpen"), ImportError("no ics"), AttributeError("no windll")]
)
def test_an_interface_whose_library_is_missing_is_refused_in_words(
    clock: WallClock, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """Kvaser's raises the first without its library, neoVI's the second."""

    def bus(**_: object) -> None:
        raise error

    monkeypatch.setattr(can, "Bus", bus)
    with pytest.raises(ConfigurationError, match="the CAN bus cannot be opened") as refused:
        open_can("kvaser", "0", 500_000, clock, "fog_1")
    said = refused.value
    assert said.where == "fog_1 (kvaser, 0)"
    assert said.found == f"the library of interface 'kvaser' is not here ({error})"
    assert said.expected and "its maker's library" in said.remedy


class SocketBus(can.BusABC):
    """A bus with a descriptor, as socketcan is: each datagram is a message."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.channel_info = "socket"
        super().__init__("socket")

    def fileno(self) -> int:
        return self.descriptor

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            datagram = os.read(self.descriptor, 1)
        except BlockingIOError:
            return None, False
        if not datagram:
            raise can.CanOperationError("the network is down")
        return can.Message(arbitration_id=datagram[0], is_extended_id=False), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("the network is down")


def test_a_bus_with_a_descriptor_needs_no_thread(clock: WallClock) -> None:
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    link = MessageLink(SocketBus(reading), clock, name="gyro")
    assert link.fileno() == reading
    os.write(writing, b"\x01\x02")
    assert link.read_until(b"\r", 5.0) == b"t0010\r"
    assert link.read_until(b"\r", 5.0) == b"t0020\r"
    with pytest.raises(DeviceSilent):
        link.read_until(b"\r", 0.0)
    with pytest.raises(LinkLost, match="network is down"):
        link.write(b"t1230\r")
    os.close(writing)
    with pytest.raises(LinkLost, match="network is down"):
        link.read_until(b"\r", 5.0)
    link.close()
    os.close(reading)


def test_a_bus_that_fails_in_the_thread(clock: WallClock) -> None:
    class FailingBus(SocketBus):
        def fileno(self) -> int:
            raise NotImplementedError

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            raise IndexError("string index out of range")  # python-can 4.6.1 slcan on a cut line

    link = MessageLink(FailingBus(-1), clock, name="gyro")
    with pytest.raises(LinkLost, match="string index"):
        link.read_until(b"\r", 5.0)
    link.close()
