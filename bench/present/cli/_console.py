"""The terminal: what comes from files and instruments is text, never markup and never a terminal's command."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from bench.present.cli._texts import printable


class Terminal(Console):
    """A console whose text is shown as it is, letter by letter; style it with `style=` or `rich.text.Text`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"markup": False, "emoji": False} | options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render, and replace what a terminal would act on."""
        for segment in super().render(renderable, options):
            if segment.control is None and not segment.text.isprintable():
                segment = Segment(printable(segment.text, keep="\n\t"), segment.style)
            yield segment


def console_for(as_json: bool) -> Console:
    """Return where a command prints; JSON is never wrapped or coloured, so that it goes to the bare stream."""
    return Terminal(highlight=False, color_system=None) if as_json else Terminal()
