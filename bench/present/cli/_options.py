"""Options that several commands share, and a command that is quick to parse."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option
from typer.core import TyperCommand, TyperGroup

DEFAULT_BENCH = Path("lab.toml")
DEFAULT_RUNS = Path("runs")

Bench = Annotated[Path, Option("--bench", help="bench file (TOML)", show_default=True)]
RunArgument = Annotated[Path, Argument(help="run folder")]
ProcedureName = Annotated[
    str,
    Argument(
        help="name that `gyrobench procedures` lists, or a file, ./mine.py",
        autocompletion=lambda: _procedures(),
    ),
]
CampaignFile = Annotated[Path, Argument(help="campaign file (TOML)", metavar="FILE")]
RunsFolder = Annotated[Path, Option("--runs", help="folder that holds the runs")]
PlantFile = Annotated[
    Path | None, Option("--plant", help="plant file (TOML): physics behind the emulated devices")
]
Seed = Annotated[int | None, Option("--seed", help="seed of the emulated lab")]
Yes = Annotated[bool, Option("--yes", help="answer operator questions beforehand")]
By = Annotated[str, Option("--by", help="who starts it, for the record; default the user")]
SignedIn = Annotated[
    str, Option("--signed-in-as", help="the role as which the panel let them in", hidden=True)
]
JsonLines = Annotated[
    bool, Option("--json", help="for machines: one JSON object a line, the last one the result")
]
Json = Annotated[bool, Option("--json", help="print JSON")]
FittedRuns = Annotated[list[Path], Argument(help="run folders to fit on")]
TestRuns = Annotated[list[Path] | None, Option("--test", help="run folder that judges; repeat for several")]
GyroToFit = Annotated[str | None, Option(help="gyro to fit; default the first of the runs")]
FitFolder = Annotated[Path, Option(help="folder for the compensation and the report")]
DiagnosedRuns = Annotated[list[Path], Argument(help="run folders, or mapping files of foreign recordings")]
NominalModel = Annotated[Path, Option("--model", help="nominal model (TOML)")]
OwnEffects = Annotated[
    list[Path] | None,
    Option(
        "--effects", help="Python file with effects, or a simulation's function, of your own; its code runs"
    ),
]
DiagnosedGyro = Annotated[
    str | None, Option(help="gyro to diagnose, of a mapping the axis; default the first of the runs")
]
Arw = Annotated[float, Option(help="angle random walk, deg/sqrt(h)")]
Vrw = Annotated[float, Option(help="velocity random walk, ug/sqrt(Hz)")]
VelocityNoise = Annotated[float, Option(help="noise of the zero-velocity measurement")]
Gravity = Annotated[float | None, Option(help="gravity; default by latitude")]
Jobs = Annotated[
    int | None, Option(help="processes at work; default 1, with --cluster local one a processor")
]
Cluster = Annotated[
    str | None, Option(help="Dask cluster to work on: local, or a scheduler's tcp://host:port")
]


def _procedures() -> list[str]:
    """Return the names of the installed procedures, for the shell's completion; it completes files by itself."""
    from drivers.base.plugins import entry_points_of

    return sorted(point.name for point in entry_points_of("gyrobench.procedures"))


class _TextOnly:
    """Hands text (`str | None`) and flags on as they were typed.

    typer's own conversion loads pydantic, which takes as long as all else in a list of runs.
    """

    def get_params(self, context: Any) -> list[Any]:
        parameters: list[Any] = super().get_params(context)  # type: ignore[misc]
        for parameter in parameters:
            parameter.process_value = partial(_flag_or_text, type(parameter).process_value, parameter)
        return parameters


class TextCommand(_TextOnly, TyperCommand):
    """A command whose options are text and flags only."""


class TextGroup(_TextOnly, TyperGroup):
    """A group of commands, without options of its own."""


def _flag_or_text(process: Callable[..., Any], parameter: Any, context: Any, value: Any) -> Any:
    return process(parameter, context, value) if isinstance(value, bool) else value
