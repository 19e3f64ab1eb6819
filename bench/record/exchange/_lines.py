"""Text logs that are no table: a label before every number, or lines of several kinds with a tag first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

_LABELLED = re.compile(
    r"(?<![\w.^])(\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(?:[.,]\d+)?|\d\d?:\d\d:\d\d(?:[.,:]\d+)?"
    r"|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
)
"""A date and time, a time of day or a number that is no part of a name."""
_SUFFIX = re.compile(r"\A\s?([A-Za-z°µ%][\w°/^]*)?")
_TAG = re.compile(r"\s*[\"']?(\$?[A-Za-z_]\w*)[\"']?\s*[,;\t]")
_SAMPLE, _FEWEST = 400, 8
_OFTEN = 0.6
"""Part of the lines of one shape, and part of its names that a line has, from which on they count."""
_BRACKETS = re.compile(r"\(([^)]*)\)|\[([^\]]*)\]")


@dataclass(frozen=True)
class Lines:
    """Columns of text by name, as they stand; units by name; lines of another kind; what was read, in words."""

    frame: pd.DataFrame
    units: dict[str, str]
    odd: list[str]
    remark: str


def lines_of(file: Path, head: Sequence[str], tag: str, sought: Callable[[str], bool]) -> Lines | None:
    """Read a text log that is no table, None if it is none of the kinds known.

    `head` are its first lines. Of tagged lines those of `tag` are read, else those with most names `sought`,
    of equal ones the most frequent.
    """
    sample = [line for line in head if line.strip()]
    return _tagged(file, sample, tag, sought) or _labelled(file, sample[len(sample) // 2 :][-_SAMPLE:])


def _labelled(file: Path, sample: Sequence[str]) -> Lines | None:
    shapes = Counter(_LABELLED.sub("\0", line).rstrip() for line in sample)
    shape, often = shapes.most_common(1)[0] if shapes else ("", 0)
    names, units = _labels(shape)
    if often < _OFTEN * len(sample) or len(sample) < _FEWEST or len(names) < 2:
        return None
    # Words with digits that change, such as a receiver's state, give lines of several shapes with the same names.
    places: dict[str, list[int]] = {}
    rows, odd = [], []
    with file.open(encoding="utf-8", errors="replace") as source:
        for line in map(str.rstrip, source):
            own = _LABELLED.sub("\0", line)
            if own not in places:
                known = {name: place for place, name in enumerate(_labels(own)[0])}
                places[own] = [known.get(name, -1) for name in names]
            if sum(place >= 0 for place in places[own]) > _OFTEN * len(names):
                numbers = [*_LABELLED.findall(line), None]
                rows.append([numbers[place] for place in places[own]])
            elif line:
                odd.append(line)
    frame = pd.DataFrame(rows, columns=names)
    return Lines(frame, units, odd, f"text, {len(names)} numbers a line, each with its name before it")


def _labels(shape: str) -> tuple[list[str], dict[str, str]]:
    """Return names, from the text before each number of a line, and units, from the text or right behind it."""
    parts = shape.split("\0")
    names: list[str] = []
    units: dict[str, str] = {}
    group = group_unit = ""
    for number, part in enumerate(parts[:-1]):
        own = _SUFFIX.sub("", part, count=1) if number else part
        unit = next((a or b for a, b in _BRACKETS.findall(own)), "")
        text = re.sub(r"[\"'{}$]+", " ", _BRACKETS.sub(" ", own)).strip(" \t,;|=:")
        head, colon, key = text.rpartition(":")
        if ":" in own or "," in text:  # a new group of names, or none
            group, group_unit = (head.split(",")[-1].strip(), unit) if colon else ("", "")
        unit = unit or group_unit
        key = re.split(r"[,;|\s]+", (key if colon else text).strip() or "c")[-1]
        name = " ".join(filter(None, (group if len(key) <= 2 else "", key)))
        name = name if name not in names and name != "c" else f"c{number + 1}"
        names.append(name)
        if behind := _SUFFIX.match(parts[number + 1]):
            unit = unit or behind.group(1) or ""
        if unit:
            units[name] = unit
    return names, units


def _tagged(file: Path, sample: Sequence[str], tag: str, sought: Callable[[str], bool]) -> Lines | None:
    tags = Counter(match.group(1) for line in sample if (match := _TAG.match(line)))
    if sum(tags.values()) < 0.9 * len(sample) or len(tags) < 2 or len(sample) < _FEWEST:
        return None
    kinds: dict[str, list[list[str]]] = {}
    with file.open(encoding="utf-8", errors="replace") as source:
        for line in source:
            if match := _TAG.match(line):
                cells = [cell.strip(" \"'\r\n") for cell in re.split(r"[,;\t]", line)]
                kinds.setdefault(match.group(1), []).append(cells[1:])
    widths = {name: Counter(map(len, rows)).most_common(1)[0][0] for name, rows in kinds.items()}
    names = {name: _names_of(name, widths[name], kinds) for name in kinds}
    full = [name for name in kinds if len(kinds[name]) >= _FEWEST and widths[name] > 1 and name != "FMT"]
    if not full or (tag and tag not in kinds):
        return None
    chosen = tag or max(full, key=lambda name: (sum(map(sought, names[name])), len(kinds[name])))
    rows = [row for row in kinds[chosen] if len(row) == widths[chosen]]
    odd = [",".join(row) for row in kinds[chosen] if len(row) != widths[chosen]]
    others = ", ".join(name for name in full if name != chosen) or "none"
    remark = f"text of {len(kinds)} kinds of lines, those of {chosen} read; others, for --table: {others}"
    return Lines(pd.DataFrame(rows, columns=names[chosen]), {}, odd, remark)


def _names_of(tag: str, width: int, kinds: dict[str, list[list[str]]]) -> list[str]:
    """Return names of a tag's columns: from a line that has the tag and then names (FMT), else c1, c2 ..."""
    for rows in kinds.values():
        for row in rows[:1000]:
            if tag in row[:-width] and all(re.fullmatch(r"[A-Za-z]\w*", name) for name in row[-width:]):
                return row[-width:]
    return [f"c{k + 1}" for k in range(width)]
