"""`gyrobench import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from bench.present.cli._options import DEFAULT_RUNS

app = Typer()


@app.command("import")
def import_(
    log: Annotated[
        list[Path], Argument(help="logs of another bench: text, Parquet, MAT, NPY, NPZ, HDF5 or MDF")
    ],
    mapping: Annotated[Path, Option(help="mapping file (TOML): columns, units, phases")],
    out: Annotated[Path, Option(help="folder that holds the runs")] = DEFAULT_RUNS,
) -> None:
    """Make run folders from logs of another bench, for fitting, reports and the gap diagnosis."""
    from bench.present.cli._console import Terminal
    from bench.record.exchange import import_log

    console = Terminal()
    for path in log:
        with console.status(f"reading {path.name}"):
            folder = import_log(path, mapping, out)
        console.say(f"{folder}")
