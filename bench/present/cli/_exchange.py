"""`gyrobench runs export` and `gyrobench import`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.present.cli._console import Terminal
from bench.present.cli._texts import size
from bench.record.exchange import export_run, import_log


def export_command(run: Path, kind: str, out: Path | None) -> None:
    """Export a run and say where it is."""
    console = Terminal()
    with console.status(f"writing {kind}"):
        target = export_run(run, kind, out)
    files = [target] if target.is_file() else sorted(target.iterdir())
    total = sum(path.stat().st_size for path in files)
    console.print(f"{target}: {len(files)} files, {size(total)}", highlight=False)


def import_command(logs: Sequence[Path], mapping: Path, runs: Path) -> None:
    """Import logs one by one; the first that cannot be used ends it, those before it stay."""
    console = Terminal()
    for log in logs:
        with console.status(f"reading {log.name}"):
            folder = import_log(log, mapping, runs)
        console.print(f"{folder}", highlight=False)
