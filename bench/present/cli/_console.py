"""The terminal: what comes from files and instruments is text, never markup and never a terminal's command.

A command prints for people, or with --json for machines: a `Terminal` drops what is meant for the other.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from bench.present.cli._texts import printable


class Terminal(Console):
    """A console whose text is shown as it is, letter by letter; style it with `style=` or `rich.text.Text`.

    `as_json`: for machines; then only `say_json` prints, else everything but `say_json`.
    """

    def __init__(self, *, as_json: bool = False, **options: Any) -> None:
        super().__init__(**{"markup": False, "emoji": False, "quiet": as_json} | options)
        self.as_json = as_json

    def say(self, text: str, style: str | None = None, *, soft_wrap: bool = False) -> None:
        """Print a text in one style, without colours for the numbers in it."""
        self.print(text, style=style, highlight=False, soft_wrap=soft_wrap)

    def say_all(self, texts: Iterable[object], style: str | None = None, *, soft_wrap: bool = False) -> None:
        """Print texts or paths, a line each."""
        for text in texts:
            self.say(str(text), style, soft_wrap=soft_wrap)

    def parts(self, *parts: str | tuple[str, str]) -> None:
        """Print a line of texts, or texts with their styles."""
        self.print(Text.assemble(*parts))

    def table(
        self, heads: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str | None = None
    ) -> None:
        """Print a table."""
        grid = Table(*heads, title=title)
        for row in rows:
            grid.add_row(*row)
        self.print(grid)

    def say_json(self, kind: str, **facts: Any) -> None:
        """Print one JSON object on a line; numbers that are not finite become null."""
        if not self.as_json:
            return
        line = json.dumps({"kind": kind} | _finite(facts), ensure_ascii=False, allow_nan=False, default=str)
        self.file.write(line + "\n")
        self.file.flush()

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render, and replace what a terminal would act on."""
        for segment in super().render(renderable, options):
            if segment.control is None and not segment.text.isprintable():
                segment = Segment(printable(segment.text, keep="\n\t"), segment.style)
            yield segment


def _finite(value: Any) -> Any:
    """Return plain values: dictionaries, lists and dataclasses as they are made of, arrays as lists."""
    if is_dataclass(value) and not isinstance(value, type):
        return {entry.name: _finite(getattr(value, entry.name)) for entry in fields(value)}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
