"""A single file for JSON metadata with numpy arrays in it: a zip of one JSON text and one .npy per array.

No pickle goes in or comes out, so a file from a stranger can be read. The same content gives the same bytes.
"""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base.arrays import ARCHIVE_DAMAGE, array_of, read_archive
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import parse_json, replace_file

JSON_ENTRY = "compensation.json"
_MARK = "array"
_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_state(path: Path, state: Mapping[str, Any]) -> None:
    """Write nested dicts and lists of JSON scalars and numpy arrays; the file appears whole or not at all.

    Raises RecordError.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    text = json.dumps(_without_arrays(state, "arrays", arrays), indent=1, sort_keys=True, allow_nan=False)
    whole = BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr(_entry(JSON_ENTRY), text)
        for name, value in arrays.items():
            buffer = BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(value), allow_pickle=False)
            archive.writestr(_entry(name), buffer.getvalue())
    save_file(path, whole.getvalue())


def save_file(path: Path, content: bytes | str) -> None:
    """Save a result in one piece; RecordError if it cannot be, and then what was there before still is."""
    try:
        replace_file(path, content)
    except OSError as error:
        raise _not_saved(path, error) from error


def _not_saved(path: Path, error: OSError) -> RecordError:
    return RecordError(
        "the file could not be saved",
        where=str(path),
        found=error.strerror or str(error),
        expected="a folder that can be written, with space on its disk",
        remedy="free space or name another folder with --out; the runs are not affected",
    )


@contextmanager
def saved_together(folder: Path, *others: str) -> Iterator[Path]:
    """Yield a folder to write the files of one result to; at the end they take their places in `folder`.

    Files of an earlier result with these names, or named in `others`, go before the first new one comes: after a
    kill or a power cut the files that are there, if not all of them, belong together. A failure on the way leaves
    all that was there before. Raises RecordError.
    """
    part = folder / ".part"
    try:
        shutil.rmtree(part, ignore_errors=True)  # of a process that was killed
        part.mkdir(parents=True)
        yield part
        names = sorted(path.name for path in part.iterdir())
        for name in {*names, *others}:
            (folder / name).unlink(missing_ok=True)
        for name in names:
            (part / name).replace(folder / name)
    except OSError as error:
        raise _not_saved(folder, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def read_state(path: Path) -> dict[str, Any]:
    """Read what `write_state` wrote; RecordError for a damaged file or another, ConfigurationError for none."""
    try:
        content = read_archive(path)
        state = parse_json(content.pop(JSON_ENTRY))
        arrays = {name: array_of(data) for name, data in content.items()}
        restored: dict[str, Any] = _with_arrays(state, arrays)
    except FileNotFoundError as error:
        raise ConfigurationError(
            "there is no such compensation file",
            where=str(path),
            found="nothing",
            expected="a file that `gyrobench fit` wrote, as compensation.gyrocomp",
        ) from error
    except ARCHIVE_DAMAGE as error:
        raise unreadable(path, f"{type(error).__name__}: {error}") from error
    return restored


def unreadable(path: Path, found: str) -> RecordError:
    """Return the refusal of a file that holds no compensation, or a damaged one."""
    return RecordError(
        "this is not a readable compensation file",
        where=str(path),
        found=found,
        expected=f"a zip with {JSON_ENTRY} and its arrays, finite and of the shapes of its kind",
        remedy="copy the file again, or fit the compensation again",
    )


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _EPOCH)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _without_arrays(value: Any, place: str, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.ndarray):
        name = f"{place}.npy"
        arrays[name] = value
        return {_MARK: name}
    if isinstance(value, Mapping):
        return {str(key): _without_arrays(item, f"{place}/{key}", arrays) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_arrays(item, f"{place}/{index}", arrays) for index, item in enumerate(value)]
    return value.item() if isinstance(value, np.generic) else value


def _with_arrays(value: Any, arrays: Mapping[str, np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, dict):
        if set(value) == {_MARK}:
            return arrays[value[_MARK]]
        return {key: _with_arrays(item, arrays) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_arrays(item, arrays) for item in value]
    return value
