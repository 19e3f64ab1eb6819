"""Mapping files: which signal of a DBC file is which axis, counter or temperature, in what unit."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.base.constants import STANDARD_GRAVITY_MPS2, ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError
from drivers.base.files import read_settings
from drivers.can_dbc._dbc import compile_message, find_message, load_database
from drivers.can_dbc._layout import CanLayout, Role, SignalUse, Slot, ValidRule, outer_multiplexer
from drivers.can_dbc._signals import MessageLayout, SignalLayout

SHIPPED = Path(__file__).parent

_RATES = {"deg/s": 1.0, "rad/s": math.degrees(1.0), "deg/h": 1.0 / 3600.0, "mrad/s": math.degrees(1e-3)}
_ANGLES = {"deg": 1.0, "rad": math.degrees(1.0), "mrad": math.degrees(1e-3), "urad": math.degrees(1e-6)}
_ACCELERATIONS = {"m/s2": 1.0, "m/s^2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": STANDARD_GRAVITY_MPS2 * 1e-3}
_UNITS = {"rate": _RATES, "delta_angle": _ANGLES, "accel": _ACCELERATIONS}
_TIMES = {"s": 1.0, "ms": 1e-3, "100us": 1e-4, "us": 1e-6, "ns": 1e-9}
_TEMPERATURES = {"degC": (1.0, 0.0), "K": (1.0, -ZERO_CELSIUS_K), "degF": (5.0 / 9.0, -160.0 / 9.0)}
_SLOT = re.compile(r"^([A-Za-z_]\w*)(?:\[(\d+)\])?$")


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class _Signal(_Part):
    role: Role
    message: str
    signal: str
    unit: str = ""
    scale: float = Field(default=1.0, strict=False, allow_inf_nan=False)
    axis: Literal["", "x", "y", "z"] = ""
    raw_range: tuple[int, int] | None = Field(default=None, strict=False)
    modulo: int | None = Field(default=None, ge=2)
    step: int = Field(default=1, ge=1)
    healthy: int = Field(default=0, ge=0)


class _Valid(_Part):
    message: str
    signal: str
    bits: tuple[int, ...] = Field(default=(), strict=False)
    good: Literal[0, 1] = 1
    equals: int | None = None
    axis: Literal["", "x", "y", "z"] = ""


class _Mapping(_Part):
    format: Literal[1]
    dbc: str
    sample: tuple[str, ...] = Field(min_length=1, max_length=64, strict=False)
    signal: tuple[_Signal, ...] = Field(min_length=1, strict=False)
    title: str = ""
    maker: str = ""
    model: str = ""
    j1939: bool = False
    valid: tuple[_Valid, ...] = Field(default=(), strict=False)


def shipped_layouts() -> list[str]:
    """Return the names of the layouts that come with this package."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def load_layout(name: str, folder: Path = Path()) -> CanLayout:
    """Return a shipped layout by name, or that of a mapping file; a relative path is one from `folder`.

    ConfigurationError names the key, message or signal that cannot be used.
    """
    path = SHIPPED / f"{name}.toml" if name in shipped_layouts() else folder / name
    expected = "a mapping file (TOML), or one of " + ", ".join(shipped_layouts())
    mapping, _ = read_settings(path, "the CAN mapping", expected=expected)
    return layout_from_mapping(mapping, path.parent, str(path), path.stem)


def layout_from_mapping(mapping: Mapping[str, Any], folder: Path, where: str, name: str = "") -> CanLayout:
    """Return the layout of a mapping given as parsed TOML; `where` stands for it in errors.

    ConfigurationError names the key, message or signal that cannot be used.
    """
    try:
        parsed = _Mapping.model_validate(mapping)
    except ValidationError as error:
        found = "; ".join(
            f"{'.'.join(map(str, each['loc']))}: {each['msg'].lower()}" for each in error.errors()[:6]
        )
        raise _bad(where, "the CAN mapping has keys that cannot be used", found, "see docs/can.md") from error
    return _Compiler(parsed, folder / parsed.dbc, where).layout(name or parsed.title or "can")


