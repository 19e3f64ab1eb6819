"""The one way to read a log of other software, whatever its format: columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from bench.record.exchange._array_files import columns_of, hdf5_arrays, is_text, mat_arrays
from bench.record.exchange._cells import cells_of
from bench.record.exchange._text import head_of, layout_of, names_and_units, read_rows
from bench.record.recording import check_room
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import from_extra

if TYPE_CHECKING:
    import pandas as pd

TIME_OF_FILE = "time of the file"
"""Name of the times, in s, that an MDF file has beside its channels."""
_MDF_ENDINGS = (".mf4", ".mdf", ".dat")
_PACKED = (".gz", ".bz2", ".zst", ".lz4", ".br", ".zip", ".xz")
_KINDS = "text, Parquet (.parquet, .pq), MAT, NPY, NPZ, HDF5 (.h5) or MDF (.mf4)"
_LABELS = ("_label", "_labels", "_names")
_SHOWN = 20
Sought = Callable[[str], bool]
Missing = Mapping[str, Collection[str]]
_NONE_MISSING: Missing = {}


class Dated(NamedTuple):
    """Of a column of date-times: whether they have no zone, and what was guessed of their order."""

    local: bool
    guessed: str


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a log, name -> shape (n,), NaN where a value is missing or no number.

    `units` and `rate_hz`: what the file says of units and of the sample rate; `time`: the column that it says
    is the time, in s (date-times since 1970), "" without; `words`: a cell that is no number, by column;
    `remarks`: what was guessed or left out. `dated`: columns made of date-times or times of day.
    `times`: by column of an MDF file its own times, s, where they are others.
    """

    columns: dict[str, Array]
    remarks: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    rate_hz: float | None = None
    time: str = ""
    words: dict[str, str] = field(default_factory=dict)
    dated: dict[str, Dated] = field(default_factory=dict)
    times: dict[str, Array] = field(default_factory=dict)


def read_table(
    file: Path, names: Sequence[str] = (), *, separator: str = "", skip: int | None = None, group: str = "",
    dbc: Sequence[Path] = (), frames: str = "", rate_hz: float | None = None,
    missing: Missing = _NONE_MISSING, sought: Sought = lambda name: False, apart: bool = False,
) -> Table:  # fmt: skip
    """Read a log, by the ending of its name; `names`: these columns only, all of which must be there.

    For text are `separator`, `skip` (lines before the first row of numbers) and `missing` (words that stand for
    a missing value, by column). `group` names one of several tables in an NPZ, MAT or HDF5 file, `dbc` decode the
    CAN frames of an MDF file. `frames`: a description's name or file; the log is the bytes of such a unit at
    `rate_hz`, of which `group` names a message. Channels of an MDF file are interpolated to the
    times of the first of `names`, or as they are if those of each may stand `apart`; without names, they are
    those of the group with most channels `sought`, of equal ones the longest.
    ConfigurationError for a file that cannot be read or lacks a column.
    """
    if not file.is_file():
        raise ConfigurationError("the log cannot be read: there is no such file", where=str(file))
    ending = file.suffix.lower()
    try:
        if frames:
            return _described(file, frames, names, group, rate_hz)
        if ending in _PACKED:
            raise OSError("it is packed, and a packed file can be of any size: unpack it first")
        if ending in (".parquet", ".pq"):
            return _parquet(file, names)
        if ending == ".npy":
            array = np.load(file, mmap_mode="r", allow_pickle=False)
            return _arrays(file, {file.stem: array}, names, group, sought)
        if ending == ".npz":
            return _arrays(file, dict(np.load(file, allow_pickle=False)), names, group, sought)
        if ending in (".mat", ".h5", ".hdf5", ".hdf") and not is_text(file):
            return _arrays(
                file, mat_arrays(file) if ending == ".mat" else hdf5_arrays(file), names, group, sought
            )
        if has_own_times(file):
            return _mdf(file, names, dbc, sought, apart=apart)
        head = head_of(file)
        layout = layout_of(file, head, separator, skip)
        if layout is None:
            return _lines(file, head, names, group, sought)
        labels, units = _labelled(names, layout.headers, layout.units, file)
        frame, odd = read_rows(file, layout, list(labels))
        frame = frame.rename(columns=labels)
        table = _table(frame, layout.decimal, [layout.remark], units, layout.rate_hz, missing)
        return _without_odd(table, odd)
    except ConfigurationError:
        raise
    except (OSError, MemoryError, ValueError, KeyError, pa.ArrowException) as error:
        raise _unreadable(file, str(error).splitlines()[0] if str(error) else type(error).__name__) from error


