"""The part of the page that is plain HTML: sent with its values, painted before any script has run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from jinja2 import Environment, StrictUndefined, Template

_HERE = Path(__file__).parent


@cache
def style_sheet() -> str:
    """Return the style sheet; dark by the page's own switch, or by the browser's wish until that is there."""
    dark = (_HERE / "assets" / "dark.css").read_text(encoding="utf-8")
    return (
        (_HERE / "assets" / "panel.css").read_text(encoding="utf-8")
        + f"body.body--dark {{ {dark} }}\n"
        + f"@media (prefers-color-scheme: dark) {{ body:not(.body--light) {{ {dark} }} }}\n"
    )


def first_paint(values: Mapping[str, str], banner: Mapping[str, str]) -> str:
    """Return names, banner, cards and lists with the values there are; panel.js moves them to their places."""
    return _template().render(values=values, banner=banner)


@cache
def _template() -> Template:
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    return environment.from_string((_HERE / "first_paint.html.j2").read_text(encoding="utf-8"))
