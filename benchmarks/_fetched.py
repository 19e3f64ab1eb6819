"""Files that others publish: fetched from where they stand, checked by their SHA-256, kept in a cache only."""

from __future__ import annotations

import hashlib
import urllib.request
from pathlib import Path

CACHE = Path("~/.cache/gyrobench/real_data").expanduser()


def fetched(place: str, sha256: str, cache: Path = CACHE) -> Path:
    """Return a file of `repo@commit:path` on GitHub; OSError if it cannot be had or is another one."""
    source, _, inside = place.partition(":")
    repo, _, commit = source.partition("@")
    file = cache / f"{sha256[:12]}-{Path(inside).name.replace(' ', '_')}"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        url = f"https://raw.githubusercontent.com/{repo}/{commit}/{inside}"
        with urllib.request.urlopen(url, timeout=30) as answer:
            file.write_bytes(answer.read())
    if hashlib.sha256(file.read_bytes()).hexdigest() != sha256:
        raise OSError(f"{file} is not the file that was looked at before: its SHA-256 differs")
    return file
