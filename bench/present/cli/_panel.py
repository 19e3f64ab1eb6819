"""`gyrobench panel`."""

from __future__ import annotations

from pathlib import Path

from bench.present.cli._console import Terminal
from drivers.base.errors import ConfigurationError


def panel_command(runs: Path, host: str, port: int, token: str | None) -> None:
    """Serve the panel until Ctrl-C."""
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
    Terminal().print(f"panel of {runs}: http://{shown}:{port}{query}   Ctrl-C ends it", highlight=False)
    serve(settings)
