"""The commands `gyrobench fit ...`: models over temperature, figures of a unit, effects of motion."""

from typer import Typer

from bench.present.cli.fit._motion import heading_effect, whirl
from bench.present.cli.fit._temperature import chamber_cycle, cold_shock, stepwise
from bench.present.cli.fit._unit import calibration, standard_test

app = Typer(name="fit", no_args_is_help=True)
for command in (cold_shock, stepwise, chamber_cycle, standard_test, whirl, heading_effect, calibration):
    app.command()(command)
