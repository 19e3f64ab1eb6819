"""Faults on the wire and in devices, as plain data: what happens to a port, when, and how much of it.

`simulators.lab` applies them between emulator and port; docs/faults.md is the operator's page.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from drivers.base.errors import ConfigurationError, one_of
from drivers.kit.config import key

WIRE_FAULTS: Mapping[str, str] = {
    "drop": "`count` bytes of a message are lost",
    "repeat": "`count` bytes of a message come twice",
    "flip": "`count` bits of a message are inverted",
    "noise": "`count` stray bytes come before a message",
    "truncate": "a message ends somewhere before its end",
    "bad_check": "the check value of a message is wrong, all else is intact",
    "double": "a message comes twice",
    "lose": "`count` whole messages are lost; a frame counter jumps by as many",
    "delay": "a message, and all behind it, comes `duration_s` late",
    "silence": "nothing comes for `duration_s`",
}
"""Faults that need nothing of the emulator but its wire shape. A message is a reply, or a frame of a stream."""

COMMAND_FAULTS: Mapping[str, str] = {
    "drop_command": "`count` bytes of what the bench writes are lost on the way to the device",
    "flip_command": "`count` bits of what the bench writes are inverted",
    "noise_command": "`count` stray bytes come before what the bench writes",
}
"""Faults on the way to the device. A message is what the bench writes at once: a command, as a rule."""

VANISH = "vanish"
"""The port goes away for `duration_s` and comes back under the same name: adapter pulled, connection reset."""

_LASTING = ("delay", "silence", VANISH)
_MUST_COUNT = ("drop", "repeat", "flip", "noise", "lose", *COMMAND_FAULTS)


@dataclass(frozen=True)
class Fault:
    """One fault of one port: a `[[fault]]` of a plant file, docs/faults.md has the kinds.

    When: at the lab times `at_s` (s), or at random `rate_per_h` times an hour on average (Poisson) between
    `start_s` and `end_s`. It strikes the first message whose last byte is sent at or after that instant; on
    the way to the device, the first that the bench writes then.
    `count`, `duration_s`, `factor` and `text` are what the kind makes of them.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = {"extra": "forbid"}

    port: str
    kind: str
    at_s: tuple[float, ...] = ()
    rate_per_h: float = key(default=0.0, ge=0, le=3.6e6, allow_inf_nan=False)
    start_s: float = key(default=0.0, ge=0, allow_inf_nan=False)
    end_s: float = key(default=1e12, gt=0, allow_inf_nan=False)
    count: int = key(default=1, ge=0)
    duration_s: float = key(default=0.0, ge=0, allow_inf_nan=False)
    factor: float = key(default=1.0, ge=0, allow_inf_nan=False)
    text: str = ""

    def check(
        self,
        device_faults: Mapping[str, object],
        wire: WireShape | None,
        texts: Mapping[str, Collection[str]] | None = None,
    ) -> None:
        """Raise ConfigurationError for a fault that this port cannot have.

        `texts`: by kind, what its `text` may be if it is not empty; a kind that is not there takes any.
        """
        known = [*WIRE_FAULTS, *COMMAND_FAULTS, VANISH, *device_faults]
        if self.kind not in known:
            raise self._unusable(f"kind {self.kind!r}", one_of(self.kind, known))
        if bool(self.at_s) == bool(self.rate_per_h):
            raise self._unusable(
                f"at_s {list(self.at_s)} and rate_per_h {self.rate_per_h:g}", "one of the two, not 0 or empty"
            )
        if self.kind in _LASTING and not self.duration_s > 0.0:
            raise self._unusable(f"duration_s {self.duration_s:g}", f"how long the {self.kind} lasts, in s")
        if self.kind in _MUST_COUNT and self.count < 1:
            raise self._unusable(f"count {self.count}", "1 or more")
        allowed = (texts or {}).get(self.kind)
        if self.text and allowed is not None and self.text not in allowed:
            raise self._unusable(f"{self.kind} with text {self.text!r}", one_of(self.text, allowed))
        if self.kind == "bad_check" and (wire is None or not wire.check_bytes):
            raise self._unusable("bad_check", "another kind: this device's messages carry no check value")

    def _unusable(self, found: str, expected: str) -> ConfigurationError:
        return ConfigurationError(
            "a fault cannot be emulated",
            where=f"plant file, fault of port {self.port!r}",
            found=found,
            expected=expected,
            remedy="docs/faults.md lists the kinds and their keys",
        )


@dataclass(frozen=True)
class WireShape:
    """How a device's messages look from outside, for faults that strike a whole one.

    A stream's frames are `frame_bytes` long or, when that is 0, end with `terminator`. `check_bytes`: length of
    the check value, 0 for none; it ends `tail_bytes` before the end of the message.
    """

    frame_bytes: int = 0
    terminator: bytes = b""
    check_bytes: int = 0
    tail_bytes: int = 0


DeviceFault = Callable[[Fault, float], None]
"""What a device does about a fault of its own kind at a lab time in s."""
