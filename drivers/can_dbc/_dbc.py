"""DBC files: read by cantools in a process of their own, compiled to layouts."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers.base.errors import ConfigurationError
from drivers.base.files import parse_json, read_bounded
from drivers.can_dbc._read_dbc import messages_in
from drivers.can_dbc._signals import MessageLayout, SignalLayout

MAX_FILE_BYTES = 4 << 20
"""Large public DBC files (whole vehicles) have 1 to 2 MB."""
_MEMORY_BYTES, _CPU_S = 1 << 30, 20
"""A file of 4 MiB takes up to 0.5 GiB and 6 s; one of 2 kB, with multiplexers in a chain, as much as there is."""
_MAX_ANSWER_BYTES = 64 << 20
_MAX_LEVELS = 8
"""Of multiplexers inside one another; a unit has one or two, and a layout doubles with each."""
_READER = Path(__file__).with_name("_read_dbc.py")
_OURS = Path(__file__).parents[1]

_PARAMETER_GROUP_1, _PARAMETER_GROUP_2 = 0x03FF_0000, 0x03FF_FF00


Message = Any
"""A message with its signals as cantools has them, under cantools' names."""
Signal = Any


def load_database(path: Path) -> Mapping[str, Message]:
    """Return the messages of a DBC file by name, read by cantools in a process with bounds (`_read_dbc`).

    UTF-8, else Windows-1252, in which DBC files were written before. Raises ConfigurationError for a file that
    cannot be read, that cantools refuses (for overlapping signals it names both and the message), or that takes
    more memory or time than a file of that size can need.
    """
    try:
        content = read_bounded(path, MAX_FILE_BYTES)
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    found = _read(content, path.resolve().is_relative_to(_OURS))
    if isinstance(found, str):
        raise _unreadable(path, found)
    return found


@lru_cache(maxsize=16)
def _read(content: bytes, ours: bool) -> Mapping[str, Message] | str:
    """Return the messages in the bytes of a DBC file, or why there are none; `ours` are read right here."""
    if ours:
        import drivers.kit.python_can  # noqa: F401  (cantools imports python-can, which takes long another way)

        return _by_name(messages_in(content))
    with subprocess.Popen(
        [sys.executable, "-P", str(_READER), str(_MEMORY_BYTES), str(_CPU_S)],  # -P: nothing from this folder
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as reader:
        assert reader.stdin is not None and reader.stdout is not None
        with suppress(BrokenPipeError), reader.stdin as pipe:
            pipe.write(content)
        answer = reader.stdout.read(_MAX_ANSWER_BYTES + 1)
        reader.kill()
    if len(answer) > _MAX_ANSWER_BYTES or not answer.endswith(b"\n"):
        return f"more than {_CPU_S} s of computing to read it"
    found = parse_json(answer)
    if isinstance(found, str):
        return found
    return _by_name(found)


def _by_name(found: list[dict[str, Any]]) -> Mapping[str, Message]:
    return {
        message["name"]: SimpleNamespace(
            **{**message, "signals": [SimpleNamespace(**signal) for signal in message["signals"]]}
        )
        for message in found
    }


def find_message(path: Path, name: str) -> Message:
    """Return message `name` of a DBC file; raises ConfigurationError without it."""
    messages = load_database(path)
    if name in messages:
        return messages[name]
    import difflib

    near = difflib.get_close_matches(name, messages, n=1)
    raise ConfigurationError(
        f"the DBC file has no message {name}",
        where=str(path),
        found=_few(list(messages)),
        expected=f"that message{f' (did you mean {near[0]!r}?)' if near else ''}",
    )


def compile_message(message: Message, *, j1939: bool = False) -> MessageLayout:
    """Return the layout of one message; cantools' own messages will do.

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


def _compile_into(
    done: dict[str, SignalLayout], signal: Signal, by_name: dict[str, Signal], level: int = 0
) -> SignalLayout:
    if signal.name in done:
        return done[signal.name]
    if level > _MAX_LEVELS or not (math.isfinite(signal.scale) and math.isfinite(signal.offset)):
        raise _unsupported(signal, level)
    selectors: tuple[tuple[SignalLayout, tuple[int, ...]], ...] = ()
    if signal.multiplexer_ids is not None:
        if signal.multiplexer_signal not in by_name:
            raise ConfigurationError(
                f"signal {signal.name} has a multiplexer that its message lacks",
                found=str(signal.multiplexer_signal),
                expected=", ".join(by_name),
            )
        above = _compile_into(done, by_name[signal.multiplexer_signal], by_name, level + 1)
        selectors = (*above.selectors, (above, tuple(signal.multiplexer_ids)))
        if len(selectors) > _MAX_LEVELS:  # those above may have been compiled before
            raise _unsupported(signal, len(selectors))
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


def _unsupported(signal: Signal, level: int) -> ConfigurationError:
    return ConfigurationError(
        f"signal {signal.name} has a layout that is not supported",
        found=f"scale {signal.scale:g}, offset {signal.offset:g}, multiplexer level {level}",
        expected=f"finite numbers, at most {_MAX_LEVELS} multiplexers inside one another",
    )


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
