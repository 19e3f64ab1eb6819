"""The commands of `gyrobench`: a file or a package for each group, all of them in one table."""

from __future__ import annotations

import os
import sys
from typing import Any

import typer

from bench.present.cli import (
    _campaigns,
    _can,
    _fits,
    _frames,
    _gaps,
    _panel,
    _ports,
    _procedures,
    _report,
    _run,
    _runs,
    _steer,
)
from bench.present.cli._options import TextGroup
from drivers.base.errors import BenchError, RunAborted, RunUnsealed
from drivers.base.plugins import entry_points_of

ENTRY_POINTS = "gyrobench.commands"
"""Entry points of other packages: name of the command or group -> a `typer.Typer`."""


class Commands(TextGroup):
    """Our own commands, and those that installed packages bring. These are loaded when one of them is asked for,
    and for the list of commands.
    """

    def list_commands(self, context: Any) -> list[str]:
        """Return the names, ours first."""
        brought = (point.name for point in entry_points_of(ENTRY_POINTS))
        return list(dict.fromkeys([*super().list_commands(context), *brought]))

    def get_command(self, context: Any, name: str) -> Any:
        """Return a command; one of ours cannot be replaced."""
        own = super().get_command(context, name)
        if own is not None:
            return own
        brought = next((point for point in entry_points_of(ENTRY_POINTS) if point.name == name), None)
        return None if brought is None else typer.main.get_command(brought.load())


app = typer.Typer(
    cls=Commands,
    name="gyrobench",
    help="Run gyro test procedures on a bench of turntable, thermal chamber and gyros - real or emulated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (
    _procedures.app,
    _run.app,
    _steer.app,
    _report.app,
    _panel.app,
    _ports.app,
    _runs.import_app,
    _runs.app,
    _campaigns.campaign_app,
    _fits.fit_app,
    _fits.scheme_app,
    _gaps.gap_app,
    _frames.frames_app,
    _can.can_app,
):
    app.add_typer(group)


def main() -> None:
    """Run the command line; an error of ours is one paragraph and exit code 2, an aborted run exit code 3."""
    # Workers too (joblib starts them by `python -m`) take no module from the folder they are started in.
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        app()
    except BenchError as error:
        _complain(str(error))
        sys.exit(3 if isinstance(error, RunAborted | RunUnsealed) else 2)
    except KeyboardInterrupt:
        _complain("stopped by Ctrl-C")
        sys.exit(130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _complain(text: str) -> None:
    from bench.present.cli._console import Terminal

    Terminal(stderr=True).print(f"error: {text}", style="bold red", highlight=False)
