"""Which known device answers on a port: listen first, then ask with queries that only read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from drivers.base.clock import Clock
from drivers.base.errors import BenchError, ConfigurationError, LinkLost
from drivers.kit.instruments import Identity, Instrument
from drivers.kit.kinds import Connection, Probe
from drivers.kit.link import Link
from drivers.kit.places import is_serial, is_visa
from drivers.kit.registry import DRIVERS, instrument_roles, registered

LISTEN_S = 1.5
LISTEN_BAUDS = (921_600, 460_800, 115_200, 9600)
OTHER_BAUDS = (4800, 9600, 19_200, 38_400, 57_600, 115_200)
OTHER_ADDRESSES = range(9)
_QUIET_S = 0.3
_ENOUGH = 3
_COVERED = 0.8


@dataclass(frozen=True)
class Finding:
    """What answers on a port: its driver, empty if nothing known does, and who it says it is."""

    port: str
    driver: str
    text: str


def identify_port(
    port: str, clock: Clock, say: Callable[[str], None], name: str = "port", *, thorough: bool = False
) -> Finding:
    """Return what answers on `port`, or why nothing can; `say(text)` is told what is being tried.

    `name`: what the clock calls the port, if that is an emulated lab's. `thorough`: ask, if nothing answers, at
    other baud rates and bus addresses too, which takes minutes.
    """
    try:
        heard, baudrate = (b"", 0) if is_visa(port) else _listen(port, clock, say, name)
    except BenchError as error:
        return Finding(port, "", f"cannot be opened: {error.found or error}")
    if heard:
        found = _streaming(port, heard, baudrate)
        return found or Finding(port, "", f"sends what no gyro known here sends: {heard[:16].hex(' ')} ...")
    polled = () if is_visa(port) else ("table", "chamber")  # VISA serves instruments only
    asked = _probes(*polled, *instrument_roles())
    for name_of_kind, kind, probe in [*asked, *(_others(asked, port) if thorough else ())]:
        say(" ".join([f"{port}: {name_of_kind} at {probe.baudrate} Bd", *_numbers(probe)]))
        try:
            identity = _ask(name_of_kind, kind, probe, port, Connection(name, clock, None))
        except (ConfigurationError, LinkLost) as error:
            return Finding(port, "", f"lost: {error.found or error}")
        except BenchError:
            continue
        device = " ".join(part for part in (identity.maker, identity.model, identity.serial_number) if part)
        more = "".join(f", {key}" for key in _numbers(probe))
        at = f"{probe.baudrate} Bd" if is_serial(port) else "TCP" if "://" in port else "VISA"
        return Finding(port, name_of_kind, f"{device} ({at}{more})")
    more = "" if thorough else "; --thorough asks at other baud rates and addresses"
    return Finding(port, "", f"nothing known answers{more}")


def _numbers(probe: Probe) -> list[str]:
    keys = {key: value for key, value in probe.keys.items() if isinstance(value, bool | int)}
    return [f"{key} = {str(value).lower()}" for key, value in keys.items()]


def _others(asked: list[tuple[str, Any, Probe]], port: str) -> list[tuple[str, Any, Probe]]:
    """Return the same questions at other baud rates of a serial port, then at other addresses of a bus."""
    known = {(name, probe.baudrate) for name, _, probe in asked}
    bauds = OTHER_BAUDS if is_serial(port) else ()
    return [
        (name, kind, replace(probe, baudrate=baud))
        for baud in bauds
        for name, kind, probe in asked
        if (name, baud) not in known
    ] + [
        (name, kind, replace(probe, keys={**probe.keys, "address": address}))
        for address in OTHER_ADDRESSES
        for name, kind, probe in asked
        if any(field.name == "address" for field in fields(kind.config))
    ]


def _listen(port: str, clock: Clock, say: Callable[[str], None], name: str) -> tuple[bytes, int]:
    """Return what arrives by itself, at the first baud rate at which its frames are known, else at the last."""
    heard, baudrate = b"", 0
    for baudrate in LISTEN_BAUDS if is_serial(port) else LISTEN_BAUDS[:1]:
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
    for name_of_kind, kind, probe in _probes("gyro"):
        try:
            section = kind.config(
                name="unit", driver=name_of_kind, unit="?", port=port, baudrate=baudrate, **probe.keys
            )
            decoder = kind.decoder(section)
        except BenchError:  # a description without that axis
            continue
        decoder.feed(heard)
        counts = decoder.counts
        rejected = sum(counts.rejected.values())
        covered = len(heard) - counts.bytes_skipped
        if counts.frames >= _ENOUGH and rejected < counts.frames and covered > best[0]:
            text = f"streams {name_of_kind} {probe.name}".strip() + f": {counts.frames} frames "
            text += "(TCP)" if "://" in port else f"({baudrate} Bd)"
            best = (covered, name_of_kind, text)
    return Finding(port, best[1], best[2]) if best[0] >= _COVERED * len(heard) else None


def _probes(*roles: str) -> list[tuple[str, Any, Probe]]:
    """Return (name of the kind, kind, probe) of all drivers of the roles in order of rank."""
    kinds = [(name, point.load()) for role in roles for name, point in registered(DRIVERS, role).items()]
    found = [(name, kind, probe) for name, kind in kinds for probe in kind.probes()]
    return sorted(found, key=lambda entry: entry[2].rank)


def _ask(name_of_kind: str, kind: Any, probe: Probe, port: str, connection: Connection) -> Identity:
    config = kind.config(driver=name_of_kind, port=port, baudrate=probe.baudrate, **probe.keys)
    device: Instrument = kind.open(config, connection)
    device.link.retries = 0  # silence is the usual answer here
    try:
        if probe.ends_line:
            device.link.write(b"\r\n")
            device.link.read_some(_QUIET_S)
            device.link.discard()
        return device.identify()
    finally:
        device.link.close()
