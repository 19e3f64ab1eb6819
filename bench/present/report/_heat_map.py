"""A map of cells: rows by columns, deeper where there is more, a figure in the cells that are significant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from bench.present.report._lettering import BOTTOM, CHARACTER, LINE, WIDE, label_room, length, short
from bench.present.report._palette import BAND, BLUE, GRID, INK, MUTED, ORANGE
from bench.present.report._plotting import FONT_SIZE, drawing, place, printable, svg
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PITCH = 25.0
_ROW_PT = 13.0


@dataclass(frozen=True)
class HeatCell:
    """Part of the whole in a cell, 0 .. 1, and the text printed there; without significance it stays pale."""

    share: float
    text: str
    significant: bool


def heat_map(
    figure_id: str,
    rows: Sequence[str],
    columns: Sequence[str],
    cells: Mapping[tuple[str, str], HeatCell],
    *,
    groups: Sequence[int] = (),
    description: str,
) -> Markup:
    """Return a map of `cells` by (row, column); `groups` are rows before which a line is drawn."""
    left = min(240.0, label_room(rows))
    top = CHARACTER * 0.62 * max(length(name) for name in columns) + LINE + 6.0
    width, height = WIDE - left - 26.0, _PITCH * len(rows)
    most = max((cell.share for cell in cells.values() if cell.significant), default=0.0) or 1.0
    with drawing(WIDE, top + height + 8.0) as figure:
        axes = place(figure, left, top, width, height)
        axes.set_xlim(0.0, len(columns))
        axes.set_ylim(len(rows), 0.0)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.tick_params(length=0)
        axes.xaxis.tick_top()
        axes.set_xticks([k + 0.35 for k in range(len(columns))])
        axes.set_xticklabels([printable(name) for name in columns], rotation=35, ha="left")
        axes.set_yticks([k + 0.5 for k in range(len(rows))])
        axes.set_yticklabels([printable(short(name, 38)) for name in rows])
        for y, row in enumerate(rows):
            for x, column in enumerate(columns):
                if (cell := cells.get((row, column))) is not None:
                    _draw_cell(axes, x, y, cell, most)
        for k in groups:
            axes.axhline(k, color=MUTED.light, linewidth=0.8)
        return svg(figure, figure_id, description)


def _draw_cell(axes: Axes, x: int, y: int, cell: HeatCell, most: float) -> None:
    from matplotlib.patches import Rectangle

    box = (x + 0.03, y + 0.06)
    face = Rectangle(box, 0.94, 0.88, facecolor=BAND.light, edgecolor=GRID.light, linewidth=0.5)
    axes.add_patch(face)
    if not cell.significant:
        return
    depth = 0.12 + 0.78 * (max(cell.share, 0.0) / most) ** 0.5
    axes.add_patch(Rectangle(box, 0.94, 0.88, facecolor=ORANGE.light, alpha=depth, linewidth=0))
    axes.text(
        x + 0.5,
        y + 0.53,
        printable(cell.text),
        ha="center",
        va="center",
        size=FONT_SIZE - 1.0,
        color=INK.light,
        weight="bold" if cell.share > 0.25 * most else "normal",
    )


def gain_map(
    figure_id: str, rows: Sequence[str], columns: Sequence[str], shares: Array, description: str
) -> Markup:
    """Return a map of small cells by position (n,) and state (m,): `shares` (n, m) in 0 .. 1, `columns` above."""
    from matplotlib.patches import Rectangle

    left, top, height = label_room(rows), 22.0, len(rows) * _ROW_PT
    count = len(columns)
    with drawing(WIDE, top + height + BOTTOM) as figure:
        axes = place(figure, left, top, WIDE - left - 12.0, height)
        axes.set_xlim(0.5, count + 0.5)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.grid(visible=False)
        axes.set_yticks(range(len(rows)), [printable(name) for name in rows])
        axes.set_xticks(range(1, count + 1))
        axes.set_xlabel("Position")
        for x, head in enumerate(columns):
            axes.text(x + 1, -0.75, head, ha="center", va="bottom", color=MUTED.light)
            for y in range(len(rows)):
                corner, shade = (x + 0.54, y - 0.46), float(shares[x, y])
                axes.add_patch(Rectangle(corner, 0.92, 0.92, facecolor=BLUE.light, alpha=shade, linewidth=0))
        return svg(figure, figure_id, description)
