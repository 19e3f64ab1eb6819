"""The commands `gyrobench gap ...`, and what a diagnosis prints."""

from typer import Typer

from bench.present.cli.gap._batch import batch
from bench.present.cli.gap._check import check
from bench.present.cli.gap._diagnose import close, diagnose
from bench.present.cli.gap._effects import effects
from bench.present.cli.gap._exam import exam
from bench.present.cli.gap._foretell import foretell
from bench.present.cli.gap._hunt import hunt
from bench.present.cli.gap._rehearse import rehearse

app = Typer(name="gap", no_args_is_help=True)
for command in (effects, check, diagnose, batch, close, hunt, foretell, rehearse, exam):
    app.command()(command)
