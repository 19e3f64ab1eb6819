"""The errors of this project: each says what happened, what was found, what was expected, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class BenchError(Exception):
    """Base of every error this project raises on purpose.

    `what` is one sentence; `where`, `found`, `expected` and `remedy` complete the paragraph that the
    operator reads. Empty parts are left out of the text.
    """

    def __init__(
        self, what: str, *, where: str = "", found: str = "", expected: str = "", remedy: str = ""
    ) -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.found = found
        self.expected = expected
        self.remedy = remedy

    def __str__(self) -> str:
        parts = [f"{self.where}: {self.what}" if self.where else self.what]
        for label, text in (("Found", self.found), ("Expected", self.expected), ("Remedy", self.remedy)):
            if text:
                parts.append(f"{label}: {text}")
        return " ".join(part if part.endswith((".", "!", "?")) else part + "." for part in parts)


class ConfigurationError(BenchError):
    """A bench file, parameter or command line that cannot be used."""


class BenchInUse(BenchError):
    """Somebody else has the bench."""


class LinkLost(BenchError):
    """The port went away: unplugged adapter, closed connection, dead emulator."""


class DeviceSilent(BenchError):
    """No complete reply before the deadline."""


class DeviceRefused(BenchError):
    """The device answered, and the answer was no."""


class WrongDevice(BenchError):
    """Something answers on the port, but it is not the device the bench file names."""


class ProtocolError(BenchError):
    """Bytes that break the device's own protocol: checksum, framing, field count."""


class LimitExceeded(BenchError):
    """A demand outside the limits of the device, the bench file or the procedure."""


class RunAborted(BenchError):
    """The run was stopped by the operator, a signal or an interlock; the bench has been made safe."""


class RecordError(BenchError):
    """A run folder that cannot be written or that does not verify."""


class RunUnsealed(RecordError):
    """A run that ended, its bench made safe as far as the text says, and whose folder could not be closed."""


def one_of(found: str, names: Iterable[str]) -> str:
    """Return "one of a, b, c" for what was expected, with the nearest to `found` pointed out."""
    names = sorted(names)
    near = difflib.get_close_matches(found, names, n=1)
    suggestion = f" (did you mean {near[0]!r}?)" if near else ""
    return f"{'one of ' if len(names) > 1 else ''}{', '.join(names)}{suggestion}"
