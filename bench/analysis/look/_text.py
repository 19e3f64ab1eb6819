"""Text logs: separator, comments, header, units and first row from the head of the file; then read in one go."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_HEAD_BYTES = 1 << 17
_COMMENTS = ("#", "%", "//", "!", "*")
_SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "blank": " ", "bar": "|"}
"""In the order in which they are tried; blanks count as one."""
_RATE = re.compile(r"(?:\bfs\b|sampl\w*[ _]*(?:rate|freq\w*)?|frequency|\brate)\W*([\d.]+)\s*(k?hz)?", re.I)
_UNIT = re.compile(r"[\[(<]\s*([^\])>]+?)\s*[\])>]\s*$")
_PLAIN_UNIT = re.compile(
    r"(?:deg|rad|arcsec|m|g|mg|ms|us|ns|s|°|c|k|v|lsb|hz|dps|dph|-)\b[\w/^°.()* -]*", re.I
)
_PACKED = (".gz", ".bz2", ".zst", ".lz4", ".br", ".zip", ".xz")
Head = tuple[dict[str, Array], list[str], dict[str, str], float | None]


@dataclass(frozen=True)
class _Shape:
    """How a text is laid out: rows begin after `skip` lines; `names` of the columns."""

    separator: str
    decimal: str
    skip: int
    names: list[str]
    units: dict[str, str]
    rate_hz: float | None
    remarks: list[str]


def read_text(file: Path, separator: str, skip: int | None) -> Head:
    """Return columns, remarks, units and the header's own word for the sample rate of a text log."""
    if file.suffix.lower() in _PACKED:
        raise ConfigurationError(
            "a packed log is not read: it can be of any size", where=str(file), remedy="unpack it first"
        )
    with file.open("rb") as source:
        head = source.read(_HEAD_BYTES)
    if b"\0" in head[:4096]:
        raise ConfigurationError(
            "the log is binary, of a kind that its name does not say",
            where=str(file),
            expected="text, or a name that ends in .parquet, .mat, .npy, .npz, .h5, .mf4",
            remedy="describe its frames (docs/frames.md), or save it as one of these",
        )
    shape = _shape(file, head.decode("utf-8-sig", "replace"), separator, skip)
    return _columns(file, shape), shape.remarks, shape.units, shape.rate_hz


def _shape(file: Path, text: str, separator: str, skip: int | None) -> _Shape:
    lines = text.splitlines()
    lines = lines[:-1] if len(text) >= _HEAD_BYTES - 4 else lines  # the last one may be cut
    known = _SEPARATORS.get(separator, separator)
    first, known, decimal = max(
        (_first_row(lines, one, skip) for one in ([known] if known else _SEPARATORS.values())),
        key=lambda found: found[0][1],
    )
    start, width = first
    if width == 0:
        raise ConfigurationError(
            "no rows of numbers in the head of the text",
            where=str(file),
            found=repr(lines[0][:60]) if lines else "nothing",
            expected="columns of numbers",
            remedy="say --separator and --skip",
        )
    before = [line for line in lines[:start] if line.strip()]
    names, units = _header(before, known, width)
    rate_hz = _stated_rate(before)
    named = {value: key for key, value in _SEPARATORS.items()}
    remarks = [
        f"text separated by {named.get(known, known)}{', decimal comma' if decimal == ',' else ''}, "
        f"{width} columns, {'names in the header' if names else 'no header: c1, c2 ...'}"
        + (f", {start} lines before the first row" if start > 1 else "")
    ]
    return _Shape(
        known, decimal, start, names or [f"c{k + 1}" for k in range(width)], units, rate_hz, remarks
    )


def _fields(line: str, separator: str) -> list[str]:
    return (
        line.split() if separator == " " else [part.strip() for part in line.rstrip("\r\n").split(separator)]
    )


