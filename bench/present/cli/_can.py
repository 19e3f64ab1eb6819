"""The commands `gyrobench can ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="can",
    help="Gyros on CAN: the layouts there are, and whether a DBC file and its mapping are right.",
    no_args_is_help=True,
)


@app.command("list")
def can_list() -> None:
    """List the layouts that come with gyrobench."""
    from bench.present.cli._can_check import can_list_command

    can_list_command()


@app.command("check")
def can_check(
    layout: Annotated[str, typer.Argument(help="a mapping file (TOML), or a name that `can list` shows")],
    capture: Annotated[
        Path | None,
        typer.Argument(help="a log of the bus (.log, .asc, .blf, .trc, .csv), or slcan text: raw/<gyro>.bin"),
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for the table and the plot of a capture")] = Path(),
    parquet: Annotated[bool, typer.Option("--parquet", help="the table as Parquet instead of CSV")] = False,
    source_address: Annotated[
        int | None, typer.Option(min=0, max=253, help="the J1939 address of the unit; default any")
    ] = None,
) -> None:
    """Check a mapping against its DBC file, and decode a capture into a table and a plot."""
    from bench.present.cli._can_check import can_check_command

    can_check_command(layout, capture, out, parquet, source_address)
