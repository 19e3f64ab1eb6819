"""Which known device answers on a port: listen first, then ask with queries that only read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from bench.control.devices import load_kind
from bench.record.benchfile import ChamberSection, GyroSection, TableSection
from drivers.base.clock import Clock
from drivers.base.errors import BenchError, ConfigurationError, LinkLost
from drivers.frames import shipped
from drivers.kit.instruments import Identity, Instrument
from drivers.kit.link import Link

LISTEN_S = 1.5
LISTEN_BAUDS = (921_600, 460_800, 115_200, 9600)
_QUIET_S = 0.3
_ENOUGH = 3
_COVERED = 0.8

_ASKED: tuple[tuple[str, str, int, dict[str, Any]], ...] = (
    ("table", "acutrol3000", 9600, {}),
    ("chamber", "weiss", 9600, {}),
    ("chamber", "weiss", 9600, {"simserv": False}),
    ("chamber", "espec_p300", 9600, {}),
    ("chamber", "espec_scp220", 9600, {}),
    ("table", "ideal_atl", 9600, {}),
    ("chamber", "watlow_f4", 19_200, {}),
    ("chamber", "watlow_f4", 9600, {}),
    ("chamber", "watlow_f4t", 9600, {}),
)
"""Role, kind, baud rate and settings. Text before Modbus, whose frames would lie in a text device's input.

Drivers of other packages are not asked: nothing says that their `identify` only reads. Nor are gyros, which must
be put into a configuration mode for it.
"""


class _Deaf:
    """A tap that records nothing."""

    def received(self, data: bytes, arrival_s: float) -> None:
        """Nothing."""

    def sent(self, data: bytes, time_s: float) -> None:
        """Nothing."""


@dataclass(frozen=True)
class Finding:
    """What answers on a port: its driver, empty if nothing known does, and who it says it is."""

    port: str
    driver: str
    text: str


def identify_port(port: str, clock: Clock, say: Callable[[str], None], name: str = "port") -> Finding:
    """Return what answers on `port`, or why nothing can; `say(text)` is told what is being tried.

    `name`: what the clock calls the port, if that is an emulated lab's.
    """
    try:
        heard, baudrate = _listen(port, clock, say, name)
    except BenchError as error:
        return Finding(port, "", f"cannot be opened: {error.found or error}")
    if heard:
        found = _streaming(port, heard, baudrate)
        return found or Finding(port, "", f"sends what no gyro known here sends: {heard[:16].hex(' ')} ...")
    for role, kind, baud, settings in _ASKED:
        say(f"{port}: {kind} at {baud} Bd")
        try:
            identity = _ask(role, kind, (name, port), clock, baud, settings)
        except (ConfigurationError, LinkLost) as error:
            return Finding(port, "", f"lost: {error.found or error}")
        except BenchError:
            continue
        name = " ".join(part for part in (identity.maker, identity.model, identity.serial_number) if part)
        more = "".join(f", {key} = {str(value).lower()}" for key, value in settings.items())
        at = "TCP" if "://" in port else f"{baud} Bd"
        return Finding(port, kind, f"{name} ({at}{more})")
    return Finding(port, "", "nothing known answers")


def _listen(port: str, clock: Clock, say: Callable[[str], None], name: str) -> tuple[bytes, int]:
    """Return what arrives by itself, at the first baud rate at which its frames are known, else at the last."""
    heard, baudrate = b"", 0
    for baudrate in LISTEN_BAUDS[:1] if "://" in port else LISTEN_BAUDS:
        say(f"{port}: listening at {baudrate} Bd")
        link = Link(port, clock, name=name, baudrate=baudrate)
        try:
            heard, end_s = b"", clock.now() + LISTEN_S
            while (left_s := end_s - clock.now()) > 0.0 and len(heard) < 65_536:
                heard += link.read_some(left_s)
        finally:
            link.close()
        if not heard or _streaming(port, heard, baudrate):
            break
    return heard, baudrate


def _streaming(port: str, heard: bytes, baudrate: int) -> Finding | None:
    """Return the gyro whose frames make up most of `heard`."""
    best: tuple[int, str, str] = (0, "", "")
    for kind, settings in _gyros():
        section = GyroSection(name="unit", driver=kind, unit="?", port=port, baudrate=baudrate, **settings)
        try:
            decoder = load_kind("gyro", kind).decoder(section.model_dump())
        except BenchError:  # a description without that axis
            continue
        decoder.feed(heard)
        counts = decoder.counts
        rejected = sum(counts.rejected.values())
        covered = len(heard) - counts.bytes_skipped
        if counts.frames >= _ENOUGH and rejected < counts.frames and covered > best[0]:
            name = settings.get("description") or settings.get("frame_format") or ""
            text = f"streams {kind} {name}".strip() + f": {counts.frames} frames "
            text += "(TCP)" if "://" in port else f"({baudrate} Bd)"
            best = (covered, kind, text)
    return Finding(port, best[1], best[2]) if best[0] >= _COVERED * len(heard) else None


def _gyros() -> Iterator[tuple[str, dict[str, Any]]]:
    for form in "ABC":
        yield "kvh1750", {"frame_format": form, "axis": "x", "axes": "xyz"}
    yield "rlg2t", {"axis": "x"}
    for name in shipped():
        for axis in "xz":
            yield "frames", {"description": name, "axis": axis, "axes": axis}


def _ask(
    role: str, kind: str, place: tuple[str, str], clock: Clock, baud: int, settings: dict[str, Any]
) -> Identity:
    name, port = place
    given = {"driver": kind, "port": port, "baudrate": baud, **settings}
    if role == "table":
        table = TableSection(**given)
        values = {**table.model_dump(), "axes": [axis.model_dump() for axis in table.all_axes]}
    else:
        values = {**ChamberSection(**given).model_dump(), "safe_set_point_c": 23.0}
    device: Instrument = load_kind(role, kind).open({"name": name, **values}, clock, _Deaf())
    device.link.repeats = 0  # silence is the usual answer here
    try:
        if not kind.startswith("watlow"):  # what the one asked before left in a text device's input ends here
            device.link.write(b"\r\n")
            device.link.read_some(_QUIET_S)
            device.link.discard()
        return device.identify()
    finally:
        device.link.close()
