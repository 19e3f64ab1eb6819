"""`gyrobench runs`: list, index, show, verify."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TaskID
from rich.table import Table
from rich.text import Text

from bench.catalogue import Catalogue, root_name
from bench.cli._display import duration
from bench.recording import MANIFEST_FILE, Run, local_manifests, read_manifest, verify
from bench.recover import recover
from bench.run_record import decode_run
from drivers.errors import BenchError

_STYLES = {"completed": "green", "invalid": "yellow", "aborted": "red", "running": "cyan"}
_MANY = 2000


def list_command(runs: Path, url: str | None, wanted: Mapping[str, Any], as_json: bool) -> None:
    """Print the runs that fit, newest first: those of `runs`, or those of every bench with a shared catalogue."""
    console = Console()
    runs = local_manifests(runs)
    if url is None and not runs.exists():
        console.print(f"no runs in {runs}", highlight=False)
        return
    with _catalogue(runs, url) as catalogue:
        if runs.exists():
            _take_in(console, catalogue.update, runs)
        rows, count = catalogue.find(root=root_name(runs) if url is None else None, **wanted)
    if as_json:
        sys.stdout.write(json.dumps([asdict(row) for row in rows], ensure_ascii=False) + "\n")
        return
    if not rows:
        console.print(
            "no runs that fit"
            if any(value for name, value in wanted.items() if name != "limit")
            else f"no runs in {runs}",
            highlight=False,
        )
        return
    table = Table("run", "procedure", "units", "outcome", "bench time", "started (UTC)")
    for row in rows:
        style = _STYLES.get(row.outcome, "red")
        outcome = f"unreadable: {row.reason}" if row.outcome == "unreadable" else row.outcome
        table.add_row(
            row.name,
            row.procedure or "-",
            ", ".join(row.units) or "-",
            Text(outcome, style),
            "-" if row.duration_s is None else duration(row.duration_s),
            _utc(row.started_s) if row.started_s else "-",
        )
    console.print(table)
    if count > len(rows):
        console.print(f"the newest {len(rows)} of {count}; --limit shows more", highlight=False)


def index_command(runs: Path, url: str | None, rebuild: bool) -> None:
    """Bring the catalogue up to date with the folders, or make it anew from them."""
    console = Console()
    runs = local_manifests(runs)
    with _catalogue(runs, url) as catalogue:
        count = _take_in(console, catalogue.rebuild if rebuild else catalogue.update, runs)
    console.print(f"{count} manifests read in {runs}", highlight=False)


def _catalogue(runs: Path, url: str | None) -> Catalogue:
    return Catalogue.beside(runs) if url is None else Catalogue(url)


def _take_in(
    console: Console, take: Callable[[Path, Callable[[int, int], None] | None], int], runs: Path
) -> int:
    """Update or rebuild, with a bar once there is much to read."""
    with Progress(console=console, transient=True) as progress:
        tasks: list[TaskID] = []

        def show(done: int, total: int) -> None:
            if total > _MANY and not tasks:
                tasks.append(progress.add_task("reading run folders", total=total))
            if tasks:
                progress.update(tasks[0], completed=done)

        return take(runs, show)


def _utc(epoch_s: float) -> str:
    return f"{datetime.fromtimestamp(epoch_s, UTC):%Y-%m-%dT%H:%M:%S}"


def show_command(folder: Path) -> None:
    """Print a run's parameters, devices, measurements and streams."""
    console = Console()
    run = Run.open(folder)
    found = run.manifest
    style = _STYLES[found.outcome]
    console.print(
        f"[bold]{found.run_id}[/bold]  [{style}]{found.outcome}[/{style}]  {found.reason}", highlight=False
    )
    length = "not closed" if found.duration_s is None else duration(found.duration_s)
    console.print(f"{found.procedure}, started {found.started_utc}, bench time {length}", highlight=False)
    console.print(
        "parameters: " + ", ".join(f"{k}={v}" for k, v in found.parameters.items()), highlight=False
    )
    devices = Table("device", "kind", "maker", "model", "serial number", "firmware")
    for name, device in found.devices.items():
        devices.add_row(name, device.kind, device.maker, device.model, device.serial_number, device.firmware)
    console.print(devices)
    if found.measurements:
        measured = Table("measurement", "value", "unit", "low", "high", "passed")
        for row in found.measurements:
            low, high = ("-" if row[key] is None else f"{row[key]:g}" for key in ("low", "high"))
            measured.add_row(row["name"], f"{row['value']:.6g}", row["unit"], low, high, str(row["passed"]))
        console.print(measured)
    streams = Table("gyro", "frames", "lost", "rejected", "sample rate Hz", "clock error ppm")
    for name, stream in found.stream.items():
        rejected = sum((stream.get("rejected") or {}).values())
        rate, error = stream.get("sample_rate_hz"), stream.get("clock_error_ppm")
        streams.add_row(
            name,
            str(stream.get("frames", "-")),
            str(stream.get("lost", "-")),
            str(rejected),
            "-" if rate is None else f"{rate:.6f}",
            "-" if error is None else f"{error:+.2f}",
        )
    console.print(streams)


def recover_command(folders: Sequence[Path], root: Path | None) -> int:
    """Recover runs, with `root` every open one below it; 0 when all could be, 1 otherwise."""
    console = Console()
    found = list(folders)
    if root is not None:
        found += [path.parent for path in sorted(root.glob(f"*/{MANIFEST_FILE}")) if _is_open(path.parent)]
    if not found:
        console.print("no run to recover")
    failed = False
    for folder in found:
        try:
            manifest = recover(folder)
        except BenchError as error:
            failed = True
            console.print(f"not recovered  {folder}: {error}", style="red", highlight=False, markup=False)
        else:
            console.print(f"{manifest.outcome}  {folder}: {manifest.reason}", highlight=False, markup=False)
    return 1 if failed else 0


def _is_open(folder: Path) -> bool:
    """Return whether a run was not closed; one that cannot be read is, and `recover` says why it cannot."""
    try:
        return not read_manifest(folder).complete
    except BenchError:
        return True


def verify_command(folders: Sequence[Path]) -> int:
    """Verify runs; 0 when nothing differs, 1 otherwise."""
    console = Console()
    failed = False
    for folder in folders:
        report = verify(folder, decode_run)
        if report.passed:
            console.print(
                f"[green]verified[/green]  {folder}: {report.files} checksums, {report.tables} tables rebuilt"
            )
            continue
        failed = True
        console.print(f"[red]differs[/red]  {folder}", highlight=False)
        for problem in report.problems:
            console.print(f"  {problem.path}: {problem.text}", highlight=False, markup=False)
    return 1 if failed else 0