def has_own_times(file: Path) -> bool:
    """Return whether a log is an MDF file, which has times of its own; text logs may end in .dat, too."""
    return file.suffix.lower() in _MDF_ENDINGS and file.is_file() and not is_text(file)


def _described(
    file: Path, description: str, names: Sequence[str], message: str, rate_hz: float | None
) -> Table:
    from bench.record.exchange._described import FRAME_TIME, read_described

    found = read_described(file, description, message, rate_hz)
    wanted = _checked(names, list(found.columns), file)
    time = FRAME_TIME if FRAME_TIME in wanted else ""
    units = {name: found.units[name] for name in wanted}
    return Table({name: found.columns[name] for name in wanted}, found.remarks, units, time=time)


def _lines(file: Path, head: Sequence[str], names: Sequence[str], tag: str, sought: Sought) -> Table:
    """Return the columns of a text that is no table; ConfigurationError if it is of no kind that is known."""
    from bench.record.exchange._lines import lines_of

    lines = lines_of(file, head, tag, sought)
    if lines is None:
        raise ConfigurationError(
            "the log cannot be read: no rows of numbers in the head of the text",
            where=str(file),
            found=repr(head[0][:60]) if head else "nothing",
            expected="columns of numbers, or a name before every number",
            remedy="name the separator and the lines to skip (`gyrobench look` takes --separator and --skip)",
        )
    wanted = _checked(names, [str(name) for name in lines.frame], file)
    units = {name: unit for name, unit in lines.units.items() if name in wanted}
    return _without_odd(_table(lines.frame[wanted], ".", [lines.remark], units), lines.odd)


def _without_odd(table: Table, odd: Sequence[str]) -> Table:
    """Return a table with a word on rows that were left out, if there are."""
    if odd:
        table.words[""] = f"{len(odd)} rows with another number of cells left out, the first {odd[0][:60]!r}"
        table.remarks.append(table.words[""])
    return table


def _unreadable(file: Path, found: str) -> ConfigurationError:
    return ConfigurationError("the log cannot be read", where=str(file), found=found, expected=_KINDS)


def _labelled(
    wanted: Sequence[str], headers: Sequence[str], stated: Sequence[str], file: Path
) -> tuple[dict[str, str], dict[str, str]]:
    """Return header -> label of the columns wanted (by header, or its name without unit), and units by label."""
    names, units = names_and_units(headers)
    by_name = dict(zip(names, headers, strict=True)) | {header: header for header in headers}
    _checked(wanted, [*names, *(header for header in headers if header in wanted)], file)
    labels = {by_name[name]: name for name in wanted} or dict(zip(headers, names, strict=True))
    pairs = zip(headers, units, stated, strict=True)
    return labels, {
        labels[header]: own or below for header, own, below in pairs if header in labels and (own or below)
    }


def _checked(names: Sequence[str], present: Sequence[str], file: Path) -> list[str]:
    """Return the names wanted, all if none are; ConfigurationError for one that the file lacks."""
    if missing := [name for name in names if name not in present]:
        present = list(dict.fromkeys(present))
        more = f" and {len(present) - _SHOWN} more" if len(present) > _SHOWN else ""
        raise ConfigurationError(
            "the file has no such column",
            where=str(file),
            found=", ".join(missing),
            expected=(", ".join(present[:_SHOWN]) or "columns") + more,
        )
    return list(dict.fromkeys(names or present))


