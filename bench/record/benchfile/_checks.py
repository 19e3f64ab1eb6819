"""What must agree between the sections of a bench file, checked on the raw data."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from typing import Any

from bench.record.benchfile._model import LimitsSection, SafeSection
from drivers.base.errors import one_of
from drivers.kit.config import GyroConfig, Mistake
from drivers.kit.places import socket_address
from drivers.kit.registry import DRIVERS, config_class, registered, roles

_RESERVED_NAMES = ("table", "turntable", "chamber", "manifest", "events")
"""Words that name other files and ports of a run folder."""

_LINES = {"east": 0, "west": 0, "north": 1, "south": 1, "up": 2, "down": 2}

_SHARED = ("socketcan", "socketcand", "udp_multicast", "virtual")
"""Interfaces of python-can whose channel several can have open; each then hears every unit on the bus."""

_Devices = list[tuple[str, str, Mapping[str, Any]]]
_Gyros = list[tuple[str, Mapping[str, Any]]]


def cross_checks(data: Mapping[str, Any], resolve_links: bool) -> Iterator[Mistake]:
    """Check keys against each other, on raw data so that one bad type hides nothing else.

    `resolve_links`: two names of one device on this machine are one port.
    """
    if not data.get("gyro") and not data.get("platform"):
        found = "an empty list" if "gyro" in data else "nothing"
        yield Mistake("gyro", found, "at least one [[gyro]] with name, driver, unit, axis and a port")
    devices = list(device_sections(data))
    yield from _drivers(devices)
    yield from _names(devices)
    for role, key, section in devices:
        for mistake in config_class(role, section.get("driver")).mistakes(section):
            yield Mistake(f"{key}.{mistake.key}", mistake.found, mistake.expected)
    gyros = [(key, section) for role, key, section in devices if role == "gyro"]
    yield from _connections(gyros)
    yield from _shared_ports(devices, resolve_links)
    yield from _sockets(devices)
    yield from _axes_and_sensors(data, devices)
    yield from _fed_units(devices)
    yield from _limits(data)
    yield from _table_axes(data)
    yield from _door(data)
    yield from _rules(data)


def device_sections(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield (role, key, section) of every device section that is a table."""
    for role in roles():
        given = data.get(role)
        for number, section in enumerate(given if isinstance(given, list) else [given]):
            if isinstance(section, dict):
                yield role, f"{role}[{number}]" if isinstance(given, list) else role, section


def _drivers(devices: _Devices) -> Iterator[Mistake]:
    for role, key, section in devices:
        kind = section.get("driver")
        known = registered(DRIVERS, role)
        if isinstance(kind, str) and kind not in known:
            yield Mistake(f"{key}.driver", repr(kind), one_of(kind, known))


def _names(devices: _Devices) -> Iterator[Mistake]:
    seen: dict[str, str] = {}
    for role, key, section in devices:
        name = section.get("name")
        if role in ("table", "chamber") or not isinstance(name, str):
            continue
        if name in _RESERVED_NAMES:
            yield Mistake(f"{key}.name", repr(name), "a name that the run folder does not use itself")
        elif name in seen:
            yield Mistake(f"{key}.name", repr(name), f"a name of its own ({seen[name]} has this one)")
        seen.setdefault(name, key)


def _connections(gyros: _Gyros) -> Iterator[Mistake]:
    for key, section in gyros:
        given = [name for name in ("port", "interface", "channel") if section.get(name) is not None]
        config = config_class("gyro", section.get("driver"))
        on_can = issubclass(config, GyroConfig) and config.only_on_can
        on_can = on_can or "interface" in given or "channel" in given
        if "port" in given and on_can:
            expected = "either port (serial) or interface and channel (CAN), as the driver has it"
            yield Mistake(key, " and ".join(given), expected)
        elif on_can:
            for name in ("interface", "channel"):
                if name not in given:
                    yield Mistake(f"{key}.{name}", "nothing", "a python-can interface and its channel")
        elif "port" not in given:
            expected = "a serial port, or interface and channel for a unit on CAN"
            yield Mistake(f"{key}.port", "nothing", expected)


def _shared_ports(devices: _Devices, resolve_links: bool) -> Iterator[Mistake]:
    seen: dict[str, tuple[str, bool]] = {}
    for _, key, section in devices:
        name = "channel" if section.get("port") is None else "port"
        port = section.get(name)
        if not isinstance(port, str):
            continue
        shared = name == "channel" and section.get("interface") in _SHARED
        place = os.path.realpath(port) if resolve_links and port.startswith("/") else _written(port)
        first, both = seen.setdefault(place, (key, shared))
        if first != key and not (shared and both):
            yield Mistake(f"{key}.{name}", repr(port), f"a port of its own ({first} is on this one)")


def _written(port: str) -> str:
    """Return a port in one way of writing it: hosts have no capitals, numbers no zeros in front."""
    try:
        host, number = socket_address(port)
    except ValueError:
        return port
    return f"socket://{host.lower()}:{number}"


