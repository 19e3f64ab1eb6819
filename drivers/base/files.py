"""Files from strangers, read within bounds, and our own, written whole or not at all.

No pipe or device is read, no more bytes than needed, no deep nesting. Nothing is executed: TOML and JSON become
plain values. What is refused is an OSError or ValueError as any other file that cannot be read, so that the
caller's own error says which file it was.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.base.errors import ConfigurationError
from drivers.base.system import open_flags

SETTINGS_BYTES = 1 << 20
"""Most bytes of a file that a person writes: bench, campaign, frame, mapping, limits. Parsed TOML takes up to 500
times as much memory."""

RECORD_BYTES = 256 << 20
"""Most bytes of a text file that a run or campaign writes: a day of events has a few MiB."""

MANIFEST_BYTES = 16 << 20
"""Most bytes of a manifest, which has some ten thousand: a million keys take up to 70 times as much memory."""

_DEEPEST = 64
_READ_BYTES = 1 << 20
_ASIDE = re.compile(
    r'''
    """(?s:[^"\\]|\\.|"(?!""))*+(?:""")? | \'\'\'(?s:.*?)(?:\'\'\'|\Z)  # strings of several lines
    | "(?:[^"\\\n]|\\.)*+"? | '[^'\n]*+'? | \#[^\n]*+       # of one line; comments
    ''',
    re.VERBOSE,
)
"""What may hold dots that join no keys. What is not closed goes to its end: no byte is looked at twice."""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{_DEEPEST}}}")


def read_bounded(path: Path | str, most_bytes: int) -> bytes:
    """Return the content of a regular file; OSError for anything else and for more than `most_bytes`."""
    # O_NONBLOCK: opening a pipe without a writer must not wait for one
    descriptor = os.open(path, open_flags("O_RDONLY", "O_NONBLOCK"))
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        content = bytearray()
        while block := os.read(descriptor, min(_READ_BYTES, most_bytes + 1 - len(content))):
            content += block
            if len(content) > most_bytes:
                raise OSError(errno.EFBIG, f"more than {_size(most_bytes)}", str(path))
        return bytes(content)
    finally:
        os.close(descriptor)


def replace_file(path: Path, content: bytes | str, *, sync: bool = True, mode: int = 0o666) -> None:
    """Write a file in one piece: whatever happens, a reader finds the old one or the new one. Raises OSError.

    With `sync` the new one is on the disk before it takes the old one's place: a power cut leaves no empty one.
    `mode`: who may read and write it, before the process's mask.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        descriptor = os.open(part, open_flags("O_WRONLY", "O_CREAT", "O_TRUNC"), mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content.encode("utf-8") if isinstance(content, str) else content)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def encodable(text: str) -> str:
    """Return a text as UTF-8 can hold it: what bytes of another encoding became is a question mark."""
    return text.encode("utf-8", "replace").decode("utf-8")


def parse_json(content: bytes | str) -> Any:
    """Return the value of a JSON text; ValueError if it is none, or is nested so deep that no file of ours is."""
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("nested too deep") from error


def parse_toml(content: bytes) -> dict[str, Any]:
    """Return the table of a TOML text; ValueError if it is none, is not UTF-8, or is nested deeper than 64."""
    text = content.decode("utf-8-sig")  # some editors put a mark before the text
    if _LONG_KEY.search(
        _ASIDE.sub("q", text)
    ):  # time and memory of tomllib grow with the square of a key's parts
        raise ValueError("nested too deep")
    try:
        data = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    level: list[Any] = [data]
    for _ in range(_DEEPEST):
        level = [inner for value in level for inner in _inner(value)]
        if not level:
            return data
    raise ValueError("nested too deep")


def read_settings(
    path: Path, what: str, *, expected: str = "a TOML file", remedy: str = ""
) -> tuple[dict[str, Any], bytes]:
    """Return the table of a TOML file that a person wrote, and its bytes; `what`: the file, in words.

    ConfigurationError for one that cannot be read or is no TOML.
    """
    try:
        content = read_bounded(path, SETTINGS_BYTES)
    except OSError as error:
        problem = error.strerror or str(error)
        raise ConfigurationError(
            f"{what} cannot be read", where=str(path), found=problem, expected=expected, remedy=remedy
        ) from error
    try:
        return parse_toml(content), content
    except ValueError as error:
        raise ConfigurationError(
            f"{what} is not TOML", where=str(path), found=str(error), expected="TOML 1.0 in UTF-8"
        ) from error


def _inner(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value.values())
    return value if isinstance(value, list) else []


def _size(count: int) -> str:
    return f"{count >> 20} MiB" if count >= 1 << 20 else f"{count} bytes"
