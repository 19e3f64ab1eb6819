"""`gyrobench panel`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option, Typer

from bench.present.cli._options import DEFAULT_RUNS
from drivers.base.errors import ConfigurationError

app = Typer()


@app.command()
def panel(
    runs: Annotated[Path, Argument(help="folder of runs and campaigns to watch")] = DEFAULT_RUNS,
    host: Annotated[str, Option(help="address to listen on; another than this machine needs a token")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, Option(help="port to listen on", min=1, max=65535)] = 8765,
    token: Annotated[
        str | None,
        Option(envvar="GYROBENCH_PANEL_TOKEN", help="what a browser must show", show_envvar=True),
    ] = None,
) -> None:
    """Show in a browser what the bench is doing; a process of its own that cannot disturb a run."""
    from bench.present.cli._console import Terminal

    try:
        from bench.present.panel import PanelSettings, serve
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            "the panel is not installed",
            found=str(error),
            expected="the extra `panel`",
            remedy="pip install 'gyrobench[panel]'",
        ) from error
    settings = PanelSettings(runs, host, port, token)
    settings.check()
    shown = f"[{host}]" if ":" in host else host
    query = "/?token=..." if token else "/"
    Terminal().say(f"panel of {runs}: http://{shown}:{port}{query}   Ctrl-C ends it")
    serve(settings)
