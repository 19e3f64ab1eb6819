"""The commands `gyrobench campaign ...`: a file for what is planned, what is run, what is rehearsed."""

import typer

from bench.present.cli.campaign._plan import plan
from bench.present.cli.campaign._rehearse import rehearse
from bench.present.cli.campaign._run import resume, run, status

app = typer.Typer(
    name="campaign",
    help="Many runs from one file: plan, run, resume, watch, rehearse, fit.",
    no_args_is_help=True,
)
for command in (plan, run, resume, status, rehearse):
    app.command()(command)
