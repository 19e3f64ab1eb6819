"""What drivers of polled instruments do alike: who is there, the questions of a state, a halt."""

from __future__ import annotations

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import TypeVar

from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.kit.instruments import Identity, TableState, Turntable
from drivers.kit.link import Link
from drivers.kit.retry import command_once, query_with_retry

TROUBLES = (DeviceRefused, DeviceSilent, ProtocolError)
"""What one command of several may meet without keeping the others from being sent."""
REST_DPS = 0.01
"""Below this an axis stands still; a rate estimate has noise of some 1e-4 deg/s."""
_TAKEN_DEG = 1e-3
"""A turn that was begun shows by more than this."""
_T = TypeVar("_T")


class PolledInstrument(ABC):
    """The part of an instrument (`drivers.kit.instruments.Instrument`) that is the same for every controller.

    In words: `_product` is what `identify` looks for, `_known_by` what shows it, `_check` what to do if that is
    missing; `_wrong_if` are the errors that tell another device. `_answer_end`, `_answer_s`: how the answer to
    the first question of a state ends, and how long it may take.
    """

    _product = "an instrument"
    _known_by = "its answers"
    _check = "check which device the bench file names for this port"
    _wrong_if: tuple[type[BenchError], ...] = (ProtocolError, DeviceRefused)
    _answer_end = b"\r"
    _answer_s = 2.0

    def __init__(self, link: Link) -> None:
        self.link = link
        self._state_asked = False
        self._halted = False
        link.fence = self.in_step

    @abstractmethod
    def _introduction(self) -> Identity:
        """Ask who it is; any of `TROUBLES` if it is something else."""

    @abstractmethod
    def _send_stop(self) -> None:
        """Write what brings it to rest, closing a command that was cut off halfway, and wait for nothing."""

    def identify(self) -> Identity:
        """Ask who it is; WrongDevice if it is something else, DeviceSilent if nothing answers."""
        self.link.discard()
        try:
            return self._introduction()
        except self._wrong_if as error:
            raise self._wrong_device(error.found or str(error)) from error
        except DeviceSilent as error:
            if not (seen := self._seen(error)):
                raise
            raise self._wrong_device(seen) from error

    def in_step(self) -> bool:
        """Ask what has an answer unlike any other; return whether that was the first to come.

        If not, the line was late, and telemetry belonged to earlier questions; now it is in step. True where the
        protocol has no such question, or numbers its answers. DeviceSilent or ProtocolError if the answer does
        not come.
        """
        return True

    def halt(self) -> None:
        """Write what brings it to rest and wait for nothing."""
        self._state_asked = False
        self.link.discard()
        self._send_stop()
        self._halted = True

    def _once_halted(self) -> None:
        """Halt, unless that has been done: what comes next confirms it."""
        if not self._halted:
            self.halt()
        self._halted = False

    def _carry_out_all(self, steps: Iterable[Callable[[], None]]) -> None:
        """Carry out every step, whatever becomes of those before it, then raise the first of their troubles."""
        problems: list[BenchError] = []
        self.link.retrying = True  # whoever makes a bench safe goes from device to device, and comes back
        try:
            for step in steps:
                try:
                    step()
                except TROUBLES as error:
                    problems.append(error)
        finally:
            self.link.retrying = False
        if problems:
            raise problems[0]

    def _seen(self, error: DeviceSilent) -> str:
        """Return what came of an answer that was not complete, empty if nothing."""
        seen = self.link.discard()
        return repr(seen[:60]) if seen else ""

    def _ask_state(self, question: bytes) -> None:
        """Write the first question of a state and wait for nothing; `_collected` takes the answer."""
        self._settle_input()
        self.link.write(question)
        self._state_asked = True

    def _collected(self, ask: Callable[[], None], take: Callable[[], _T]) -> _T:
        """Return what `take` makes of the answer to a state's first question; `ask` again if it is damaged."""

        def collect() -> _T:
            if not self._state_asked:
                ask()
            self._state_asked = False
            return take()

        return query_with_retry(self.link, collect)

    def _settle_input(self) -> None:
        """Take the answer to a state question nobody read, then drop late answers."""
        if self._state_asked:
            self._state_asked = False
            with contextlib.suppress(DeviceSilent):
                self.link.read_until(self._answer_end, self._answer_s)
        self.link.discard()

    @property
    def _where(self) -> str:
        return self.link.where

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            f"not {self._product}",
            where=self._where,
            found=found,
            expected=self._known_by,
            remedy=self._check,
        )


class PolledTable(PolledInstrument, Turntable):
    """The part of a rate table (`drivers.kit.instruments.Turntable`) that is the same for every controller."""

    def state(self) -> TableState:
        """Read angle and rate."""
        self.request_state()
        return self.read_state()

    def _turn_once(
        self,
        tell: Callable[[], None],
        before_deg: float,
        angle_deg: Callable[[], float],
        rate_dps: Callable[[], float],
    ) -> None:
        """Tell a turn that must not be told twice: it was begun if the axis has moved or moves."""

        def begun() -> bool:
            moved_deg = math.remainder(angle_deg() - before_deg, 360.0)
            return abs(moved_deg) > _TAKEN_DEG or abs(rate_dps()) >= REST_DPS

        command_once(self.link, tell, begun)

    def _require_axis(self, axis: str) -> str:
        """Return the name of an axis; "" is the last one, which carries the unit."""
        name = axis or self.axes[-1]
        if name not in self.axes:
            raise DeviceRefused(
                "the table has no such axis", where=self._where, found=name, expected=" or ".join(self.axes)
            )
        return name

    def _require_finite(self, value: float) -> None:
        if not math.isfinite(value):
            raise DeviceRefused(
                "a demand is not a number", where=self._where, found=str(value), expected="a finite number"
            )