def _table(
    frame: pd.DataFrame, decimal: str, remarks: list[str], units: dict[str, str], rate_hz: float | None = None,
    missing: Missing = _NONE_MISSING,
) -> Table:  # fmt: skip
    """Return the columns of a frame: numbers as they are, date-times as s since 1970, other text left out."""
    table = Table({}, remarks, units, rate_hz)
    time = ""
    for name, values in ((str(name), values) for name, values in frame.items()):
        cells = cells_of(values, decimal, missing.get(name, ()))
        if cells.word:
            table.words[name] = cells.word
        if cells.numbers is None:
            continue
        table.columns[name] = cells.numbers
        if cells.remark:
            remarks.append(f"{name}: {cells.remark}")
        if cells.dated:
            units[name] = "s"
            table.dated[name] = Dated(cells.local, cells.remark)
            time = time or (name if bool((np.diff(cells.numbers) > 0.0).mean() > 0.9) else "")
    left_out = [name for name in map(str, frame.columns) if name not in table.columns]
    if left_out:
        remarks.append(f"left out, no numbers: {', '.join(left_out)}")
    if words := [f"{name} ({word})" for name, word in table.words.items() if name in table.columns]:
        remarks.append(f"cells that are no numbers count as missing: {', '.join(words)}")
    return replace(table, time=time)


def _parquet(file: Path, names: Sequence[str]) -> Table:
    import pandas as pd

    with pyarrow.parquet.ParquetFile(file) as parquet:
        schema = parquet.schema_arrow
        stated = [(part.metadata or {}).get(b"unit", b"").decode() for part in schema]
        labels, units = _labelled(names, schema.names, stated, file)
        check_room(str(file), parquet.metadata.num_rows, len(labels) + 1)
        table = parquet.read(columns=list(labels))
    frame = pd.DataFrame({label: table[name].to_pandas() for name, label in labels.items()})
    return _table(frame, ".", [], units)


def _arrays(file: Path, arrays: dict[str, Any], names: Sequence[str], group: str, sought: Sought) -> Table:
    """Return the columns of a file's arrays of one length: vectors by their names, columns of matrices by number,
    or by the words of an array NAME_label, NAME_labels or NAME_names beside them.

    Of several lengths that with most columns `sought` (or `names`) is taken, of equal ones the longest.
    """
    labels = {name: np.atleast_1d(np.squeeze(np.asarray(array))) for name, array in arrays.items()}
    tables = {
        name: array
        for name, array in labels.items()
        if array.dtype.names or (array.dtype.kind in "iufb" and array.ndim in (1, 2))
    }
    if group:
        tables = {group: tables[_checked([group], list(tables), file)[0]]}
    by_length: dict[int, dict[str, Any]] = {}
    for name, array in tables.items():
        rows = len(array) if array.dtype.names else max(array.shape)
        words = next((labels[key] for end in _LABELS if (key := name + end) in labels), np.zeros(0))
        by_length.setdefault(rows, {}).update(columns_of(file, name if len(tables) > 1 else "", array, words))
    chosen = max(
        by_length, key=lambda rows: (sum(n in names or sought(n) for n in by_length[rows]), rows), default=0
    )
    columns = {name: np.array(column, np.float64) for name, column in by_length.get(chosen, {}).items()}
    wanted = _checked(names, list(columns), file)
    left_out = [name for rows, others in by_length.items() if rows != chosen for name in others]
    more = f" and {len(left_out) - _SHOWN} more" if len(left_out) > _SHOWN else ""
    remarks = [f"left out, of another length: {', '.join(left_out[:_SHOWN])}{more}"] if left_out else []
    return Table({name: columns[name] for name in wanted}, remarks)


