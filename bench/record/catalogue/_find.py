"""What is asked of a catalogue: the runs that fit, once it is up to date with the folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.record.catalogue._catalogue import Catalogue
from bench.record.catalogue._rows import CatalogueRow, root_name
from bench.record.run_folder import url_of

ReadProgress = Callable[[int, int], None]
"""Called with how many manifests have been read, and how many there are to read."""


def find_runs(
    runs: Path,
    url: str | None = None,
    *,
    limit: int = 100,
    progress: ReadProgress | None = None,
    **wanted: str | None,
) -> tuple[list[CatalogueRow], int]:
    """Return the newest `limit` runs that fit `wanted` (see `Catalogue.find`), and how many fit.

    Those of `runs`, whose catalogue lies beside them; with the `url` of a shared catalogue those of every bench.
    """
    local = _local(runs)
    if url is None and not local.exists():
        return [], 0
    with _open(local, url) as catalogue:
        if local.exists():
            catalogue.update(local, progress)
        return catalogue.find(root=root_name(local) if url is None else None, limit=limit, **wanted)


def index_runs(
    runs: Path, url: str | None = None, *, rebuild: bool = False, progress: ReadProgress | None = None
) -> int:
    """Bring the catalogue up to date with the folders, or make it anew; return how many manifests were read."""
    local = _local(runs)
    with _open(local, url) as catalogue:
        return (catalogue.rebuild if rebuild else catalogue.update)(local, progress)


def _local(runs: Path) -> Path:
    """Return where the manifests are on this machine."""
    if not url_of(runs):
        return runs
    from bench.record.recording import local_manifests

    return local_manifests(runs)


def _open(runs: Path, url: str | None) -> Catalogue:
    return Catalogue.beside(runs) if url is None else Catalogue(url)
