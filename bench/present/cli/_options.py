"""Options that several commands share: where work runs; a command that is quick to parse."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

Jobs = Annotated[
    int | None,
    typer.Option("--jobs", help="processes at work; default 1, with --cluster local one a processor"),
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", help="Dask cluster to work on: local, or a scheduler's tcp://host:port"),
]


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
