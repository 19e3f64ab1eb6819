"""Sealed run folders are changed at random: `verify` finds each change, or `Run` still reads the same.

Run as `python -m benchmarks.tamper [FOLDERS] [SEED]`; writes its section of benchmarks/reliability.md. A copy of
a run (`_sealed_runs.py`) has one thing changed: bits, lengths, lines and pieces of a file, a value in its JSON,
or a file that is taken away, added, or changes places with another. A change is found if `verify` names a file or
refuses the folder in words. It is harmless if it is not found and everything that can be read through `Run` is
equal bit for bit: manifest, seal, events, tables, truth, and the bytes and times of every port. Anything else is
missed.
"""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.control.run_record import decode_run
from bench.record.recording import EmulatedLab, Run, read_manifest, read_marks, seal, verify
from bench.record.signing import PublicKey, SigningKey
from benchmarks._sealed_runs import sealed_runs
from benchmarks._sections import write_section
from drivers.base.errors import BenchError

FOUND, HARMLESS, MISSED = "found", "harmless", "missed"
_TEXTS = (".json", ".jsonl", ".csv", ".toml", ".py")
_ADDED = (
    "raw/{}.bin", "raw/{}.idx", "raw/{}.sent.bin", "gyro_{}.parquet", "turntable_{}.parquet", "truth_{}.npz",
    "pictures/{}.png", "watchdog/{}.jsonl", "watchdog/raw/{}.bin", "{}.txt", "notes/{}.txt", "procedure.py",
)  # fmt: skip
"""Names of files that a run might have; what is added has the content of one that it has."""


@dataclass
class Tally:
    """What became of the changes of a kind."""

    tried: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    missed: list[str] = field(default_factory=list)
    harmless_in: Counter[str] = field(default_factory=Counter)
    """By the place of the changed file: a folder of the run, or its name."""


@dataclass(frozen=True)
class Copy:
    """A copy of a run to be changed, another sealed run that was left whole, and what decides."""

    folder: Path
    other: Path
    draw: random.Random

    def file(self, *suffixes: str, least: int = 1) -> Path:
        """Return one of the files with at least so many bytes, of these suffixes if any are given."""
        known = [
            path
            for path in sorted(self.folder.rglob("*"))
            if path.is_file() and path.stat().st_size >= least and (not suffixes or path.suffix in suffixes)
        ]
        return self.draw.choice(known)

    def named(self, path: Path) -> str:
        """Return the name of a file in the run."""
        return path.relative_to(self.folder).as_posix()


def _bits(copy: Copy) -> str:
    return _flip(copy, copy.file(), copy.draw.choice((1, 1, 1, 2, 8)))


