"""The commands `gyrobench frames ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="frames",
    help="Gyros described by a TOML file: what there is, and whether a description is right.",
    no_args_is_help=True,
)


@app.command("list")
def frames_list() -> None:
    """List the descriptions that come with gyrobench."""
    from bench.present.cli._frame import frames_list_command

    frames_list_command()


@app.command("check")
def frames_check(
    description: Annotated[str, typer.Argument(help="a TOML file, or a name that `frames list` shows")],
    capture: Annotated[
        Path | None, typer.Argument(help="bytes of such a gyro, as recorded: raw/<gyro>.bin, or any file")
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for the tables and the plot of a capture")] = Path(),
    parquet: Annotated[bool, typer.Option("--parquet", help="tables as Parquet instead of CSV")] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", "-s", help="how the unit was set up, as name=choice; repeat for several"),
    ] = None,
) -> None:
    """Check a description, run its vectors, and decode a capture into tables and a plot."""
    from bench.present.cli._frame import frames_check_command
    from bench.present.cli._settings import parse_settings

    frames_check_command(description, capture, out, parquet, parse_settings(settings or []))
