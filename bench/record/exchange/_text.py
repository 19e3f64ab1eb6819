"""Text logs: separator, comments, header, units and first row from the head of the file; then read in one go."""

from __future__ import annotations

import csv
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv

from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    import pandas as pd

_HEAD_BYTES = 1 << 17
_COMMENTS = ("#", "%", "//", "!", "*")
_SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "blank": " ", "bar": "|"}
"""In the order in which they are tried, blanks last; several count as one."""
_MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "null", "-"]
_LINE_END = re.compile(r"\r\n|\n|\r")
_RATE = re.compile(
    r"(?:\bfs\b|(?:sampl\w*|output|data)[ _-]*(?:rate|freq\w*)|^\W*frequency|(sampl\w*|\brate|freq\w*))"
    r"[^\w.]*(?:([km]?hz)\b[^\w.]*)?(\d[\d.,]*(?:e[-+]?\d+)?)\s*([a-z][\w/]*(?: per s\w*)?)?",
    re.I,
)
"""A word for it (the third kind only with a unit), a unit before, the number, a unit behind."""
_RATE_UNITS = re.compile(r"(k?)(?:hz|sps|samples?(?:/s\w*| per s\w*))", re.I)
_DATED = re.compile(r"\d+[-/.:]\d+[-/.:]\d")
"""How a date in numbers, or a time of day, begins."""
_UNIT = re.compile(r"[\[(<]\s*([^\])>]+?)\s*[\])>]\s*$")
_PLAIN_UNIT = re.compile(
    r"(?:deg|rad|arcsec|m|g|mg|ms|us|ns|s|°|c|k|v|lsb|hz|dps|dph|-)\b[\w/^°.()* -]*|°[\w/]*", re.I
)


@dataclass(frozen=True)
class TextLayout:
    """How a text is laid out: rows begin after `skip` lines; `headers` of the columns, and `units` below them.

    `rate_hz`: the sample rate that the lines before the rows state; `remark`: the layout in words.
    """

    separator: str
    decimal: str
    skip: int
    headers: list[str]
    units: list[str]
    rate_hz: float | None
    remark: str


def head_of(file: Path) -> list[str]:
    """Return the first lines of a text log; ConfigurationError for a file that is binary."""
    with file.open("rb") as source:
        head = source.read(_HEAD_BYTES)
    if b"\0" in head[:4096]:
        from bench.record.exchange._described import fitting_description

        fits = fitting_description(file)
        raise ConfigurationError(
            "the log cannot be read: it is binary, of a kind that its name does not say",
            where=str(file),
            expected="text, or a name that ends in .parquet, .mat, .npy, .npz, .h5, .mf4",
            remedy=f"its frames are those of {fits}: say --frames {fits}"
            if fits
            else "describe its frames (docs/frames.md) and say --frames FILE, or save it as one of these",
        )
    text = head.decode("utf-8-sig", "replace")
    text = head.decode("latin-1") if "\ufffd" in text[:-4] else text
    lines = _LINE_END.split(text)  # str.splitlines() knows more ends of lines than readers of CSV do
    return lines[:-1] if len(head) == _HEAD_BYTES or not lines[-1] else lines  # the last one may be cut


def layout_of(file: Path, lines: Sequence[str], separator: str, skip: int | None) -> TextLayout | None:
    """Return the layout of a text log from its first lines, guessed where not told; None without a table."""
    told = _SEPARATORS.get(separator, separator)
    kept = [(number, line) for number, line in enumerate(lines) if line.strip() and number >= (skip or 0)]
    kept = [(number, line) for number, line in kept if not line.lstrip().startswith(_COMMENTS)]
    blank = _SEPARATORS["blank"]
    marks = [told] if told else [each for each in _SEPARATORS.values() if each != blank]
    found = max((_first_row(kept, mark) for mark in marks), key=lambda found: found.width)
    if not told:
        # dates and times have blanks between them: blanks separate where that makes more of the cells numbers
        by_blanks = _first_row(kept, blank)
        found = by_blanks if not found.width or by_blanks.numbers > found.numbers else found
    start, width, used, decimal, _ = found
    if width == 0:
        return None
    before = [line for line in lines[:start] if line.strip()]
    ends = lines[start].rstrip(" ").endswith(used) and used != " "
    headers, units = _header(before, used, width - ends, width)
    named = next((name for name, value in _SEPARATORS.items() if value == used), used)
    remark = (
        f"text separated by {named}{', decimal comma' if decimal == ',' else ''}, {width} columns, "
        f"{'names in the header' if headers else 'no header: c1, c2 ...'}"
        + (f", {start} lines before the first row" if start > 1 else "")
    )
    headers = headers or [f"c{k + 1}" for k in range(width)]
    return TextLayout(used, decimal, start, headers, units, _stated_rate(before, decimal), remark)


