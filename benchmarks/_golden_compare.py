"""Two captures held side by side: every difference with both values, by field.

What may differ from one capture of the same code to the next stands in five small tables here, each line with
its reason: `EXCLUDED` files, `TEXTS` within strings, `FIELDS` that are not looked at, `MASKED` bytes and `LOOSE`
numbers.
"""

from __future__ import annotations

import difflib
import importlib
import json
import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

_MANIFEST = "checksum of a manifest, which has the time in it"
EXCLUDED = (
    ("capture.json", "where the capture lies and by which command it was made"),
    ("*/live/*", "picture of a run as it goes on, written ten times a second of the host"),
    ("*/.lock", "which process has a campaign"),
    ("*/.catalogue/*", "index made anew from the run folders at any time; `runs list` is compared"),
)
TEXTS = (
    (r"\b20\d{6}-\d{6}\b", "<id>", "run ids begin with the time of the host"),
    (r"\b20\d\d-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|\+00:00)?", "<utc>", "times of the host"),
    (r"/dev/pts/\d+", "<terminal>", "pseudo-terminals as the system numbers them"),
    (r"127\.0\.0\.1:\d+", "<port>", "ports as the system numbers them"),
    (r"virtual:///\S*?/clock", "<clock>", "the emulated clock lies in a temporary folder"),
    (r"<code>[0-9a-f]{64}</code>", "<manifest>", _MANIFEST),
    (r'" = "[0-9a-f]{64}"', '" = "<manifest>"', _MANIFEST),
    (r"(imu 1 temperature</td>\s*<td[^>]*><strong>)[\d.]+", r"\1<latest>", "as in LOOSE"),
    (
        r"(closed \S+ \(\S+\)) [\d.]+ s|(Seconds a case): .*",
        r"\1\2 <wall>",
        "how long a case of the exam took",
    ),
    (r"\bin [\d.,]+ s \([\d.,]+ x\)", "in <wall>", "how long a rehearsal took"),
)
FIELDS = (
    (
        "*",
        r"(.*\.)?(started_utc|ended_utc|utc|started_s|run_id|wall_s|cpu_s|pid|hostname)",
        "of this run of the code",
    ),
    ("*", r"software\.gyrobench", "version of this checkout"),
    (
        "*/manifest.json",
        r"files\.events\.jsonl\.(sha256|bytes)",
        "its lines are compared, some of them loosely",
    ),
    ("*/manifest.json", r"seal", _MANIFEST),
    ("results/*/stdout", r"line\[\] (result|run)\.bytes", "size of the folder, live/ with it"),
    (
        "*/out/states/events.jsonl",
        r"line\[\] .*time_s",
        "the journal of a campaign counts seconds of the host",
    ),
    (
        "*/compensation.json",
        r"\w+_runs\[\]\.checksum|(training_)?runs\.<id>-(thermal-ramp|constant-rotation)( \d)?",
        _MANIFEST,
    ),
    ("results/gap-diagnose-*/stdout", r"runs\.(<id>-.*|train-1)", _MANIFEST),
    ("*/runs/served/manifest.json", r"bench_file_sha256", "the ports of the lab are in its bench file"),
    ("*/gap-runs/*/manifest.json", r"bench_file_sha256", "so are those that the run had which is rehearsed"),
    ("*/exam/results.jsonl", r"line\[\].*\.seconds", "how long a case took"),
)
MASKED = (("*.blf", 40, 72, "begin and end of the recording by the host's clock, in the file's head"),)
_BLOCKS = "a sum over blocks of samples as they arrived"
LOOSE = (
    (
        "*",
        r".*\b(output_at_rest|reference_output|azimuth_error|azimuth_error_2_sigma)\.value",
        1e-9,
        0.0,
        _BLOCKS,
    ),
    ("*/export-*/events.*", r"line\[\]|column fields", 1e-9, 0.0, _BLOCKS),
    ("results/campaign-status*/stdout", r".*\bnow\..*", 0.0, math.inf, "as far as the live picture had come"),
    ("*", r".*\bimu_1_temperature\.value", 0.0, 0.1, "the sample that was the latest when the host asked"),
)
_SHOWN = 5
_WIDTH = 160
_SPACE = re.compile(r"\s*")
_NUMBER = re.compile(r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)")


