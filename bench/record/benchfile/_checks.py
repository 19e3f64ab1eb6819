"""What must agree between the sections of a bench file, checked on the raw data."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from bench.record.benchfile._drivers import ROLES, known_drivers, one_of
from bench.record.benchfile._model import LimitsSection, SafeSection
from drivers.stim300 import DATAGRAMS, RATES

_RESERVED_NAMES = ("table", "turntable", "chamber", "manifest", "events")
"""Words that name other files and ports of a run folder."""

_LINES = {"east": 0, "west": 0, "north": 1, "south": 1, "up": 2, "down": 2}

_ON_CAN = ("can_dbc", "sbg_ellipse")
_SHARED = ("socketcan", "socketcand", "udp_multicast", "virtual")
"""Interfaces of python-can whose channel several can have open; each then hears every unit on the bus."""

_WITHOUT_START_CHANNEL = ("espec_p300", "espec_scp220", "watlow_f4t")
_OUR_CHAMBERS = (*_WITHOUT_START_CHANNEL, "watlow_f4", "weiss")

_Devices = list[tuple[str, str, Mapping[str, Any]]]


@dataclass(frozen=True)
class Mistake:
    """One thing wrong with a bench file."""

    key: str
    found: str
    expected: str


def cross_checks(data: Mapping[str, Any], resolve_links: bool) -> Iterator[Mistake]:
    """Check keys against each other, on raw data so that one bad type hides nothing else.

    `resolve_links`: two names of one device on this machine are one port.
    """
    if not data.get("gyro") and not data.get("platform"):
        found = "an empty list" if "gyro" in data else "nothing"
        yield Mistake("gyro", found, "at least one [[gyro]] with name, driver, unit, axis and a port")
    devices = list(_devices(data))
    yield from _drivers(devices)
    yield from _names(devices)
    yield from _formats(devices)
    yield from _connections(devices)
    yield from _shared_ports(devices, resolve_links)
    yield from _sockets(devices)
    yield from _instruments(devices)
    yield from _axes_and_sensors(data, devices)
    yield from _limits(data)
    yield from _table_axes(data)
    yield from _door(data)


def _devices(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield (role, key, section) of every device section that is a table."""
    for role in ROLES:
        section = data.get(role)
        if isinstance(section, dict):
            yield role, role, section
        elif isinstance(section, list):
            for at, entry in enumerate(section):
                if isinstance(entry, dict):
                    yield role, f"{role}[{at}]", entry


def _drivers(devices: _Devices) -> Iterator[Mistake]:
    for role, key, section in devices:
        kind = section.get("driver")
        known = known_drivers(role)
        if isinstance(kind, str) and kind not in known:
            yield Mistake(f"{key}.driver", repr(kind), one_of(kind, known))


def _names(devices: _Devices) -> Iterator[Mistake]:
    seen: dict[str, str] = {}
    for role, key, section in devices:
        name = section.get("name")
        if role not in ("gyro", "platform") or not isinstance(name, str):
            continue
        if name in _RESERVED_NAMES:
            yield Mistake(f"{key}.name", repr(name), "a name that the run folder does not use itself")
        elif name in seen:
            yield Mistake(f"{key}.name", repr(name), f"a name of its own ({seen[name]} has this one)")
        seen.setdefault(name, key)


def _formats(devices: _Devices) -> Iterator[Mistake]:
    """Who needs a frame description, and which formats a KVH gyro has."""
    for role, key, section in devices:
        if role != "gyro":
            continue
        described, given = section.get("driver") == "frames", section.get("description")
        if described and given is None:
            yield Mistake(
                f"{key}.description", "nothing", "a name that `gyrobench frames list` shows, or a TOML file"
            )
        elif given is not None and not described:
            yield Mistake(f"{key}.description", "a frame description", "driver = 'frames' with it, or none")
        if section.get("settings") and section.get("driver") not in ("frames", "stim300"):
            yield Mistake(
                f"{key}.settings", f"driver {section.get('driver')!r}", "settings only of a described gyro"
            )
        frame_format = section.get("frame_format")
        if section.get("driver") == "kvh1750" and frame_format not in (None, "A", "B", "C"):
            yield Mistake(f"{key}.frame_format", repr(frame_format), "'A', 'B' or 'C'")
        if section.get("driver") == "stim300":
            if frame_format is not None and frame_format not in DATAGRAMS:
                yield Mistake(f"{key}.frame_format", repr(frame_format), "one of " + ", ".join(DATAGRAMS))
            if section.get("rate_hz") not in RATES:
                found = section.get("rate_hz", "nothing")
                yield Mistake(f"{key}.rate_hz", str(found), "one of " + ", ".join(map(str, RATES)))


