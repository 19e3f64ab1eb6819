"""Matplotlib, loaded when the first figure is drawn, and its way into a page: inline SVG in the page's colours.

A figure is drawn on a transparent ground in light colours, each of which is then exchanged for a CSS variable, so
that one drawing serves the light theme, the dark one and paper. Ids get a prefix that keeps them unique in a
page; namespaces, metadata and document type go, so that no address of anybody else's is left in the page.
"""

from __future__ import annotations

import contextlib
import io
import re
import unicodedata
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from markupsafe import Markup

from bench.present.report._palette import GRID, INK, MUTED, PAINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FONT_SIZE = 10.0
_STYLE: dict[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "report",
    "text.parse_math": False,  # a run id may hold a dollar sign
    "axes.unicode_minus": True,
    "font.family": "DejaVu Sans",
    "font.size": FONT_SIZE,
    "text.color": INK.light,
    "axes.edgecolor": MUTED.light,
    "axes.labelcolor": MUTED.light,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID.light,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED.light,
    "ytick.color": MUTED.light,
    "xtick.labelsize": FONT_SIZE - 0.5,
    "ytick.labelsize": FONT_SIZE - 0.5,
    "xtick.major.size": 3.5,
    "ytick.major.size": 0.0,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
}
_COLOURS = {paint.light: paint.css for paint in PAINTS}
_COLOUR = re.compile("|".join(_COLOURS))
_REFERENCE = re.compile(r"url\(#([^)]+)\)")


@contextlib.contextmanager
def drawing(width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure of `width` x `height` points with the report's style in force."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # The browser sets the text and has the glyphs; matplotlib's own font is used for measuring only.
        warnings.filterwarnings("ignore", message=r"Glyph \d+")
        yield Figure(figsize=(width / 72.0, height / 72.0))


def place(figure: Figure, left: float, top: float, width: float, height: float, **settings: Any) -> Axes:
    """Return axes at a place given in points from the figure's upper left corner."""
    full_width, full_height = figure.get_size_inches() * 72.0
    box = (left / full_width, 1.0 - (top + height) / full_height, width / full_width, height / full_height)
    return figure.add_axes(box, **settings)


def svg(figure: Figure, figure_id: str, description: str) -> Markup:
    """Return the figure as an `<svg>` element for a page; `description` is read to those who cannot see it."""
    sheet = io.BytesIO()
    figure.savefig(sheet, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    root = ElementTree.fromstring(sheet.getvalue())
    _drop(root, ("metadata", "style"))
    for element in root.iter():
        element.tag = _local(element.tag)
        attributes = {_local(name): _themed(value, figure_id) for name, value in element.attrib.items()}
        if "id" in attributes:
            attributes["id"] = f"{figure_id}-{attributes['id']}"
        if attributes.get("href", "").startswith("#"):
            attributes["href"] = f"#{figure_id}-{attributes['href'][1:]}"
        element.attrib.clear()
        element.attrib.update(attributes)
    for unneeded in ("width", "height", "version"):
        root.attrib.pop(unneeded, None)
    root.attrib.update({"role": "img", "aria-label": printable(description)})
    return Markup(ElementTree.tostring(root, encoding="unicode", short_empty_elements=False))


def printable(text: str) -> str:
    """Return text that HTML and XML can carry: control characters and lone surrogates made visible."""
    return "".join(
        "\N{REPLACEMENT CHARACTER}"
        if unicodedata.category(sign) in ("Cc", "Cs") and sign not in "\n\t"
        else sign
        for sign in text
    )


def _local(name: str) -> str:
    return name.rpartition("}")[2]


def _themed(value: str, figure_id: str) -> str:
    value = _COLOUR.sub(lambda match: _COLOURS[match[0]], value)
    return _REFERENCE.sub(lambda match: f"url(#{figure_id}-{match[1]})", value)


def _drop(root: ElementTree.Element, names: tuple[str, ...]) -> None:
    for parent in list(root.iter()):
        for child in [child for child in parent if _local(child.tag) in names]:
            parent.remove(child)