@dataclass(frozen=True)
class Difference:
    """A field of a file that is not the same in both captures."""

    file: str
    field: str
    a: str
    b: str

    @property
    def group(self) -> str:
        """What a human lists it by: the kind of file and the field, whichever run or line it is in."""
        kind = self.file if self.file.startswith("results/") else f"*/{self.file.rpartition('/')[2]}"
        return f"{kind}: {_general(self.field)}"


def compare(a: Path, b: Path) -> list[Difference]:
    """Return what differs between the captures `a` and `b` beyond what the tables allow."""
    first, second = _files(a), _files(b)
    homes = (_home(a), _home(b))
    found: list[Difference] = []
    for name in sorted(first.keys() | second.keys()):
        if any(fnmatch(f"/{name}", f"*/{pattern.removeprefix('*/')}") for pattern, _ in EXCLUDED):
            continue
        if name not in first or name not in second:
            there = [("there" if name in files else "missing") for files in (first, second)]
            found.append(Difference(name, "file", *there))
            continue
        contents = [files[name].read_bytes() for files in (first, second)]
        found += [
            Difference(name, field, left, right)
            for field, left, right in _contents(name, contents[0], contents[1], homes)
        ]
    return found


def shown(found: Sequence[Difference], *, everything: bool = False) -> str:
    """Return differences as text: a paragraph a field, with how often and both values of the first few."""
    lines = []
    for group, some in groupby(sorted(found, key=lambda one: one.group), key=lambda one: one.group):
        members = list(some)
        lines.append(f"{group} ({len(members)})")
        for one in members if everything else members[:_SHOWN]:
            lines += [f"    {one.file} {one.field}", f"      a: {one.a}", f"      b: {one.b}"]
        if not everything and len(members) > _SHOWN:
            lines.append(f"    ... {len(members) - _SHOWN} more")
    return "\n".join([*lines, f"{len(found)} differences"])


def _home(capture: Path) -> str:
    """Return where a capture was made, which its outputs may name; it may have been moved since."""
    about = capture / "capture.json"
    return str(json.loads(about.read_text(encoding="utf-8"))["folder"]) if about.exists() else str(capture)


def _files(folder: Path, prefix: str = "") -> dict[str, Path]:
    """Return the files below `folder` by name; folders named after the time are named after their order."""
    found: dict[str, Path] = {}
    seen: dict[str, int] = {}
    for path in sorted(folder.iterdir()):
        name = _plain(path.name, "")
        seen[name] = seen.get(name, 0) + 1
        name = prefix + (f"{name} {seen[name]}" if name != path.name else name)
        if path.is_dir():
            found |= _files(path, f"{name}/")
        else:
            found[name] = path
    return found


def _plain(text: str, home: str) -> str:
    """Return a text without what TEXTS allows to differ."""
    if home:
        text = text.replace(home, "<capture>")
    for pattern, instead, _ in TEXTS:
        text = re.sub(pattern, instead, text)
    return text


Found = Iterator[tuple[str, str, str]]
Homes = tuple[str, str]


def _contents(name: str, a: bytes, b: bytes, homes: Homes) -> Found:
    """Yield field and both values wherever two files differ, by what kind of file it is."""
    if a == b:
        return
    ending = name.rpartition("/")[2].rpartition(".")[2]
    if a[:4] == b[:4] == b"PAR1":
        yield from _tables(name, a, b)
    elif a[:2] == b[:2] == b"PK":
        yield from _archives(name, a, b, homes)
    elif a[:3] == b[:3] == b"MDF":
        yield from _measurement_files(name, a, b, homes)
    elif ending in ("bin", "idx", "blf", "onnx", "pdf", "png"):
        masked = [_masked(name, side) for side in (a, b)]
        if masked[0] != masked[1]:
            yield "bytes", *_bytes(masked[0], masked[1])
    else:
        yield from _documents(name, a, b, homes)


