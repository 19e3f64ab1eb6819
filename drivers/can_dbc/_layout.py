"""What a CAN gyro sends, compiled from DBC and mapping: plain data that decoder, driver and emulator share.

A layout goes into the record of a run as it is (`layout_to_plain`), so that a run can be decoded anywhere,
without its DBC file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from drivers.base.errors import ConfigurationError
from drivers.can_dbc._signals import MessageLayout, SignalLayout

AXES = "xyz"

Role = Literal["rate", "delta_angle", "accel", "temperature", "case_temperature", "time", "counter", "status"]


@dataclass(frozen=True)
class Slot:
    """One frame of a sample: a message, or the frames of it whose multiplexer has value `selection`."""

    message: str
    selection: int | None = None


@dataclass(frozen=True)
class SignalUse:
    """What a signal is. Physical value * `factor` + `zero` is in deg/s, deg, m/s2, degC, s or counts.

    `raw_range`: raw values outside it mean "not available". `modulo`: where a counter or time wraps, in raw
    steps. `step`: raw steps of a counter from sample to sample. `healthy`: the status an emulated unit sends.
    """

    role: Role
    message: str
    signal: str
    axis: str = ""
    factor: float = 1.0
    zero: float = 0.0
    raw_range: tuple[int, int] | None = None
    modulo: int = 0
    step: int = 1
    healthy: int = 0


@dataclass(frozen=True)
class ValidRule:
    """A sample is good only if (raw & `mask`) == `equals`; only those with `axis` in use, if one is named."""

    message: str
    signal: str
    mask: int
    equals: int
    axis: str = ""


@dataclass(frozen=True)
class CanLayout:
    """Messages of one kind of unit and what their signals are.

    `sample`: the frames that make one sample, in the order in which they come. Signals of other messages hold
    their last value. `known`: (identifier, mask, extended) of every message of the DBC file.
    """

    name: str
    maker: str
    model: str
    dbc: str
    dbc_sha256: str
    messages: Mapping[str, MessageLayout]
    sample: tuple[Slot, ...]
    uses: tuple[SignalUse, ...]
    valid: tuple[ValidRule, ...]
    known: tuple[tuple[int, int, bool], ...]

    def signal(self, use: SignalUse | ValidRule) -> SignalLayout:
        """Return where a signal lies."""
        return self.messages[use.message].signals[use.signal]

    def use(self, *roles: Role) -> SignalUse | None:
        """Return the signal with one of these roles, if there is one."""
        return next((use for use in self.uses if use.role in roles), None)

    def rates(self) -> dict[str, SignalUse]:
        """Return the rate (or angle increment) of each axis, in the order x, y, z."""
        found = {use.axis: use for use in self.uses if use.role in ("rate", "delta_angle")}
        return {axis: found[axis] for axis in AXES if axis in found}

    def accelerations(self) -> dict[str, SignalUse]:
        """Return the specific force of each axis that the unit measures, in the order x, y, z."""
        found = {use.axis: use for use in self.uses if use.role == "accel"}
        return {axis: found[axis] for axis in AXES if axis in found}

    def slot_of(self, use: SignalUse | ValidRule) -> int | None:
        """Return which frame of a sample carries a signal, None for one that holds its last value."""
        for at, slot in enumerate(self.sample):
            if slot.message == use.message and self._carries(slot, self.signal(use)):
                return at
        return None

    def selector(self, slot: Slot) -> SignalLayout | None:
        """Return the multiplexer that a slot's `selection` is a value of."""
        if slot.selection is None:
            return None
        return outer_multiplexer(self.messages[slot.message])

    @staticmethod
    def _carries(slot: Slot, signal: SignalLayout) -> bool:
        return slot.selection is None or not signal.selectors or slot.selection in signal.selectors[0][1]


def outer_multiplexer(message: MessageLayout) -> SignalLayout | None:
    """Return the multiplexer that others in `message` depend on first, None if nothing is multiplexed."""
    return next((signal.selectors[0][0] for signal in message.signals.values() if signal.selectors), None)


def layout_to_plain(layout: CanLayout) -> dict[str, Any]:
    """Return a layout as plain JSON values."""
    plain: dict[str, Any] = _adapter().dump_python(layout, mode="json", exclude_none=True)
    return plain


def layout_from_plain(plain: Mapping[str, Any]) -> CanLayout:
    """Restore what `layout_to_plain` gave; ConfigurationError for anything else."""
    try:
        return _adapter().validate_python(plain)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(
            "the CAN layout kept with the bench file cannot be used",
            found=f"{'.'.join(map(str, first['loc']))}: {first['msg']}",
            expected="a layout as this version writes it",
        ) from error


@cache
def _adapter() -> TypeAdapter[CanLayout]:
    return TypeAdapter(CanLayout)
