"""Lettering of figures: sizes in points, lengths of texts, texts placed on a drawing."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from bench.present.report._plotting import FONT_SIZE, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDE = 690.0
"""Width of a drawing that fills the page."""
BOTTOM = 34.0
"""Room for tick labels and the label of the x axis."""
LINE = FONT_SIZE * 1.35
CHARACTER = FONT_SIZE * 0.56


def label_room(labels: Iterable[str]) -> float:
    """Return the width in points to keep for the longest of `labels`, at most 200."""
    longest = max(length(label) for label in labels)
    return min(200.0, 22.0 + 1.1 * CHARACTER * longest)


def length(text: str) -> int:
    """Return a text's length in narrow characters; East Asian wide ones count twice."""
    return sum(2 if unicodedata.east_asian_width(sign) in "WF" else 1 for sign in text)


def write(figure: Figure, left: float, top: float, text: str, **settings: Any) -> list[Any]:
    """Write `text` with its left upper corner at a place in points; return the artist, none for an empty text."""
    if not text:
        return []
    width, height = figure.get_size_inches() * 72.0
    settings = {"va": "top", **settings}
    return [figure.text(left / width, 1.0 - top / height, printable(text), **settings)]


def short(text: str, most: int) -> str:
    """Return `text` cut with an ellipsis to at most `most` narrow characters."""
    while length(text) > most:
        text = text.removesuffix("…")[:-1] + "…"
    return text