def _documents(name: str, a: bytes, b: bytes, homes: Homes) -> Found:
    """Compare two texts: as JSON, as lines of JSON, or line by line."""
    try:
        texts = (a.decode(), b.decode())
    except UnicodeDecodeError:
        yield "bytes", *_bytes(a, b)
        return
    values = [_as_json(text) for text in texts]
    if all(value is not None for value in values):
        yield from _values(name, "", values[0], values[1], homes)
        return
    lines = [_plain(text, home).splitlines() for text, home in zip(texts, homes, strict=True)]
    yield from _lines(name, lines[0], lines[1])


def _as_json(text: str) -> Any:
    """Return the JSON of a text, None if it is none; of several objects those that are not progress."""
    found, at, text = [], 0, text.strip()
    try:
        while at < len(text):
            one, at = json.JSONDecoder().raw_decode(text, at)
            found.append(one)
            at = _SPACE.match(text, at).end()  # type: ignore[union-attr]  # it matches nothing, too
    except ValueError:
        return None
    kept = [one for one in found if not _is_progress(one)]
    if len(found) == 1 and not _is_line(found[0]):
        return found[0] if isinstance(found[0], dict | list) else None
    return {"line": kept} if found and all(isinstance(one, dict) for one in found) else None


def _is_line(value: Any) -> bool:
    """Tell whether a JSON value is a line of a command's --json, beside which progress may stand or not."""
    return isinstance(value, dict) and value.get("kind") in ("progress", "result")


def _is_progress(value: Any) -> bool:
    return isinstance(value, dict) and value.get("kind") == "progress"


def _lines(name: str, a: Sequence[str], b: Sequence[str]) -> Found:
    for kind, i1, i2, j1, j2 in _blocks(a, b):
        for k in range(max(i2 - i1, j2 - j1) if kind != "equal" else 0):
            field, one, other = f"line[{i1 + k + 1}]", _at(a, i1 + k, i2), _at(b, j1 + k, j2)
            if not _near_text(name, field, one, other):
                yield field, *_parted(one, other)


def _blocks(a: Sequence[str], b: Sequence[str]) -> Iterator[tuple[str, int, int, int, int]]:
    """Return which lines stand against which: one against one where there are as many, else by the best match."""
    if len(a) == len(b):
        return iter([("replace", k, k + 1, k, k + 1) for k in range(len(a)) if a[k] != b[k]])
    return iter(difflib.SequenceMatcher(None, a, b, autojunk=False).get_opcodes())


def _at(lines: Sequence[str], k: int, end: int) -> str:
    return lines[k] if k < end else "missing"