def _flip(copy: Copy, path: Path, count: int) -> str:
    data = bytearray(path.read_bytes())
    flipped = [copy.draw.randrange(8 * len(data)) for _ in range(count)]
    for at in set(flipped):
        data[at // 8] ^= 1 << at % 8
    path.write_bytes(data)
    return f"{copy.named(path)}: bits {sorted(set(flipped))}"


def _shorter(copy: Copy) -> str:
    path = copy.file()
    size = path.stat().st_size
    kept = copy.draw.choice((0, size - 1, copy.draw.randrange(size)))
    path.write_bytes(path.read_bytes()[:kept])
    return f"{copy.named(path)}: {kept} of {size} bytes"


def _longer(copy: Copy) -> str:
    path = copy.file()
    more = copy.draw.choice((b"\0", b"\n", b" ", copy.draw.randbytes(copy.draw.randint(1, 400))))
    path.write_bytes(path.read_bytes() + more)
    return f"{copy.named(path)}: {len(more)} bytes more"


def _pieces(copy: Copy, path: Path) -> list[bytes]:
    """Return a file in lines, one without them in pieces of 16 bytes or of random lengths."""
    data = path.read_bytes()
    if path.suffix in _TEXTS:
        return data.splitlines(keepends=True)
    size = 16 if copy.draw.random() < 0.5 else copy.draw.randint(1, max(1, len(data) // 3))
    return [data[at : at + size] for at in range(0, len(data), size)]


def _dropped(copy: Copy) -> str:
    path = copy.file()
    pieces = _pieces(copy, path)
    at = copy.draw.randrange(len(pieces))
    path.write_bytes(b"".join(pieces[:at] + pieces[at + 1 :]))
    return f"{copy.named(path)}: piece {at} of {len(pieces)} dropped"


def _doubled(copy: Copy) -> str:
    path = copy.file()
    pieces = _pieces(copy, path)
    at = copy.draw.randrange(len(pieces))
    path.write_bytes(b"".join([*pieces[:at], pieces[at], *pieces[at:]]))
    return f"{copy.named(path)}: piece {at} of {len(pieces)} twice"


def _reordered(copy: Copy) -> str:
    path = copy.file(least=32)
    pieces = _pieces(copy, path)
    one, two = copy.draw.randrange(len(pieces)), copy.draw.randrange(len(pieces))
    pieces[one], pieces[two] = pieces[two], pieces[one]
    path.write_bytes(b"".join(pieces))
    return f"{copy.named(path)}: pieces {one} and {two} of {len(pieces)} change places"


def _leaves(value: Any, into: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Return every (container, key) in JSON at which something stands that is no container itself."""
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        inner = value[key]
        if isinstance(inner, dict | list) and inner:
            _leaves(inner, into)
        else:
            into.append((value, key))
    return into


def _edit(copy: Copy, value: Any) -> str:
    container, key = copy.draw.choice(_leaves(value, []))
    old = container[key]
    if copy.draw.random() < 0.15:
        del container[key]
        return f"{key} taken out"
    if isinstance(old, bool):
        new: Any = not old
    elif isinstance(old, int | float):
        new = copy.draw.choice((0, -old, old + 1, old * 1.000001, None, 5.4))
    elif isinstance(old, str):
        new = copy.draw.choice(("", "completed", "aborted", old + " ", old[::-1], old.upper()))
    else:
        new = copy.draw.choice((1, "x", None, {}, []))
    container[key] = new
    return f"{key} {old!r} becomes {new!r}"


def _json_value(copy: Copy) -> str:
    path = copy.file(".json", ".jsonl")
    text = path.read_text("utf-8")
    if path.suffix == ".json":
        data = json.loads(text)
        done = _edit(copy, data)
        path.write_text(json.dumps(data, indent=2, ensure_ascii=False) + "\n", "utf-8")
        return f"{copy.named(path)}: {done}"
    lines = text.splitlines()
    at = copy.draw.randrange(len(lines))
    row = json.loads(lines[at])
    done = _edit(copy, row)
    lines[at] = json.dumps(row, ensure_ascii=False)
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return f"{copy.named(path)}: line {at}: {done}"


def _removed(copy: Copy) -> str:
    path = copy.file(least=0)
    path.unlink()
    return f"{copy.named(path)} taken away"


def _added(copy: Copy) -> str:
    gyro = copy.draw.choice(("x", *Run.open(copy.folder).gyros))
    path = copy.folder / copy.draw.choice(_ADDED).format(gyro)
    alike = [known for known in sorted(copy.other.rglob(f"*{path.suffix}")) if known.is_file()]
    content = copy.draw.choice(alike).read_bytes() if alike else copy.draw.randbytes(200)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return f"{copy.named(path)} put there"


def _swapped(copy: Copy) -> str:
    one, two = copy.file(least=0), copy.file(least=0)
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    return f"{copy.named(one)} and {copy.named(two)} change places"


def _of_another(copy: Copy) -> str:
    """Put a file of another sealed run in the place of one of the same name, or of the same kind."""
    path = copy.file(least=0)
    same = copy.other / copy.named(path)
    alike = [known for known in sorted(copy.other.rglob(f"*{path.suffix}")) if known.is_file()]
    path.write_bytes((same if same.is_file() else copy.draw.choice(alike or [path])).read_bytes())
    return f"{copy.named(path)} of another run"


def _forged(copy: Copy) -> str:
    """Have another unit, parameter or raw byte, and make tables, checksums and seal anew, without the key."""
    manifest = read_manifest(copy.folder)
    units = {name: copy.draw.choice(("F7", "G8", "H9")) for name in manifest.units}
    forged: dict[str, Any] = copy.draw.choice(
        (
            {"units": units},
            {"emulated": None if manifest.emulated else EmulatedLab(seed=1, model="x")},
            {"parameters": {"rate_dps": copy.draw.random()}},
            {"started_utc": "2025-01-01T08:00:00+00:00"},
            {},
        )
    )
    done = f"{', '.join(forged)} forged"
    if not forged:
        path = copy.draw.choice(sorted((copy.folder / "raw").iterdir()))
        done = _flip(copy, path, 8)
    with suppress(BenchError):  # bytes that cannot be decoded any more: then the tables tell, too
        decode_run(copy.folder)
    left = {"key": "", "seal": "", "measurements": manifest.measurements}
    seal(copy.folder, manifest.model_copy(update=left | forged), None)
    return f"{done}, sealed anew"


FORGED = "everything made anew, without the key"
KINDS: dict[str, Callable[[Copy], str]] = {
    "bits flipped": _bits,
    "cut": _shorter,
    "made longer": _longer,
    "a line or piece dropped": _dropped,
    "a line or piece twice": _doubled,
    "two lines or pieces reordered": _reordered,
    "a value of its JSON edited": _json_value,
    "a file taken away": _removed,
    "a file added": _added,
    "two files swapped": _swapped,
    "a file of another run": _of_another,
    FORGED: _forged,
}


def reading(folder: Path) -> str:
    """Return a checksum of everything that can be read of a run; BenchError if something cannot be read."""
    digest = hashlib.sha256()
    for part in _read(Run.open(folder)):
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def _read(run: Run) -> Iterator[bytes]:
    yield run.manifest.model_dump_json().encode()
    yield run.seal.encode()
    yield json.dumps([run.events, run.event_log.torn, run.phases()], default=str).encode()
    for name in run.tables:
        table = run.to_arrow(name)
        yield name.encode()
        yield from (
            f"{name} {column.dtype}".encode() + column.tobytes()
            for name, column in ((name, table[name].to_numpy()) for name in table.column_names)
        )
    for gyro in run.manifest.units:
        for name, values in sorted(run.truth(gyro).items()):
            yield f"{gyro} {name} {values.dtype} {values.shape}".encode() + values.tobytes()
    for path in sorted(run.file("raw").glob("*.bin")):
        yield path.name.encode() + path.read_bytes()
        yield read_marks(path).tobytes()


def judge(folder: Path, whole: str, signed_by: PublicKey | None = None) -> str:
    """Return what a changed run is: found, harmless (it reads as `whole`), or missed.

    `signed_by`: the key that it is asked to be signed by, as `runs verify --signed-by` does.
    """
    keys = [] if signed_by is None else [signed_by]
    try:
        if not verify(folder, decode_run, keys, must_be_signed=bool(keys)).passed:
            return FOUND
    except BenchError:
        return FOUND
    try:
        return HARMLESS if reading(folder) == whole else MISSED
    except BenchError:
        return MISSED


def _same(one: Path, two: Path) -> bool:
    def held(folder: Path) -> dict[Path, bytes]:
        return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    return held(one) == held(two)


def tamper(count: int, seed: int) -> dict[str, Tally]:
    """Change `count` copies of runs, drawn from `seed`; return what became of them, by kind of change."""
    draw, tallies = random.Random(seed), {kind: Tally() for kind in KINDS}
    with tempfile.TemporaryDirectory(prefix="gyrobench-tamper-") as root:
        key = SigningKey.new("the bench")
        runs = sealed_runs(Path(root), key)
        whole = {origin: reading(folder) for origin, folder in runs.items()}
        for origin, folder in runs.items():
            if judge(folder, "") != MISSED:  # one that does not verify before it is changed proves nothing
                raise RuntimeError(f"the {origin} run does not verify: {verify(folder, decode_run).problems}")
        kinds, origins = list(KINDS), list(runs)
        for number in range(count):
            kind, origin = kinds[number % len(kinds)], origins[number // len(kinds) % len(origins)]
            other = runs[draw.choice([name for name in origins if name != origin])]
            folder = Path(root) / "changed"
            shutil.copytree(runs[origin], folder)
            while (change := KINDS[kind](Copy(folder, other, draw))) and _same(folder, runs[origin]):
                pass  # two equal lines that changed places are no change
            tally = tallies[kind]
            tally.tried += 1
            try:
                verdict = judge(folder, whole[origin], key.public if kind == FORGED else None)
            except Exception:
                verdict = MISSED
                change += " TRACEBACK " + traceback.format_exc(limit=-2).replace("\n", " ")
            tally.verdicts[verdict] += 1
            if verdict == HARMLESS:
                place, _, inside = change.split(":")[0].split(" ")[0].partition("/")
                tally.harmless_in[f"{place}/" if inside else "a file that no run has"] += 1
            if verdict == MISSED:
                tally.missed.append(f"{origin} run, {change}")
            shutil.rmtree(folder)
    return tallies


def main() -> int:
    """Change folders and write the section; 1 if a change was missed."""
    count, seed = (*map(int, sys.argv[1:3]), *(1000, 1)[len(sys.argv) - 1 :])
    tallies = tamper(count, seed)
    total = sum((tally.verdicts for tally in tallies.values()), Counter[str]())
    missed = [f"{kind}: {text}" for kind, tally in tallies.items() for text in tally.missed]
    harmless = sum((tally.harmless_in for tally in tallies.values()), Counter[str]())
    places = ", ".join(f"{name} {count}" for name, count in harmless.most_common())
    verdicts = FOUND, HARMLESS, MISSED
    lines = [
        f"{total.total()} folders changed: {', '.join(f'{total[verdict]} {verdict}' for verdict in verdicts)}.",
        "Found: `verify` names the file, or refuses the folder in words. Harmless: not found, and everything",
        "that is read through `Run` is equal bit for bit (manifest, seal, events, tables, truth, bytes and times",
        f"of the ports). Where the harmless ones were: {places}. `live/`",
        "is what the panel shows while a run goes on, `notes/` what people add later: both lie outside the seal.",
        "One run was closed, one recovered, one imported; a key had signed them. In the last row somebody",
        "without it makes another unit, parameter or raw byte true in tables, checksums and seal: only",
        "`verify --signed-by` finds that ([decision 31](../docs/decisions/0031-guards-and-seals.md)).",
        "",
        f"| change | folders | {' | '.join(verdicts)} |",
        "|---|---|---|---|---|",
        *(
            f"| {kind} | {tally.tried} | {' | '.join(str(tally.verdicts[verdict]) for verdict in verdicts)} |"
            for kind, tally in tallies.items()
        ),
        "",
        *(f"- {text}" for text in missed[:20]),
    ]
    print(write_section("Tampered folders", f"python -m benchmarks.tamper {count} {seed}", lines))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
