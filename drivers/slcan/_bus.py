"""An slcan adapter as a python-can bus that reads in blocks and survives damaged lines."""

from __future__ import annotations

import contextlib
import copy
from collections import deque

import numpy as np
from numpy.typing import NDArray

from drivers.base.clock import Clock, WallClock, epoch_seconds
from drivers.base.errors import LinkLost
from drivers.kit.instruments import StreamCounts
from drivers.kit.link import Link, Tap
from drivers.kit.python_can import can
from drivers.kit.slcan_codec import CLOSE, OPEN, SlcanParser, bitrate_command
from drivers.slcan._python_can import NotClassicCan, encode_message, to_messages

INTERFACE = "gyrobench_slcan"
"""Name under which python-can finds `BufferedSlcanBus`."""

_FOREVER_S = 3600.0


class _AdapterLink(Link):
    """A link that knows when its unread bytes came, opens the adapter's channel and closes it before the port."""

    def __init__(
        self, url: str, clock: Clock, *, name: str, tap: Tap | None, baudrate: int, setup: bytes
    ) -> None:
        self._queued = 0
        self._blocks: deque[tuple[int, float]] = deque()
        self._setup = setup
        super().__init__(url, clock, name=name, tap=tap, baudrate=baudrate)
        self._open_channel()

    def reopen(self) -> None:
        """Open port and channel anew: an adapter that was pulled has forgotten its bit rate."""
        super().reopen()
        self._queued = 0
        self._blocks.clear()
        self._open_channel()

    def _open_channel(self) -> None:
        try:
            self.write(CLOSE + self._setup + OPEN)
        except LinkLost:
            super().close()
            raise

    def deliver(self, data: bytes, arrival_s: float) -> None:
        """Hand received bytes on as `Link` does, and note when those came that wait to be read."""
        super().deliver(data, arrival_s)
        if not self.streaming:
            self._queued += len(data)
            self._blocks.append((self._queued, arrival_s))
        read = self._queued - len(self._buffer)
        while self._blocks and self._blocks[0][0] <= read:
            self._blocks.popleft()

    def take(self) -> tuple[bytes, NDArray[np.int64], NDArray[np.float64]]:
        """Return the unread bytes, and ends (from the first) and arrivals of the blocks they came in."""
        read = self._queued - len(self._buffer)
        blocks = [(end - read, arrival_s) for end, arrival_s in self._blocks if end > read]
        ends, arrivals_s = zip(*blocks, strict=True) if blocks else ((), ())
        return self.discard(), np.array(ends, np.int64), np.array(arrivals_s, np.float64)

    def close(self) -> None:
        """Close the adapter's channel and the port; never raises, and may be called again."""
        if not self._port.is_open:
            return
        with contextlib.suppress(LinkLost):
            self.write(CLOSE)
        super().close()


class BufferedSlcanBus(can.BusABC):  # type: ignore[misc]  # python-can is Any to our type checker
    """An slcan adapter on a serial port or pyserial URL.

    `bitrate` in bit/s; `baudrate` of the serial port; `name` names the port in messages and on the clock. Without
    a `clock` the bus keeps a wall clock of its own, and `Message.timestamp` is seconds since 1970 as python-can
    users expect; with one it is bench time. Either is the arrival of the line's last byte.

    Lines that are no frames are counted in `counts.rejected` by reason and never raise. `recv` raises LinkLost
    when the port is gone. While `link.streaming` is set, bytes go to the link's tap only and `recv` gets nothing.
    Construction raises ConfigurationError for a bit rate that slcan does not define or a port that cannot be
    opened, and NotClassicCan with `fd`. `single_handle` is told to every interface by python-can's own programs
    (`can.logger -i gyrobench_slcan`), and means nothing to a serial port. `receive_own_messages`: what is sent is
    received, too, with `is_rx` false, once the port has taken it. There is no `fileno`: frames wait in this
    object after the port was read, so that selecting on the port would miss them (python-can's Notifier then
    uses a thread).
    """

    def __init__(
        self,
        channel: str,
        bitrate: int = 500_000,
        clock: Clock | None = None,
        name: str | None = None,
        *,
        baudrate: int = 115_200,
        tap: Tap | None = None,
        can_filters: can.typechecking.CanFilters | None = None,
        fd: bool = False,
        single_handle: bool = True,
        receive_own_messages: bool = False,
    ) -> None:
        if fd:
            raise NotClassicCan(
                "slcan carries no CAN FD",
                where=name or str(channel),
                expected="classic CAN",
                remedy="leave fd out, or use a CAN interface of python-can that carries it",
            )
        setup = bitrate_command(bitrate, where=name or str(channel))
        self._owns_clock = clock is None
        self._clock: Clock = WallClock() if clock is None else clock
        self._time_offset = epoch_seconds() - self._clock.now() if clock is None else 0.0
        self._own = receive_own_messages
        self._parser = SlcanParser()
        self._messages: deque[can.Message] = deque()
        self.channel_info = f"slcan adapter on {channel}"
        self.link = _AdapterLink(
            channel, self._clock, name=name or str(channel), tap=tap, baudrate=baudrate, setup=setup
        )
        super().__init__(channel, can_filters=can_filters)

    @property
    def counts(self) -> StreamCounts:
        """Frames received, and lines rejected by reason."""
        return self._parser.counts

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next message that passes the filters, or None after `timeout` seconds of the bus's clock.

        python-can's own `recv` measures the time-out on the host's clock, which stands still in an emulated lab.
        """
        deadline_s = None if timeout is None else self._clock.now() + timeout
        while True:
            if not self._messages:
                self._parse()  # bytes that came while somebody else waited on the clock
            if not self._messages:
                until_s = self._clock.now() + _FOREVER_S if deadline_s is None else deadline_s
                self._clock.wait_for(self.link, until_s)
                self._parse()
            while self._messages:
                message = self._messages.popleft()
                if self._matches_filters(message):
                    return message
            if deadline_s is not None and self._clock.now() >= deadline_s:
                return None

    def _parse(self) -> None:
        data, block_ends, arrivals_s = self.link.take()
        if not data:
            return
        start = self._parser.bytes_received
        frames = self._parser.feed(data)
        block = np.searchsorted(block_ends, frames["end_offset"] - start)
        self._messages.extend(to_messages(frames, arrivals_s[block] + self._time_offset))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message; NotClassicCan for one that classic CAN cannot carry. `timeout` is the link's own."""
        self.link.write(encode_message(msg))
        if self._own:
            sent = copy.deepcopy(msg)
            sent.timestamp, sent.is_rx = self._clock.now() + self._time_offset, False
            self._messages.append(sent)

    def shutdown(self) -> None:
        """Close the channel and the port; never raises for a port that is already gone."""
        if not self._is_shutdown:
            super().shutdown()
            self.link.close()
            if self._owns_clock:
                self._clock.close()