def _parted(a: str, b: str) -> tuple[str, str]:
    """Return two long texts from shortly before they part."""
    part = next((k for k, (one, other) in enumerate(zip(a, b, strict=False)) if one != other), 0)
    start = max(0, part - _WIDTH // 4) if max(len(a), len(b)) > _WIDTH else 0
    return a[start : start + _WIDTH], b[start : start + _WIDTH]


def _bytes(a: bytes, b: bytes) -> tuple[str, str]:
    """Return the length of both and what they have where they first part."""
    shortest = min(len(a), len(b))
    differ = np.frombuffer(a[:shortest], np.uint8) != np.frombuffer(b[:shortest], np.uint8)
    at = int(differ.argmax()) if differ.any() else shortest
    many = int(differ.sum()) + abs(len(a) - len(b))
    texts = [f"{len(one)} bytes, at {at}: {one[at : at + 16].hex(' ')} ({many} differ)" for one in (a, b)]
    return texts[0], texts[1]


def _masked(name: str, content: bytes) -> bytes:
    for files, begin, end, _ in MASKED:
        if fnmatch(name, files):
            content = content[:begin] + bytes(len(content[begin:end])) + content[end:]
    return content


def _archives(name: str, a: bytes, b: bytes, homes: Homes) -> Found:
    """Compare two zip files (compensations, arrays) member by member."""
    first, second = ({one: file.read(one) for one in file.namelist()} for file in map(_zip, (a, b)))
    if list(first) != list(second):
        yield "members", str(list(first)), str(list(second))
    for member in first.keys() & second.keys():
        if member.endswith(".npy"):
            yield from _arrays(member, *(np.load(BytesIO(archive[member])) for archive in (first, second)))
        else:
            for field, left, right in _contents(f"{name}/{member}", first[member], second[member], homes):
                yield f"{member} {field}", left, right


def _zip(content: bytes) -> zipfile.ZipFile:
    return zipfile.ZipFile(BytesIO(content))


def _arrays(field: str, a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> Found:
    if (a.dtype, a.shape) != (b.dtype, b.shape):
        yield field, f"{a.dtype} {a.shape}", f"{b.dtype} {b.shape}"
    elif a.tobytes() != b.tobytes():
        wrong = np.flatnonzero((a != b) & ~((a != a) & (b != b)))
        at = int(wrong[0]) if wrong.size else 0
        where = f"at {at} ({wrong.size} of {a.size} differ)"
        yield field, f"{a.flat[at]!r} {where}", f"{b.flat[at]!r} {where}"


def _tables(name: str, a: bytes, b: bytes) -> Found:
    """Compare two Parquet files by what is in them, then their bytes."""
    first, second = (pq.read_table(BytesIO(content)) for content in (a, b))
    if first.schema.names != second.schema.names:
        yield "columns", str(first.schema.names), str(second.schema.names)
    if not first.schema.equals(second.schema, check_metadata=True):
        yield "schema", *_parted(first.schema.to_string(), second.schema.to_string())
    if first.num_rows != second.num_rows:
        yield "rows", str(first.num_rows), str(second.num_rows)
        return
    for column in (column for column in first.schema.names if column in second.schema.names):
        yield from _columns(name, column, first[column], second[column])
    if first.equals(second, check_metadata=True):
        yield "bytes", *_bytes(a, b)


def _columns(name: str, column: str, a: pa.ChunkedArray, b: pa.ChunkedArray) -> Found:
    if a.equals(b):
        return
    pairs = list(zip(a.to_pylist(), b.to_pylist(), strict=True))
    field = f"column {column}"
    wrong = [k for k, (one, other) in enumerate(pairs) if repr(one) != repr(other)]
    wrong = [k for k in wrong if not _near_text(name, field, str(pairs[k][0]), str(pairs[k][1]))]
    if wrong:
        where = f"in row {wrong[0]} ({len(wrong)} of {len(a)} differ)"
        one, other = pairs[wrong[0]]
        yield field, f"{one!r} {where}", f"{other!r} {where}"


def _measurement_files(path: str, a: bytes, b: bytes, homes: Homes) -> Found:
    """Compare two MDF4 files by what is in them: their blocks have times of the host all over them."""
    mdf = importlib.import_module("asammdf").MDF
    files = [mdf(BytesIO(content)) for content in (a, b)]
    held = [
        [(one.file_name, bytes(file.extract_attachment(k)[0])) for k, one in enumerate(file.attachments)]
        for file in files
    ]
    for (name, one), (_, other) in zip(held[0], held[1], strict=True):
        for field, left, right in _contents(f"{path}/{name}", one, other, homes):
            yield f"{name} {field}", left, right
    names = [[[channel.name for channel in group.channels] for group in file.groups] for file in files]
    if names[0] != names[1]:
        yield "channels", *_parted(str(names[0]), str(names[1]))
        return
    for group, channels in enumerate(names[0]):
        for index, channel in enumerate(channels):
            signals = [file.get(group=group, index=index) for file in files]
            for what in ("samples", "timestamps"):
                yield from _arrays(f"{channel} {what}", *(np.asarray(getattr(one, what)) for one in signals))
            if signals[0].unit != signals[1].unit:
                yield f"{channel} unit", signals[0].unit, signals[1].unit


def _values(file: str, field: str, a: Any, b: Any, homes: Homes) -> Found:
    """Compare two JSON values by key; entries of a list that have names are fields by them."""
    if _skipped(file, field):
        return
    if isinstance(a, dict) and isinstance(b, dict):
        a, b = _plain_keys(a, homes[0]), _plain_keys(b, homes[1])
        if list(a) != list(b) and set(a) == set(b):
            yield f"{field}.order", str(list(a)), str(list(b))
        for key in (*a, *(key for key in b if key not in a)):
            inner = f"{field}.{key}" if field else key
            yield from _values(file, inner, a.get(key, _MISSING), b.get(key, _MISSING), homes)
    elif isinstance(a, list) and isinstance(b, list):
        yield from _entries(file, field, a, b, homes)
    elif isinstance(a, str) and isinstance(b, str):
        texts = (_plain(a, homes[0]), _plain(b, homes[1]))
        if texts[0] != texts[1]:
            yield field, *_parted(*texts)
    elif not _same(a, b) and not _near(file, field, a, b):
        yield field, _told(a), _told(b)


def _plain_keys(pairs: Mapping[str, Any], home: str) -> dict[str, Any]:
    """Return a JSON object by its keys without what TEXTS allows to differ; those then the same get numbers."""
    found: dict[str, Any] = {}
    for key, value in pairs.items():
        plain, number = _plain(key, home), 2
        while plain in found:
            plain, number = f"{_plain(key, home)} {number}", number + 1
        found[plain] = value
    return found


class _Missing:
    def __repr__(self) -> str:
        return "missing"


_MISSING = _Missing()


def _told(value: Any) -> str:
    return repr(value)[:_WIDTH]


def _entries(file: str, field: str, a: Sequence[Any], b: Sequence[Any], homes: Homes) -> Found:
    if len(a) != len(b):
        yield f"{field}.length", str(len(a)), str(len(b))
    for k, (one, other) in enumerate(zip(a, b, strict=False)):
        yield from _values(file, _entry(field, k, one), one, other, homes)


def _entry(field: str, k: int, value: Any) -> str:
    """Return the field of a list's entry: [k], and what kind or name the entry has."""
    if isinstance(value, dict):
        said = [str(value[key]) for key in ("kind", "name") if isinstance(value.get(key), str)]
        if said:
            return f"{field}[{k}] {' '.join(said)}"
    return f"{field}[{k}]"


def _same(a: Any, b: Any) -> bool:
    """Tell whether two JSON scalars are the same; 1 and 1.0 are not, two NaN are."""
    if type(a) is not type(b):
        return False
    return bool(a == b) or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


def _general(field: str) -> str:
    return re.sub(r"\[\d+\]", "[]", field)


def _skipped(file: str, field: str) -> bool:
    return any(fnmatch(file, files) and re.fullmatch(fields, _general(field)) for files, fields, _ in FIELDS)


def _near(file: str, field: str, a: Any, b: Any) -> bool:
    """Tell whether two numbers are as near as LOOSE allows."""
    if type(a) is not type(b) or not isinstance(a, int | float) or isinstance(a, bool):
        return False
    return any(
        fnmatch(file, files)
        and re.fullmatch(fields, _general(field)) is not None
        and math.isclose(a, b, rel_tol=relative, abs_tol=absolute)
        for files, fields, relative, absolute, _ in LOOSE
    )


def _near_text(file: str, field: str, a: str, b: str) -> bool:
    """Tell whether two texts are the same but for numbers that are as near as LOOSE allows."""
    parts = [_NUMBER.split(text) for text in (a, b)]
    if parts[0][::2] != parts[1][::2]:
        return False
    pairs = zip(parts[0][1::2], parts[1][1::2], strict=True)
    return all(one == other or _near(file, field, float(one), float(other)) for one, other in pairs)
