"""What table and chamber have in common as places a procedure works at, and what they ask of their session."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from bench.control.history import History
from bench.record.benchfile import BenchFile
from bench.record.events import Event
from bench.record.events.run import Alarm, Invalid, Repeat
from bench.record.events.safe import LastSeen
from drivers.base.errors import ProtocolError
from drivers.kit.instruments import Instrument
from drivers.kit.retry import query_with_retry

_STEP_EVERY_S = 60.0


class Rules(Protocol):
    """The limits that demands are held against; `bench.control.limits.LimitWatch`."""

    def allow(
        self,
        what: str,
        *,
        rate_dps: float | None = None,
        way_deg: tuple[float, float] | None = None,
        set_point_c: float | None = None,
    ) -> None:
        """Raise LimitExceeded if a demand may break a rule of the bench file."""


class Session(Protocol):
    """What a station asks of the session it belongs to; `bench.control.session.Bench` is one."""

    @property
    def file(self) -> BenchFile:
        """The bench."""

    @property
    def limits(self) -> Rules:
        """The limits in force."""

    @property
    def now_s(self) -> float:
        """Bench time in s."""

    def event(self, event: Event) -> None:
        """Write a line to the event log."""

    def alert(self, event: Alarm | Invalid) -> None:
        """Write down what concerns the bench itself, and show it at once."""

    def poll(self) -> None:
        """Take telemetry of both instruments."""

    def wait_until(self, condition: Callable[[], bool], *, timeout_s: float, what: str) -> bool:
        """Wait until `condition` holds after a poll (True) or `timeout_s` passed (False)."""


class Station(ABC):
    """A polled instrument with its recent telemetry, its limits and the record."""

    name: str
    """What the record and the operator call it."""

    def __init__(self, session: Session, history: History) -> None:
        self._session = session
        self.history = history
        self._in_step_s = session.now_s

    @abstractmethod
    def _seen(self, row: dict[str, float], ago_s: float) -> LastSeen:
        """Return a row of telemetry as a fact."""

    def last_seen(self) -> LastSeen | None:
        """Return what telemetry said last; None before the first."""
        last = self.history.last
        return self._seen(last, self._session.now_s - last["time_s"]) if last else None

    def check_step(self, device: Instrument) -> None:
        """See once a minute that answers belong to their questions, where the device can be asked that.

        If not the run is invalid: its telemetry was that of earlier questions, and nobody knows since when. Once
        asked, the line is in step. One that does not even answer that in three tries ends the run.
        """
        in_step: Callable[[], bool] | None = getattr(device, "in_step", None)
        now_s, since_s, late = self._session.now_s, self._in_step_s, False
        if in_step is None or now_s - since_s < _STEP_EVERY_S:
            return

        def ask() -> None:
            nonlocal late
            try:
                late = not in_step() or late
            except ProtocolError:
                late = True
                raise

        try:
            query_with_retry(device.link, ask)
        finally:
            self._in_step_s = now_s
            if late:
                text = f"the {self.name} answered earlier questions, perhaps since {since_s:.0f} s"
                facts = {"device": self.name, "from_s": since_s}
                self._session.alert(Invalid("stale_telemetry", text, facts))

    def repeats(self, why: object) -> None:
        """Write down that an exchange is tried again, and why: what was received of it."""
        self._session.event(Repeat(self.name, str(why)))
