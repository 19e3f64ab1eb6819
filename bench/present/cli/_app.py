"""The commands of `gyrobench`: a file or a package for each group, all of them in one table."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.main import get_group_from_info
from typer.models import TyperInfo

from bench import __version__
from bench.present.cli._options import TextGroup
from drivers.base.errors import BenchError, RunAborted, RunUnsealed

COMMANDS = {
    "procedures": "_lists",
    "run": "_run",
    "rehearse": "_run",
    "foretell": "_foretell",
    "steer": "_sessions",
    "lab": "_run",
    "report": "_report",
    "panel": "_sessions",
    "ports": "_lists",
    "import": "_import",
    "look": "_look",
}
"""Command -> the file here that holds it, in `app`."""
GROUPS = {
    "new": ("_new", "Write a procedure, driver, effect, campaign or bench file."),
    "operators": ("_operators", "Say who may sign in at the panel, and with which role."),
    "key": ("_key", "Make the key that a bench signs with; check signatures."),
    "runs": ("_runs", "List, show, check and export recorded runs."),
    "campaign": ("campaign", "Plan, rehearse, run and resume the runs of one file."),
    "fit": ("fit", "Fit compensations to recorded runs."),
    "scheme": ("_scheme", "Evaluate and search rotation schemes for the calibration."),
    "gap": ("gap", "Find where simulation and bench differ, and what is missing."),
    "frames": (
        "_frames",
        "List and check descriptions of gyros that send frames (TOML).",
    ),
    "can": ("_can", "List and check layouts of gyros on CAN (DBC and mapping)."),
}
"""Group -> its file or package, with an `app`, and its help: for `gyrobench --help` it is not loaded."""
ENTRY_POINTS = "gyrobench.commands"
"""Entry points of other packages: command or group -> a `typer.Typer` that holds it."""


class Commands(TextGroup):
    """Loads and builds a command when it is asked for: `gyrobench runs list` does not wait for the others."""

    def list_commands(self, context: Any) -> list[str]:
        """Return the names, ours first."""
        return list(dict.fromkeys([*COMMANDS, *GROUPS, *_brought()]))

    def get_command(self, context: Any, name: str) -> Any:
        """Return a command or group, None if there is none of this name; one of ours cannot be replaced."""
        holder = _holder(name)
        if holder is None:
            return None
        about = GROUPS[name][1] if name in GROUPS else holder.info.help
        group = get_group_from_info(
            TyperInfo(holder, help=about),
            pretty_exceptions_short=True,
            suggest_commands=True,
            rich_markup_mode=None,
        )
        return group if holder.info.name == name else group.commands.get(name)

    def resolve_command(self, context: Any, arguments: list[str]) -> Any:
        """Find the command; for one that there is not, similar names are suggested."""
        if arguments and _holder(arguments[0]) is None:
            self.commands = {name: typer.core.TyperCommand(name) for name in self.list_commands(context)}
        return super().resolve_command(context, arguments)

    def format_commands(self, context: Any, formatter: Any) -> None:
        """Write names and help of the commands, without building them."""
        names = self.list_commands(context)
        room = formatter.width - 6 - max(map(len, names))
        rows = [
            (name, typer.core.TyperCommand(name, help=_help(name)).get_short_help_str(room)) for name in names
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _brought() -> dict[str, Any]:
    """Return the entry points of other packages by name."""
    from drivers.base.plugins import entry_points_of  # looks through all packages that are installed

    return {point.name: point for point in entry_points_of(ENTRY_POINTS)}


def _holder(name: str) -> typer.Typer | None:
    file = GROUPS[name][0] if name in GROUPS else COMMANDS.get(name)
    if file is not None:
        holder: typer.Typer = import_module(f"bench.present.cli.{file}").app
        return holder
    point = _brought().get(name)
    return None if point is None else point.load()


def _help(name: str) -> str:
    if name in GROUPS:
        return GROUPS[name][1]
    holder = _holder(name)
    assert holder is not None
    if holder.info.name == name:
        return str(holder.info.help or "")
    callbacks = {
        info.name or info.callback.__name__: info.callback
        for info in holder.registered_commands
        if info.callback
    }
    return callbacks[name].__doc__ or ""


app = typer.Typer(
    cls=Commands,
    name="gyrobench",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _say_version(asked: bool) -> None:
    if asked:
        typer.echo(f"gyrobench {__version__}")
        raise typer.Exit


@app.callback()
def gyrobench(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="print the version and end"),
    ] = False,
) -> None:
    """Run gyro test procedures on a bench of turntable, thermal chamber and gyros - real or emulated."""


_STOPPED = 130


def main() -> None:
    """Run the command line; an error of ours is one paragraph and exit code 2, an aborted run exit code 3."""
    # Workers too (joblib starts them by `python -m`) take no module from the folder they are started in.
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        app()
    except BenchError as error:
        _complain(str(error))
        sys.exit(3 if isinstance(error, RunAborted | RunUnsealed) else 2)
    except ModuleNotFoundError as error:
        from drivers.base.plugins import needs_extra

        told = needs_extra(error, "this command")
        if told is None:
            raise
        _complain(str(told))
        sys.exit(2)
    except (KeyboardInterrupt, SystemExit) as end:
        # of a command that Ctrl-C stopped, Typer makes an exit without a word
        if isinstance(end, SystemExit) and end.code != _STOPPED:
            raise
        _complain("stopped by Ctrl-C")
        sys.exit(_STOPPED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _complain(text: str) -> None:
    from bench.present.cli._console import Terminal

    Terminal(stderr=True).say(f"error: {text}", style="bold red")