def _connections(devices: _Devices) -> Iterator[Mistake]:
    for role, key, section in devices:
        if role != "gyro":
            continue
        given = [name for name in ("port", "interface", "channel") if section.get(name) is not None]
        on_can = section.get("driver") in _ON_CAN or "interface" in given or "channel" in given
        yield from _layout(key, section)
        if "port" in given and on_can:
            found = " and ".join(given)
            yield Mistake(
                key, found, "either port (serial) or interface and channel (CAN), as the driver has it"
            )
        elif on_can:
            for name in ("interface", "channel"):
                if name not in given:
                    yield Mistake(f"{key}.{name}", "nothing", "a python-can interface and its channel")
        elif "port" not in given:
            yield Mistake(
                f"{key}.port", "nothing", "a serial port, or interface and channel for a unit on CAN"
            )


def _layout(key: str, section: Mapping[str, Any]) -> Iterator[Mistake]:
    has_layout = section.get("layout") is not None
    if section.get("driver") == "can_dbc" and not has_layout:
        yield Mistake(f"{key}.layout", "nothing", "a shipped CAN layout's name, or a mapping file's path")
    elif has_layout and section.get("driver") != "can_dbc":
        yield Mistake(
            f"{key}.layout", f"driver {section.get('driver')!r}", "a layout only with driver 'can_dbc'"
        )


def _shared_ports(devices: _Devices, resolve_links: bool) -> Iterator[Mistake]:
    seen: dict[str, tuple[str, bool]] = {}
    for _, key, section in devices:
        name = "channel" if section.get("port") is None else "port"
        port = section.get(name)
        if not isinstance(port, str):
            continue
        shared = name == "channel" and section.get("interface") in _SHARED
        place = os.path.realpath(port) if resolve_links and port.startswith("/") else port
        first, both = seen.setdefault(place, (key, shared))
        if first != key and not (shared and both):
            yield Mistake(f"{key}.{name}", repr(port), f"a port of its own ({first} is on this one)")


def _sockets(devices: _Devices) -> Iterator[Mistake]:
    for _, key, section in devices:
        port = section.get("port")
        if not isinstance(port, str) or not port.startswith("socket://"):
            continue
        try:
            parts = urlsplit(port)
            whole = bool(parts.hostname and parts.port)
        except ValueError:
            whole = False
        if not whole:
            yield Mistake(f"{key}.port", repr(port), "socket://host:port, the port a number of 1 to 65535")


def _instruments(devices: _Devices) -> Iterator[Mistake]:
    """What one driver takes and another does not."""
    for role, key, section in devices:
        kind = section.get("driver")
        if role == "table":
            axes = section.get("axes")
            if kind == "ideal_atl" and isinstance(axes, (list, tuple)) and len(axes) > 1:
                yield Mistake(
                    f"{key}.axes", f"{len(axes)} axes", "one of [[table.axes]], or none: ATL turns one"
                )
        if role != "chamber":
            continue
        address, channel = section.get("address"), section.get("start_channel", 1)
        if kind == "weiss" and isinstance(address, int) and not 0 <= address <= 31:
            yield Mistake(f"{key}.address", str(address), "the address of a Weiss chamber, 0 to 31")
        if kind == "watlow_f4" and isinstance(channel, int) and channel > 8:
            yield Mistake(f"{key}.start_channel", str(channel), "a digital output of the F4, 1 to 8")
        if kind in _WITHOUT_START_CHANNEL and channel != 1:
            yield Mistake(f"{key}.start_channel", str(channel), f"none: {kind} is started by its mode")
        if kind in _OUR_CHAMBERS and kind != "weiss" and section.get("simserv") is False:
            yield Mistake(f"{key}.simserv", "false", f"none: {kind} has no SimServ")