def _mdf(file: Path, names: Sequence[str], dbc: Sequence[Path], sought: Sought, *, apart: bool) -> Table:
    asammdf = load_asammdf()
    try:
        with asammdf.MDF(file) as opened:
            mdf = opened.extract_bus_logging({"CAN": [(str(path), 0) for path in dbc]}) if dbc else opened
            groups = _groups(mdf)
            if names:
                places = {name: place for group in groups for name, place in group.items()}
                _checked(names, sorted(places), file)
                if twice := [name for name in names if sum(name in group for group in groups) > 1]:
                    raise _unreadable(file, f"{', '.join(twice)} in more than one group of the file")
            else:
                places = max(groups, key=lambda group: sum(map(sought, group)), default={})
            signals = {name: _signal(mdf, *places[name]) for name in names or places}
    except ConfigurationError:
        raise
    except Exception as error:  # whatever asammdf raises on a damaged file
        raise _unreadable(file, f"{type(error).__name__}: {error}") from error
    if not signals:
        raise ConfigurationError(
            "the MDF file has no channels of numbers",
            where=str(file),
            expected="signals, or CAN frames and a DBC file",
            remedy="`gyrobench look --dbc FILE` decodes CAN frames",
        )
    time_s = np.asarray(next(iter(signals.values())).timestamps, np.float64)
    columns, times = {}, {}
    for name, signal in signals.items():
        if signal.samples.dtype.kind in "iufb" and signal.samples.ndim == 1:
            columns[name], own_s = _values(signal), np.asarray(signal.timestamps, np.float64)
            if np.array_equal(own_s, time_s):
                continue
            if apart:
                times[name] = own_s
            else:
                columns[name] = _on_times(time_s, own_s, columns[name])
    remarks = [f"the group of {len(columns)} channels, one of {len(groups)} in the file"]
    words = {name: "text" for name in signals if name not in columns}
    if words:
        remarks.append(f"left out, no numbers: {', '.join(words)}")
    units = {name: str(signals[name].unit) for name in columns if signals[name].unit}
    return Table(
        {TIME_OF_FILE: time_s, **columns}, remarks, units, time=TIME_OF_FILE, words=words, times=times
    )


def _groups(mdf: Any) -> list[dict[str, tuple[str, int, int]]]:
    """Return the channels of every group with rows, the longest group first: name -> name, group and index."""
    by_rows = sorted(
        range(len(mdf.groups)), key=lambda number: -int(mdf.groups[number].channel_group.cycles_nr)
    )
    groups = []
    for number in by_rows:
        if mdf.groups[number].channel_group.cycles_nr > 0:
            places: dict[str, tuple[str, int, int]] = {}
            for index, channel in enumerate(mdf.groups[number].channels):
                if index != mdf.masters_db.get(number):
                    name = channel.name if channel.name not in places else f"{channel.name}_{index}"
                    places[name] = (channel.name, number, index)
            groups.append(places)
    return groups


def _signal(mdf: Any, name: str, group: int, index: int) -> Any:
    """Return a signal with all its rows; the numbers behind words where it has both."""
    signal = mdf.get(name, group, index, ignore_invalidation_bits=True)
    if signal.samples.dtype.kind not in "iufb":
        raw = mdf.get(name, group, index, ignore_invalidation_bits=True, raw=True)
        return raw if raw.samples.dtype.kind in "iufb" else signal
    return signal


def _values(signal: Any) -> Array:
    """Return a signal's values, (n,), NaN where marked invalid."""
    values = np.array(signal.samples, np.float64)
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits, np.bool_)] = np.nan
    return values


def _on_times(time_s: Array, own_s: Array, values: Array) -> Array:
    """Return values at times of their own (m,) interpolated to others (n,)."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(time_s), np.nan)
    return np.asarray(np.interp(time_s, own_s[known], values[known]))


def load_asammdf() -> Any:
    """Return the module that reads and writes MDF files; ConfigurationError without it."""
    return from_extra("asammdf", "exchange", "reading and writing MDF files")
