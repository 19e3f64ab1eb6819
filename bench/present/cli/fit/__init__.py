"""The commands `gyrobench fit ...`: a file each."""

import typer

from bench.present.cli.fit._calibration import calibration
from bench.present.cli.fit._chamber_cycle import chamber_cycle
from bench.present.cli.fit._cold_shock import cold_shock
from bench.present.cli.fit._heading_effect import heading_effect
from bench.present.cli.fit._standard_test import standard_test
from bench.present.cli.fit._stepwise import stepwise
from bench.present.cli.fit._whirl import whirl

app = typer.Typer(name="fit", help="Fit compensations to recorded runs.", no_args_is_help=True)
for command in (cold_shock, stepwise, chamber_cycle, standard_test, whirl, heading_effect, calibration):
    app.command()(command)
