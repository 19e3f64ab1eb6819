"""The commands `gyrobench campaign ...`: what is planned, and what is run or rehearsed."""

from typer import Typer

from bench.present.cli.campaign._plan import plan
from bench.present.cli.campaign._run import rehearse, resume, run, status

app = Typer(name="campaign", no_args_is_help=True)
for command in (plan, run, resume, status, rehearse):
    app.command()(command)