class _Compiler:
    """One mapping against its DBC file."""

    def __init__(self, mapping: _Mapping, dbc: Path, where: str) -> None:
        self._mapping = mapping
        self._dbc = dbc
        self._where = where
        self._messages: dict[str, MessageLayout] = {}

    def layout(self, name: str) -> CanLayout:
        """Return the compiled layout after all checks."""
        mapping = self._mapping
        database = load_database(self._dbc)
        sample = tuple(self._slot(text) for text in mapping.sample)
        uses = tuple(self._use(each, at) for at, each in enumerate(mapping.signal))
        rules = tuple(self._rule(each, at) for at, each in enumerate(mapping.valid))
        layout = CanLayout(
            name=name,
            maker=mapping.maker,
            model=mapping.model or mapping.title or name,
            dbc=self._dbc.name,
            dbc_sha256=hashlib.sha256(self._dbc.read_bytes()).hexdigest(),
            messages=self._messages,
            sample=sample,
            uses=uses,
            valid=rules,
            known=tuple(_known(database.values(), mapping.j1939)),
        )
        self._check(layout)
        return layout

    def _message(self, name: str) -> MessageLayout:
        if name not in self._messages:
            found = compile_message(find_message(self._dbc, name), j1939=self._mapping.j1939)
            self._messages[name] = found
        return self._messages[name]

    def _signal(self, message: str, name: str, key: str) -> SignalLayout:
        signals = self._message(message).signals
        if name not in signals:
            raise self._refuse(key, f"message {message} has no signal {name}", ", ".join(signals) or "none")
        return signals[name]

    def _slot(self, text: str) -> Slot:
        match = _SLOT.match(text)
        if match is None:
            raise self._refuse("sample", repr(text), 'a message, or "message[n]" with a multiplexer\'s value')
        name, selection = match.group(1), match.group(2)
        multiplexer = outer_multiplexer(self._message(name))
        if selection is not None and multiplexer is None:
            raise self._refuse("sample", f"{text}: {name} has no multiplexer", f'"{name}"')
        return Slot(name, None if selection is None else int(selection))

    def _use(self, each: _Signal, at: int) -> SignalUse:
        key = f"signal[{at}] ({each.message}.{each.signal})"
        signal = self._signal(each.message, each.signal, key)
        factor, zero, modulo = 1.0, 0.0, 0
        if each.role in ("rate", "delta_angle", "accel") and not each.axis:
            raise self._refuse(f"{key}.axis", "nothing", "x, y or z")
        if each.scale == 0.0 or (each.scale < 0.0 and each.role == "time"):
            raise self._refuse(f"{key}.scale", f"{each.scale:g}", "a number that is not 0, of time above 0")
        if each.scale != 1.0 and each.role in ("counter", "status"):
            raise self._refuse(f"{key}.scale", f"{each.scale:g}", f"none: a {each.role} has no unit")
        if each.role in _UNITS:
            factor = self._unit(_UNITS[each.role], each, signal, key)
        elif each.role in ("temperature", "case_temperature"):
            factor, zero = self._unit(_TEMPERATURES, each, signal, key)
        elif signal.is_float or signal.bits > 62:
            raise self._refuse(key, f"{signal.bits} bits", f"an integer of at most 62 bits as {each.role}")
        if each.role == "time":
            factor = self._unit(_TIMES, each, signal, key) * signal.scale
        if each.role in ("time", "counter"):
            modulo = each.modulo or 1 << signal.bits
            if modulo > 1 << signal.bits or each.step >= modulo:
                limit = f"modulo to {1 << signal.bits}, step below it"
                raise self._refuse(key, f"modulo {modulo}, step {each.step}", limit)
        as_given = each.model_dump(exclude={"unit", "scale", "modulo"})
        return SignalUse(**as_given, factor=factor * each.scale, zero=zero, modulo=modulo)

    def _unit(self, known: Mapping[str, Any], each: _Signal, signal: SignalLayout, key: str) -> Any:
        unit = each.unit or signal.unit
        if unit not in known:
            found = f"{unit!r}{'' if each.unit else ' (from the DBC file)'}" if unit else "none"
            raise self._refuse(f"{key}.unit", found, "one of " + ", ".join(known))
        return known[unit]

    def _rule(self, each: _Valid, at: int) -> ValidRule:
        key = f"valid[{at}] ({each.message}.{each.signal})"
        signal = self._signal(each.message, each.signal, key)
        if (each.equals is None) == (not each.bits) or signal.is_float or signal.bits > 62:
            raise self._refuse(key, "both or neither of bits and equals", "bits = [...] or equals = n")
        if any(not 0 <= bit < signal.bits for bit in each.bits):
            raise self._refuse(f"{key}.bits", str(list(each.bits)), f"bits 0 to {signal.bits - 1}")
        mask = sum(1 << bit for bit in set(each.bits)) or (1 << signal.bits) - 1
        equals = mask * each.good if each.equals is None else each.equals
        if not 0 <= equals <= mask:
            raise self._refuse(f"{key}.equals", str(equals), f"0 to {mask}")
        return ValidRule(each.message, each.signal, mask, equals, each.axis)

    def _check(self, layout: CanLayout) -> None:
        rates = [use.axis for use in layout.uses if use.role in ("rate", "delta_angle")]
        if not rates or len(set(rates)) < len(rates):
            found = ", ".join(rates) or "none"
            raise self._refuse("signal", f"rates of axes {found}", "a rate for each axis the unit has, once")
        forces = [use.axis for use in layout.uses if use.role == "accel"]
        if len(set(forces)) < len(forces):
            raise self._refuse("signal", f"accelerations of axes {', '.join(forces)}", "one for each axis")
        if len({use.role for use in layout.uses if use.role in ("rate", "delta_angle")}) > 1:
            raise self._refuse("signal", "rates and angle increments", "either on all axes")
        for roles in (("temperature",), ("case_temperature",), ("time", "counter"), ("status",)):
            if sum(use.role in roles for use in layout.uses) > 1:
                raise self._refuse("signal", f"several signals of role {' or '.join(roles)}", "at most one")
        if len(set(layout.sample)) < len(layout.sample):
            raise self._refuse("sample", ", ".join(self._mapping.sample), "every frame of a sample once")
        for use in layout.uses:
            if layout.slot_of(use) is None and use.role in ("rate", "delta_angle", "time", "counter"):
                raise self._refuse(
                    "sample",
                    f"{use.message}.{use.signal} ({use.role}) is in none of {', '.join(self._mapping.sample)}",
                    "every frame that a sample is made of",
                )

    def _refuse(self, key: str, found: str, expected: str) -> ConfigurationError:
        return _bad(self._where, f"{key} cannot be used", found, expected)


def _known(messages: Iterable[Any], j1939: bool) -> Iterable[tuple[int, int, bool]]:
    for message in messages:
        if message.length <= 8:
            layout = compile_message(message, j1939=j1939 and message.is_extended_frame)
            yield layout.identifier, layout.identifier_mask, layout.extended


def _bad(where: str, what: str, found: str, expected: str) -> ConfigurationError:
    return ConfigurationError(what, where=where, found=found, expected=expected)