def read_rows(file: Path, layout: TextLayout, wanted: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return columns of a text as they stand (numbers, times, or text where a cell is neither), and odd rows.

    Odd rows have another number of cells; they are left out. Comments are none.
    """
    import pandas as pd  # here: it takes as long as the rest of the command line, and few commands read a log

    if layout.separator == " ":
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            frame = pd.read_csv(
                file, sep=r"\s+", header=None, skiprows=layout.skip, names=layout.headers,
                comment="#", on_bad_lines="warn", encoding_errors="replace", low_memory=False,
            )  # fmt: skip
        said = "\n".join(str(warning.message) for warning in caught)
        return frame[list(wanted)], re.findall(r"line \d+(?=: expected)", said)
    odd: list[str] = []

    def skip(row: Any) -> str:
        if not row.text.lstrip().startswith(_COMMENTS):
            odd.append(row.text)
        return "skip"

    read = pa.csv.ReadOptions(skip_rows=layout.skip, column_names=layout.headers, block_size=1 << 24)
    parse = pa.csv.ParseOptions(delimiter=layout.separator, invalid_row_handler=skip)

    def rows(types: dict[str, pa.DataType]) -> pd.DataFrame:
        odd.clear()
        convert = pa.csv.ConvertOptions(
            column_types=types, decimal_point=layout.decimal, null_values=_MISSING, check_utf8=False,
            strings_can_be_null=True, include_columns=list(wanted),
        )  # fmt: skip
        table = pa.csv.read_csv(file, read_options=read, parse_options=parse, convert_options=convert)
        return pd.DataFrame(table.to_pandas())

    try:
        return rows({}), odd
    except pa.ArrowInvalid:  # a column of numbers has words further down
        return rows(dict.fromkeys(wanted, pa.string())), odd


def _fields(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    parts = next(csv.reader([line], delimiter=separator)) if '"' in line else []
    # a line that is in quotes as a whole is not one cell
    return [part.strip() for part in (parts if len(parts) > 1 else line.split(separator))]


class _FirstRow(NamedTuple):
    """Line of the first row of numbers, columns (0: none), separator, decimal mark, and part that are numbers."""

    start: int
    width: int
    separator: str
    decimal: str
    numbers: float


def _first_row(kept: Sequence[tuple[int, str]], separator: str) -> _FirstRow:
    """Return the first row by a separator; `kept` are lines that are neither empty nor comments, numbered."""
    none = _FirstRow(0, 0, separator, ".", 0.0)
    sample = [_fields(line, separator) for _, line in kept[len(kept) // 2 :][-200:]]
    width, often = Counter(map(len, sample)).most_common(1)[0] if sample else (0, 0)
    if often <= 0.8 * len(sample) or (width < 2 and separator != " "):
        return none
    marks = (".", ",") if separator != "," else (".",)
    numeric = {
        mark: float(np.mean([_numeric(row, mark) for row in sample if len(row) == width] or [0.0]))
        for mark in marks
    }
    decimal = max(
        marks, key=lambda mark: numeric[mark]
    )  # of equal ones the point; whole numbers have neither
    if numeric[decimal] <= 0.5:
        return none
    rows = ((n, _fields(line, separator)) for n, line in kept)
    start = next(n for n, row in rows if len(row) == width and _numeric(row, decimal) > 0.5)
    return _FirstRow(start, width, separator, decimal, numeric[decimal])


def _numeric(row: list[str], decimal: str) -> float:
    """Return the part of a row's fields that are numbers or times; empty ones may be."""
    filled = [part.strip("\"'") for part in row if part]
    return sum(_is_number(part, decimal) for part in filled) / max(len(filled), 1)


def _is_number(part: str, decimal: str) -> bool:
    try:
        float(part.replace(",", ".") if decimal == "," else part)
    except ValueError:
        return bool(_DATED.match(part))
    return True


def _header(before: list[str], separator: str, least: int, width: int) -> tuple[list[str], list[str]]:
    """Return names of the columns, empty if there are none, and units below them from the lines before the rows.

    A header has `width` fields, or `least` where every row ends with a separator.
    """
    rows = [_fields(re.sub(r"^[#%!*/ ]+(?:[^,;\t]*: )?", "", line), separator) for line in before]
    rows = [[part.strip("\"' ,") for part in row] + [""] * (width - len(row)) for row in rows
            if least <= len(row) <= width]  # fmt: skip
    stated = rows.pop() if len(rows) > 1 and _all_units(rows[-1]) else [""] * width
    headers: list[str] = []
    for number, part in enumerate(rows[-1] if rows else (), 1):
        part = (part if _UNIT.search(part) else part.strip("[]")) or f"c{number}"  # [a, b, c] is a list
        headers.append(part if part not in headers else f"{part}_{number}")
    return headers, [unit.strip("[]() ") for unit in stated]


def names_and_units(headers: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the names in headers such as "rate [deg/s]", each once, and the units, "" without."""
    names: list[str] = []
    units = []
    inside = [match.group(1) if (match := _UNIT.search(header)) else "" for header in headers]
    outside = {header[: match.start()] for header in headers if (match := _UNIT.search(header))}
    if (
        len(outside) <= 0.5 * len(headers) and len(set(inside)) == len(headers) > 2
    ):  # float(GyroX), float(GyroY)
        return inside, [""] * len(headers)
    for header in headers:
        match = _UNIT.search(header)
        name = header[: match.start()].strip() if match else header
        names.append(name if name and name not in names else header)
        units.append(match.group(1) if match else "")
    return names, units


def _all_units(row: list[str]) -> bool:
    return any(row) and all(not part or _PLAIN_UNIT.fullmatch(part.strip("[]() ")) for part in row)


def _stated_rate(before: list[str], decimal: str) -> float | None:
    """Return the sample rate that lines before the rows state, Hz; None without, or with another unit."""
    for match in (match for line in before for match in _RATE.finditer(line)):
        short, ahead, number, behind = match.groups()
        unit = _RATE_UNITS.fullmatch(ahead or behind or ("" if short else "Hz"))
        if unit is None:
            continue
        thousands = "," if decimal == "." else "."
        try:
            rate_hz = float(number.rstrip(".,").replace(thousands, "").replace(decimal, "."))
        except ValueError:
            continue
        rate_hz *= 1e3 if unit.group(1) else 1.0
        if 0.0 < rate_hz < 1e6:
            return rate_hz
    return None
