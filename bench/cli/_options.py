"""Options that several commands share: where work runs."""

from __future__ import annotations

from typing import Annotated

import typer

Jobs = Annotated[
    int | None,
    typer.Option("--jobs", help="processes at work; default 1, with --cluster local one a processor"),
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", help="Dask cluster to work on: local, or a scheduler's tcp://host:port"),
]
