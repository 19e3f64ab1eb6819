"""A page as one self-contained HTML file: the template, the style sheet, nothing from anywhere else."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from bench.present.report._page import Definitions, Page, Section
from bench.present.report._palette import PAINTS
from bench.present.report._plotting import printable

_FOLDER = Path(__file__).parent


def render_page(page: Page) -> str:
    """Return the page as HTML 5. All text is escaped; empty blocks and sections without blocks are left out."""
    sections = [
        replace(section, blocks=blocks)
        for section in (*page.sections, Section("Definitions", [Definitions(page.terms)]))
        if (blocks := [block for block in section.blocks if not block.empty])
    ]
    return _environment().get_template("page.html.j2").render(page=page, sections=sections)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalize,
    )
    # Ours, not a manifest's: trusted as they are.
    environment.globals["style_sheet"] = Markup((_FOLDER / "report.css").read_text(encoding="utf-8"))
    environment.filters["in_style"] = _in_style
    environment.globals["paints"] = PAINTS
    environment.globals["marks"] = {"good": "✓", "bad": "✕", "doubt": "!", "plain": ""}
    return environment


def _in_style(text: str) -> str:
    """Return a text as it may stand between quotes in a style sheet: what could end either becomes a blank."""
    return "".join(" " if letter in "\"'\\<>&{}\n" else letter for letter in printable(text))


def _finalize(value: Any) -> Any:
    return value if isinstance(value, Markup) else printable(value) if isinstance(value, str) else value
