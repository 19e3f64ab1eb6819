"""Runs on object storage (`s3://bucket/runs/name` and whatever else fsspec opens), read through a local cache.

A closed run does not change: its manifest, fetched anew each time, says by checksum which files of the cache are
still good. Tables stay where they are and are read by ranges.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.record.recording._journal import RAW_FOLDER
from bench.record.recording._manifest import checksum, read_manifest
from bench.record.run_folder import MANIFEST_FILE, url_of
from drivers.base.errors import BenchError, RecordError

CACHE_VARIABLE = "GYROBENCH_CACHE"
_MIRROR = ".mirror.json"


def local_run(place: Path | str, *, everything: bool = False) -> Path:
    """Return the folder of a run on this machine: `place` itself, or for a URL its copy in the cache.

    The copy has the small files; `everything` fetches all anew, raw bytes and tables too. RecordError if
    the storage does not answer or has no run there.
    """
    url = url_of(place)
    if not url:
        _check_kinds(Path(place))
        return Path(place)
    parent, _, name = url.rpartition("/")
    folder = _cache(parent) / name
    with _storage(url) as (storage, root):
        sizes = {path[len(root) + 1 :]: size for path, size in storage.du(root, total=False).items()}
        if MANIFEST_FILE in sizes:
            folder.mkdir(parents=True, exist_ok=True)
            before = _bytes(folder / MANIFEST_FILE)
            _fetch(storage, f"{root}/{MANIFEST_FILE}", folder / MANIFEST_FILE)
            same = before == _bytes(folder / MANIFEST_FILE)
            sealed = read_manifest(folder).files
            for relative, size in sizes.items():
                path = folder / relative
                large = relative.endswith(".parquet") or relative.startswith("raw/")
                if relative == MANIFEST_FILE or (large and not everything):
                    continue
                if not path.resolve().is_relative_to(folder.resolve()):
                    raise RecordError("a file lies outside of its run", where=url, found=relative)
                if not everything and path.is_file() and path.stat().st_size == size:
                    if relative in sealed and checksum(path) == sealed[relative]:
                        continue
                    if relative not in sealed and same and sealed:
                        continue
                path.parent.mkdir(parents=True, exist_ok=True)
                _fetch(storage, f"{root}/{relative}", path)
            return folder
    raise RecordError(
        "this is not a run folder",
        where=url,
        found="no manifest.json" if sizes else "nothing",
        expected="a folder with manifest.json, events.jsonl and raw/",
        remedy=f"`gyrobench runs list {parent}` lists the runs there are",
    )


def _check_kinds(folder: Path) -> None:
    """Refuse a run with a pipe or a device in it (a link to one, too): reading it would never end."""
    try:
        paths = [*folder.glob("*"), *(folder / RAW_FOLDER).glob("*")]
    except OSError as error:
        raise RecordError(
            "the run folder cannot be read", where=str(folder), found=error.strerror or str(error)
        ) from error
    for path in paths:
        mode = stat.S_IFREG
        with contextlib.suppress(
            OSError
        ):  # a link to nothing: whoever needs the file says that it is missing
            mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise RecordError(
                "a run folder holds files only",
                where=str(path),
                found="a pipe, a device or a link to one",
                expected="regular files, or links to them",
                remedy="nothing of gyrobench makes such a folder: do not trust it",
            )


def local_manifests(place: Path) -> Path:
    """Return a folder with the manifests of a folder of runs: `place`, or for a URL the copy, as of now."""
    url = url_of(place)
    if not url:
        return place
    folder = _cache(url)
    folder.mkdir(parents=True, exist_ok=True)
    known = json.loads(_bytes(folder / _MIRROR) or b"{}")
    with _storage(url) as (storage, root):
        found = storage.glob(f"{root}/*/{MANIFEST_FILE}", detail=True)
        states = {path.split("/")[-2]: _state(entry) for path, entry in found.items()}
        wanted = [name for name, state in states.items() if known.get(name) != state]
        for name in wanted:
            (folder / name).mkdir(exist_ok=True)
        if wanted:
            storage.get(
                [f"{root}/{name}/{MANIFEST_FILE}" for name in wanted],
                [str(folder / name / MANIFEST_FILE) for name in wanted],
            )
    for name in known.keys() - states.keys():
        (folder / name / MANIFEST_FILE).unlink(missing_ok=True)
    if states != known:
        (folder / _MIRROR).write_text(json.dumps(states), encoding="utf-8")
    return folder


@contextlib.contextmanager
def remote_file(url: str) -> Iterator[Any]:
    """Open a file of the storage for reading by ranges."""
    with _storage(url) as (storage, path), storage.open(path, "rb") as file:
        yield file


def fetch_file(url: str, name: str, path: Path) -> None:
    """Copy a file of the run at `url` to `path`; RecordError if it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _storage(url) as (storage, root):
        _fetch(storage, f"{root}/{name}", path)


@contextlib.contextmanager
def _storage(url: str) -> Iterator[tuple[Any, str]]:
    """Give the file system and the path of `url`; what it answers instead of data becomes a RecordError."""
    import fsspec

    try:
        storage, path = fsspec.url_to_fs(url)
        storage.invalidate_cache()
        yield storage, path
    except BenchError:
        raise
    except FileNotFoundError as error:
        raise RecordError("there is no such place", where=url, found=str(error)) from error
    except Exception as error:  # every storage has errors of its own
        raise RecordError(
            "the storage cannot be read",
            where=url,
            found=f"{type(error).__name__}: {error}",
            remedy="check address and credentials; s3:// needs pip install 'gyrobench[scale]'",
        ) from error


def _fetch(storage: Any, source: str, path: Path) -> None:
    part = path.with_name(path.name + ".part")
    storage.get_file(source, str(part))
    part.replace(path)


def _bytes(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


def _state(entry: dict[str, Any]) -> str:
    """Return what changes when a file does, whatever the storage calls it."""
    return ", ".join(str(entry.get(key)) for key in ("size", "ETag", "mtime", "LastModified", "created"))


def _cache(url: str) -> Path:
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    root = Path(os.environ.get(CACHE_VARIABLE) or Path(caches) / "gyrobench")
    return root / "runs" / hashlib.sha256(url.encode()).hexdigest()[:20]
