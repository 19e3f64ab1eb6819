"""The commands `gyrobench gap ...`: a file each, and one for what a diagnosis prints."""

import typer

from bench.present.cli.gap._close import close
from bench.present.cli.gap._diagnose import diagnose
from bench.present.cli.gap._exam import exam
from bench.present.cli.gap._rehearse import rehearse

app = typer.Typer(
    name="gap", help="Where simulation and bench part, and which effect is missing.", no_args_is_help=True
)
for command in (diagnose, close, rehearse, exam):
    app.command()(command)
