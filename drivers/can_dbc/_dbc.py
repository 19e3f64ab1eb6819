"""DBC files: read by cantools, guarded against what would exhaust the machine, compiled to layouts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from drivers.can_dbc._signals import MessageLayout, SignalLayout
from drivers.errors import ConfigurationError
from drivers.files import read_bounded

MAX_FILE_BYTES = 4 << 20
"""Large public DBC files (whole vehicles) have 1 to 2 MB."""
_MAX_MESSAGE_BYTES = 1785
"""Of a J1939 transport session, the longest message that DBC files describe."""
_MAX_BITS = 8 * _MAX_MESSAGE_BYTES
_MAX_SELECTIONS = 65_536
_MAX_LINE = 100_000
_MAX_NUMBER = 400
"""Digits, and value of an exponent: beyond every number of IEEE 754 doubles."""

_PARAMETER_GROUP_1, _PARAMETER_GROUP_2 = 0x03FF_0000, 0x03FF_FF00

_MESSAGE = re.compile(r"\bBO_\s+\d{1,20}\s+([^\s:]{1,128})\s*:\s*(\d+)")
_SIGNAL = re.compile(r"\bSG_\s+([^:]{1,200}):\s*(\d+)\s*\|\s*(\d+)\s*@")
_SELECTIONS = re.compile(r"\bSG_MUL_VAL_\s[^;]*")
_SELECTION = re.compile(r"(\d+)\s*-\s*(\d+)")
_LONG_NUMBER = re.compile(rf"\d{{{_MAX_NUMBER},}}|\d[eE][+-]?0*[1-9]\d{{3,}}")


@lru_cache(maxsize=16)
def load_database(path: Path) -> Any:
    """Return the cantools database of a DBC file.

    UTF-8, else Windows-1252, in which DBC files were written before. Raises ConfigurationError for a file that
    cannot be read, that cantools refuses (for overlapping signals it names both and the message), or whose sizes
    no CAN message has: cantools would make tables of them.
    """
    try:
        content = read_bounded(path, MAX_FILE_BYTES)
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    _check_sizes(text, path)
    import cantools  # takes longer to import than all the rest

    try:
        return cantools.database.load_string(text, database_format="dbc", prune_choices=False)
    except (ValueError, ArithmeticError, LookupError, TypeError, AttributeError, cantools.Error) as error:
        raise _unreadable(path, str(error) or type(error).__name__) from error


def load_message(path: Path, name: str) -> MessageLayout:
    """Return the layout of message `name` of a DBC file; raises ConfigurationError, see `compile_message`."""
    return compile_message(find_message(path, name))


def find_message(path: Path, name: str) -> Any:
    """Return message `name` of a DBC file as cantools has it; raises ConfigurationError without it."""
    database = load_database(path)
    try:
        return database.get_message_by_name(name)
    except KeyError as error:
        import difflib

        names = [message.name for message in database.messages]
        near = difflib.get_close_matches(name, names, n=1)
        raise ConfigurationError(
            f"the DBC file has no message {name}",
            where=str(path),
            found=_few(names),
            expected=f"that message{f' (did you mean {near[0]!r}?)' if near else ''}",
        ) from error


def compile_message(message: Any, *, j1939: bool = False) -> MessageLayout:
    """Return the layout of one cantools message.

    `j1939`: told by its parameter group, see `MessageLayout.identifier_mask`. ConfigurationError for a message of
    more than the 8 bytes of a classic CAN frame.
    """
    if message.length > 8:
        raise ConfigurationError(
            f"message {message.name} has a layout that is not supported",
            found=f"{message.length} bytes",
            expected="at most 8 bytes, the payload of a classic CAN frame",
        )
    if j1939 and not message.is_extended_frame:
        raise ConfigurationError(
            f"message {message.name} is not one of J1939",
            found="an 11-bit identifier",
            expected="29 bits: priority, parameter group, source address",
        )
    by_name = {signal.name: signal for signal in message.signals}
    signals: dict[str, SignalLayout] = {}
    for signal in message.signals:
        _compile_into(signals, signal, by_name)
    return MessageLayout(
        name=message.name,
        identifier=message.frame_id,
        extended=message.is_extended_frame,
        length=message.length,
        signals={name: signals[name] for name in by_name},
        identifier_mask=_parameter_group_mask(message.frame_id) if j1939 else 0x1FFF_FFFF,
    )


def _parameter_group_mask(identifier: int) -> int:
    """Return the identifier bits of a parameter group: with a destination below PDU format 240, else without."""
    return _PARAMETER_GROUP_1 if (identifier >> 16) & 0xFF < 240 else _PARAMETER_GROUP_2


def _compile_into(done: dict[str, SignalLayout], signal: Any, by_name: dict[str, Any]) -> SignalLayout:
    if signal.name in done:
        return done[signal.name]
    selectors: tuple[tuple[SignalLayout, tuple[int, ...]], ...] = ()
    if signal.multiplexer_ids is not None:
        above = _compile_into(done, by_name[signal.multiplexer_signal], by_name)
        selectors = (*above.selectors, (above, tuple(signal.multiplexer_ids)))
    big_endian = signal.byte_order == "big_endian"
    if big_endian:  # `start` is the most significant bit; bit 7 of byte 0 is the top of the word
        top = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 64 - top - signal.length
    else:
        shift = signal.start
    if shift < 0 or shift + signal.length > 64 or signal.length < 1:
        raise ConfigurationError(
            f"signal {signal.name} does not fit its message",
            found=f"{signal.length} bits from bit {signal.start}",
            expected="bits within the 8 bytes of a classic CAN frame",
        )
    done[signal.name] = SignalLayout(
        name=signal.name,
        shift=shift,
        bits=signal.length,
        big_endian=big_endian,
        signed=signal.is_signed,
        scale=float(signal.scale),
        offset=float(signal.offset),
        unit=signal.unit or "",
        is_float=signal.is_float,
        selectors=selectors,
    )
    return done[signal.name]


def _check_sizes(text: str, path: Path) -> None:
    """Refuse sizes that no message has, before cantools makes lists of that many entries."""
    if any(len(line) > _MAX_LINE for line in text.splitlines()):
        raise _unreadable(path, f"a line of more than {_MAX_LINE} characters")
    if found := _LONG_NUMBER.search(text):
        raise _unreadable(path, f"the number {found.group()[:24]}...")
    for name, length in _MESSAGE.findall(text):
        if int(length) > _MAX_MESSAGE_BYTES:
            raise _unreadable(path, f"message {name} of {length} bytes, more than {_MAX_MESSAGE_BYTES}")
    for name, start, length in _SIGNAL.findall(text):
        if int(start) >= _MAX_BITS or int(length) > _MAX_BITS:
            raise _unreadable(path, f"signal {name.split()[0]} of {length} bits from bit {start}")
    selections = 0
    for statement in _SELECTIONS.findall(text):
        selections += sum(max(0, int(high) - int(low)) for low, high in _SELECTION.findall(statement))
    if selections > _MAX_SELECTIONS:
        raise _unreadable(path, f"{selections} multiplexer values, more than {_MAX_SELECTIONS}")


def _unreadable(path: Path, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the DBC file cannot be read",
        where=str(path),
        found=found,
        expected="a DBC file that describes the unit's messages",
    )


def _few(names: Sequence[str], most: int = 8) -> str:
    shown = ", ".join(names[:most]) or "no messages"
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