def _first_row(lines: list[str], separator: str, skip: int | None) -> tuple[tuple[int, int], str, str]:
    """Return (line of the first row of numbers, columns), the separator and the decimal mark; 0 columns: none."""
    kept = [(number, line) for number, line in enumerate(lines) if line.strip() and number >= (skip or 0)]
    kept = [(number, line) for number, line in kept if not line.lstrip().startswith(_COMMENTS)]
    sample = [_fields(line, separator) for _, line in kept[len(kept) // 2 :][-200:]]
    if not sample:
        return (0, 0), separator, "."
    width, often = Counter(map(len, sample)).most_common(1)[0]
    for decimal in (".", ",") if separator != "," else (".",):
        numeric = np.mean([_numeric(row, decimal) for row in sample if len(row) == width])
        if often > 0.8 * len(sample) and numeric > 0.5 and (width > 1 or separator == " "):
            rows = ((n, _fields(line, separator)) for n, line in kept)
            start = next(n for n, row in rows if len(row) == width and _numeric(row, decimal) > 0.5)
            return (start, width), separator, decimal
    return (0, 0), separator, "."


def _numeric(row: list[str], decimal: str) -> float:
    """Return the part of a row's fields that are numbers; empty ones may be."""
    filled = [part for part in row if part]
    return sum(_is_number(part, decimal) for part in filled) / max(len(filled), 1)


def _is_number(part: str, decimal: str) -> bool:
    try:
        float(part.replace(",", ".") if decimal == "," else part)
    except ValueError:
        return False
    return True


def _header(before: list[str], separator: str, width: int) -> tuple[list[str], dict[str, str]]:
    """Return names and units of the columns from the lines before the first row; no names if there are none."""
    candidates = [_fields(line.lstrip("#%!*/ "), separator) for line in before]
    rows = [
        [part.strip("\"' ,[]") if part[-1:] != "]" or "[" not in part[1:] else part for part in row]
        for row in candidates
        if len(row) == width
    ]
    if not rows:
        return [], {}
    stated = rows.pop() if len(rows) > 1 and _all_units(rows[-1]) else []
    names, units = [], {}
    for number, part in enumerate(rows[-1]):
        match = _UNIT.search(part)
        name = (part[: match.start()] if match else part).strip() or f"c{number + 1}"
        name = name if name not in names else f"{name}_{number + 1}"
        unit = match.group(1) if match else stated[number].strip("[]() ") if stated else ""
        names.append(name)
        if unit:
            units[name] = unit
    return names, units


def _all_units(row: list[str]) -> bool:
    return all(not part or _PLAIN_UNIT.fullmatch(part.strip("[]() ")) for part in row) and any(row)


def _stated_rate(before: list[str]) -> float | None:
    for line in before:
        if match := _RATE.search(line):
            kilo = 1e3 if (match.group(2) or "").lower() == "khz" else 1.0
            rate_hz = kilo * float(match.group(1).rstrip(".") or 0.0)
            if 0.0 < rate_hz < 1e6:
                return rate_hz
    return None


def _columns(file: Path, shape: _Shape) -> dict[str, Array]:
    if shape.separator == " ":
        frame = pd.read_csv(
            file, sep=r"\s+", header=None, skiprows=shape.skip, names=shape.names, comment=None, dtype=None,
            on_bad_lines="skip", encoding_errors="replace", index_col=False, low_memory=False,
        )  # fmt: skip
        return {str(name): _numbers(frame[name], shape) for name in frame.columns}
    read = pa.csv.ReadOptions(skip_rows=shape.skip, column_names=shape.names, block_size=1 << 24)
    parse = pa.csv.ParseOptions(
        delimiter=shape.separator, invalid_row_handler=lambda row: "skip", newlines_in_values=False
    )
    for types in ({}, dict.fromkeys(shape.names, pa.string())):
        convert = pa.csv.ConvertOptions(
            column_types=types, decimal_point=shape.decimal, null_values=["", "NaN", "nan", "NA", "null", "-"],
            strings_can_be_null=True, include_columns=shape.names,
        )  # fmt: skip
        try:
            table = pa.csv.read_csv(file, read_options=read, parse_options=parse, convert_options=convert)
        except pa.ArrowInvalid:
            if types:
                raise
            continue
        break
    return {name: _numbers(table[name].to_pandas(), shape) for name in shape.names}


def _numbers(values: pd.Series, shape: _Shape) -> Array:
    """Return numbers; date-times as s since 1970, anything else as NaN."""
    if pd.api.types.is_numeric_dtype(values):
        return np.asarray(values.to_numpy(np.float64, na_value=np.nan))
    if not pd.api.types.is_datetime64_any_dtype(values):
        text = values.astype("string")
        numbers = pd.to_numeric(text.str.replace(",", ".") if shape.decimal == "," else text, errors="coerce")
        if numbers.notna().mean() > 0.5:
            return np.asarray(numbers.to_numpy(np.float64, na_value=np.nan))
        values = pd.to_datetime(text, errors="coerce", format="mixed", utc=True)
    seconds = values.dt.tz_localize(None) if getattr(values.dt, "tz", None) is not None else values
    counts = seconds.to_numpy("datetime64[ns]").astype(np.int64)
    return np.where(seconds.isna().to_numpy(), np.nan, counts * 1e-9)
