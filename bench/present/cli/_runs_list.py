"""`gyrobench runs list` and `index`: they load little, since a list is mostly the start of a process."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from bench.present.cli._texts import duration, printable
from bench.record.catalogue import Catalogue, CatalogueRow, root_name
from bench.record.run_folder import url_of
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

OUTCOMES = ("completed", "invalid", "aborted", "running", "unreadable")
STYLES = {"completed": "green", "invalid": "yellow", "aborted": "red", "running": "cyan"}
_MANY = 2000


def list_command(
    runs: Path, url: str | None, wanted: Mapping[str, str | None], limit: str, as_json: bool
) -> None:
    """Print the runs that fit, newest first: those of `runs`, or those of every bench with a shared catalogue."""
    if not limit.isdecimal() or int(limit) < 1:
        raise ConfigurationError("no number of runs", where="--limit", found=limit, expected="1 or more")
    if wanted["outcome"] is not None and wanted["outcome"] not in OUTCOMES:
        raise ConfigurationError(
            "no outcome of a run", where="--outcome", found=wanted["outcome"], expected=", ".join(OUTCOMES)
        )
    runs = _here(runs)
    rows: list[CatalogueRow] = []
    count = 0
    if url is not None or runs.exists():
        with _catalogue(runs, url) as catalogue:
            if runs.exists():
                _take_in(catalogue.update, runs)
            rows, count = catalogue.find(
                root=root_name(runs) if url is None else None, **wanted, limit=int(limit)
            )
    if as_json:
        typer.echo(json.dumps([asdict(row) for row in rows], ensure_ascii=False))
    elif rows:
        _print_table(rows)
        if count > len(rows):
            typer.echo(f"the newest {len(rows)} of {count}; --limit shows more")
    elif any(wanted.values()):
        typer.echo("no runs that fit")
    else:
        typer.echo(f"no runs in {runs}")


def index_command(runs: Path, url: str | None, rebuild: bool) -> None:
    """Bring the catalogue up to date with the folders, or make it anew from them."""
    runs = _here(runs)
    with _catalogue(runs, url) as catalogue:
        count = _take_in(catalogue.rebuild if rebuild else catalogue.update, runs)
    typer.echo(f"{count} manifests read in {runs}")


def _print_table(rows: Sequence[CatalogueRow]) -> None:
    """Print in columns; names are never cut, since one that is cannot be copied."""
    several = len({row.root for row in rows}) > 1
    benches = ["bench", *(row.bench or row.root for row in rows)]
    cells = [("run", "procedure", "units", "bench time", "started (UTC)", "outcome")]
    for row in rows:
        length = "-" if row.duration_s is None else duration(row.duration_s)
        started = f"{datetime.fromtimestamp(row.started_s, UTC):%Y-%m-%d %H:%M}" if row.started_s else "-"
        outcome = f"unreadable: {row.reason}" if row.outcome == "unreadable" else row.outcome
        units = ", ".join(row.units) or "-"
        cells.append((row.name, row.procedure or "-", units, length, started, outcome))
    lines = [[printable(cell) for cell in line] for line in cells]
    if several:
        lines = [[printable(bench), *line] for bench, line in zip(benches, lines, strict=True)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    colours = [None, *(STYLES.get(row.outcome, "red") for row in rows)]
    for line, colour in zip(lines, colours, strict=True):
        padded = [cell.ljust(width) for cell, width in zip(line[:-1], widths[:-1], strict=True)]
        typer.echo("  ".join([*padded, typer.style(line[-1], fg=colour)]))


def _here(runs: Path) -> Path:
    """Return where the manifests are on this machine."""
    if not url_of(runs):
        return runs
    from bench.record.recording import local_manifests

    return local_manifests(runs)


def _catalogue(runs: Path, url: str | None) -> Catalogue:
    return Catalogue.beside(runs) if url is None else Catalogue(url)


def _take_in(take: Callable[[Path, Callable[[int, int], None] | None], int], runs: Path) -> int:
    """Update or rebuild, with a bar once there is much to read."""
    with ExitStack() as stack:
        bars: list[tuple[Progress, TaskID]] = []

        def show(done: int, total: int) -> None:
            if total > _MANY and not bars:
                from rich.progress import Progress

                bar = stack.enter_context(Progress(transient=True))
                bars.append((bar, bar.add_task("reading run folders", total=total)))
            for bar, task in bars:
                bar.update(task, completed=done)

        return take(runs, show)
