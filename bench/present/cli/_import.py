"""`gyrobench import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from bench.present.cli._options import DEFAULT_RUNS, Json

app = Typer()


@app.command("import")
def import_(
    log: Annotated[
        list[Path], Argument(help="logs of another bench: text, Parquet, MAT, NPY, NPZ, HDF5 or MDF")
    ],
    mapping: Annotated[Path, Option(help="mapping file (TOML): columns, units, phases")],
    out: Annotated[Path, Option(help="folder that holds the runs")] = DEFAULT_RUNS,
    as_json: Json = False,
) -> None:
    """Make run folders from logs of another bench.

    Fits, reports and the gap diagnosis read them like any other run.
    """
    from bench.present.cli._console import Terminal
    from bench.record.exchange import import_log

    console, folders = Terminal(as_json=as_json), []
    for path in log:
        with console.status(f"reading {path.name}"):
            folders.append(import_log(path, mapping, out))
        console.say(f"{folders[-1]}")
    console.say_json("result", folders=folders)