def _sockets(devices: _Devices) -> Iterator[Mistake]:
    for _, key, section in devices:
        port = section.get("port")
        if not isinstance(port, str) or not port.startswith("socket://"):
            continue
        try:
            socket_address(port)
        except ValueError:
            yield Mistake(f"{key}.port", repr(port), "socket://host:port, the port a number of 1 to 65535")


def _axes_and_sensors(data: Mapping[str, Any], devices: _Devices) -> Iterator[Mistake]:
    numbers: dict[str, str] = {}
    for role, key, section in devices:
        name = {"chamber": "auxiliary", "logger": "sensors"}.get(role, "")
        sensors = section.get(name)
        for number in map(str, sensors if isinstance(sensors, dict) else ()):
            if number in numbers:
                taken = f"a number of its own ({numbers[number]} has this one)"
                yield Mistake(f"{key}.{name}.{number}", number, taken)
            numbers.setdefault(number, f"{key}.{name}")
    for role, key, section in devices:
        if role != "gyro":
            continue
        axis, axes, sensor = section.get("axis"), section.get("axes", "x"), section.get("case_sensor")
        if isinstance(axis, str) and isinstance(axes, str) and axis not in axes:
            yield Mistake(f"{key}.axis", repr(axis), f"one of the unit's axes, {axes!r}")
        if isinstance(sensor, int) and str(sensor) not in numbers:
            have = ", ".join(sorted(numbers)) or "none"
            where = (
                "chamber.auxiliary"
                if not any(role == "logger" for role, _, _ in devices)
                else "auxiliary or sensors"
            )
            yield Mistake(f"{key}.case_sensor", str(sensor), f"a number in {where} ({have})")


def _fed_units(devices: _Devices) -> Iterator[Mistake]:
    units = {str(section.get("name")) for role, _, section in devices if role in ("gyro", "platform")}
    fed: dict[str, str] = {}
    for role, key, section in devices:
        outputs = section.get("outputs") if role == "supply" else None
        for at, output in enumerate(outputs if isinstance(outputs, list | tuple) else ()):
            here = f"{key}.outputs[{at}].units"
            named = output.get("units") if isinstance(output, dict) else None
            for unit in map(str, named if isinstance(named, list | tuple) else ()):
                if unit not in units:
                    yield Mistake(
                        here, repr(unit), f"names of units of this bench ({', '.join(sorted(units))})"
                    )
                elif unit in fed:
                    yield Mistake(here, repr(unit), f"a unit that is fed once ({fed[unit]} feeds it)")
                fed.setdefault(unit, here)


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
        for number, value in enumerate(given):
            if (first := given.index(value)) < number:
                key, expected = f"table.axes[{number}].{name}", f"one of its own (axes[{first}] has this one)"
                yield Mistake(key, repr(value), expected)
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
        expected = f"a temperature within [limits], {low:g} to {high:g} degC"
        yield Mistake("safe.chamber_set_point_c", f"{safe:g}", expected)


def _door(data: Mapping[str, Any]) -> Iterator[Mistake]:
    limits, chamber = data.get("limits"), data.get("chamber")
    rules = limits.get("forbid") if isinstance(limits, dict) else None
    if isinstance(chamber, dict) and chamber.get("door_message") is not None:
        return
    expected = "chamber.door_message, which says how this chamber tells that its door is open"
    for number, rule in enumerate(rules if isinstance(rules, (list, tuple)) else ()):
        if isinstance(rule, dict) and rule.get("door") is not None:
            yield Mistake(f"limits.forbid[{number}].door", repr(rule["door"]), expected)


def _rules(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """Name conditions of `[[limits.forbid]]` that can never hold: the rule would guard nothing."""
    limits, chamber = data.get("limits"), data.get("chamber")
    rules = limits.get("forbid") if isinstance(limits, dict) else None
    sensors = bool(data.get("logger")) or (isinstance(chamber, dict) and bool(chamber.get("auxiliary")))
    for number, rule in enumerate(rules if isinstance(rules, (list, tuple)) else ()):
        for name, band in rule.items() if isinstance(rule, dict) else ():
            if not isinstance(band, dict):
                continue
            key = f"limits.forbid[{number}].{name}"
            above, below = (_number(band, end, math.nan) for end in ("above", "below"))
            if above is None or below is None:
                continue
            found = ", ".join(f"{end} = {value!r}" for end, value in band.items())
            if name == "rate_dps" and below <= 0.0:
                yield Mistake(key, found, "a rate without sign, which is never below 0")
            elif name == "angle_deg":
                alone = above if math.isnan(below) else below if math.isnan(above) else 0.0
                if not 0.0 <= alone <= 360.0:
                    yield Mistake(key, found, "above and below, or one of them from 0 to 360")
            elif above >= below:
                yield Mistake(key, found, "above less than below: this can never be true")
            elif name == "aux_temp_c" and not sensors:
                yield Mistake(key, found, "a sensor that it speaks of: chamber.auxiliary or a [[logger]]")


def _number(section: object, name: str, default: float) -> float | None:
    value = section.get(name, default) if isinstance(section, dict) else None
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits: the section's own check refuses it
        return None