def _axes_and_sensors(data: Mapping[str, Any], devices: _Devices) -> Iterator[Mistake]:
    chamber = data.get("chamber")
    auxiliary = chamber.get("auxiliary", {}) if isinstance(chamber, dict) else {}
    numbers = {str(number) for number in auxiliary} if isinstance(auxiliary, dict) else set()
    for role, key, section in devices:
        axis, axes, sensor = section.get("axis"), section.get("axes", "x"), section.get("case_sensor")
        if role != "gyro":
            continue
        if isinstance(axis, str) and isinstance(axes, str) and axis not in axes:
            yield Mistake(f"{key}.axis", repr(axis), f"one of the unit's axes, {axes!r}")
        if isinstance(sensor, int) and str(sensor) not in numbers:
            have = ", ".join(sorted(numbers)) or "none"
            yield Mistake(f"{key}.case_sensor", str(sensor), f"a number in chamber.auxiliary ({have})")


def _table_axes(data: Mapping[str, Any]) -> Iterator[Mistake]:
    table = data.get("table")
    axes = table.get("axes") if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(axes, (list, tuple)) or not axes:
        return
    if "axis" in table and table["axis"] != 1:
        yield Mistake("table.axis", str(table["axis"]), "either axis or [[table.axes]], not both")
    sections = [axis for axis in axes if isinstance(axis, dict)]
    for name in ("name", "number"):
        given = [section.get(name) for section in sections]
        for at, value in enumerate(given):
            if value in given[:at]:
                first = given.index(value)
                yield Mistake(
                    f"table.axes[{at}].{name}", repr(value), f"one of its own (axes[{first}] has this one)"
                )
    for at, section in enumerate(sections):
        along = _LINES.get(str(section.get("direction")))
        if at and along is not None and along == _LINES.get(str(sections[at - 1].get("direction"))):
            yield Mistake(
                f"table.axes[{at}].direction",
                repr(section["direction"]),
                "a direction at a right angle to the axis outside of it",
            )
        low, high = section.get("min_angle_deg"), section.get("max_angle_deg")
        if (low is None) != (high is None):
            yield Mistake(f"table.axes[{at}]", "one stop", "min_angle_deg and max_angle_deg, or neither")
        elif isinstance(low, (int, float)) and isinstance(high, (int, float)) and not low < high:
            yield Mistake(
                f"table.axes[{at}].min_angle_deg", f"{low:g}", f"less than max_angle_deg ({high:g})"
            )


def _limits(data: Mapping[str, Any]) -> Iterator[Mistake]:
    limits = data.get("limits", {})
    low = _number(limits, "min_temp_c", LimitsSection().min_temp_c)
    high = _number(limits, "max_temp_c", LimitsSection().max_temp_c)
    safe = _number(data.get("safe", {}), "chamber_set_point_c", SafeSection().chamber_set_point_c)
    if low is None or high is None:
        return
    if low >= high:
        yield Mistake("limits.min_temp_c", f"{low:g}", f"less than max_temp_c ({high:g})")
    elif safe is not None and not low <= safe <= high:
        yield Mistake(
            "safe.chamber_set_point_c",
            f"{safe:g}",
            f"a temperature within [limits], {low:g} to {high:g} degC",
        )


def _door(data: Mapping[str, Any]) -> Iterator[Mistake]:
    limits, chamber = data.get("limits"), data.get("chamber")
    rules = limits.get("forbid") if isinstance(limits, dict) else None
    knows = isinstance(chamber, dict) and chamber.get("door_message") is not None
    for at, rule in enumerate(rules if isinstance(rules, (list, tuple)) else ()):
        if isinstance(rule, dict) and rule.get("door") is not None and not knows:
            yield Mistake(
                f"limits.forbid[{at}].door",
                repr(rule["door"]),
                "chamber.door_message, which says how this chamber tells that its door is open",
            )


def _number(section: object, name: str, default: float) -> float | None:
    value = section.get(name, default) if isinstance(section, dict) else None
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
