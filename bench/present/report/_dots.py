"""Dots against a limit: one row for each item, its single values and their mean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from bench.present.report._lettering import BOTTOM, LINE, WIDE, label_room, short, write
from bench.present.report._palette import AFTER, INK, MUTED
from bench.present.report._plotting import FONT_SIZE, drawing, place, printable, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Dots:
    """A row of a dot chart: the single values, their mean, and what is printed beside them."""

    label: str
    values: Sequence[float]
    mean: float
    note: str = ""
    emphasis: bool = False


def dot_chart(
    figure_id: str,
    rows: Sequence[Dots],
    *,
    x_label: str,
    limit: tuple[float, str] | None = None,
    lowest: float = -25.0,
    description: str,
) -> Markup:
    """Return a row of dots for each item: small ones for single values, a large one for their mean.

    `limit` is drawn as a line with its label. What lies below `lowest` is drawn at the edge as an arrow with
    its value, so that one failure does not squeeze the rest.
    """
    top, pitch = LINE + 12.0, 25.0
    left, right = label_room([row.label for row in rows]), label_room([row.note for row in rows])
    height = top + pitch * len(rows) + BOTTOM
    every = [value for row in rows for value in (*row.values, row.mean)] + ([limit[0]] if limit else [])
    low = min(0.0, max(lowest, math.floor(min(every) / 10.0) * 10.0))
    high = max(10.0, math.ceil(max(every) / 10.0) * 10.0)
    with drawing(WIDE, height) as figure:
        axes = place(figure, left, top, WIDE - left - right, pitch * len(rows))
        axes.set_xlim(low, high)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(x_label)
        if limit:
            axes.axvline(limit[0], color=INK.light, linewidth=1.1, dashes=(4, 3))
            axes.annotate(
                printable(limit[1]),
                (limit[0], 1.0),
                (0, 4),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                ha="center",
                va="bottom",
            )
        for place_, row in enumerate(rows):
            _dot_row(figure, axes, place_, row, low, top + pitch * (place_ + 0.5), WIDE - right + 12.0)
        return svg(figure, figure_id, description)


def _dot_row(
    figure: Figure, axes: Axes, at: int, row: Dots, low: float, top: float, note_left: float
) -> None:
    paint = AFTER if row.emphasis else MUTED
    inside = [value for value in row.values if value >= low]
    axes.plot(
        inside, [at] * len(inside), "o", color=paint.light, markersize=4.5, alpha=0.45, markeredgewidth=0
    )
    if row.mean >= low:
        axes.plot([row.mean], [at], "o", color=paint.light, markersize=8.5)
    worst = min((*row.values, row.mean))
    if worst < low:
        axes.plot([low], [at], "<", color=paint.light, markersize=7, clip_on=False)
        label = f"{worst:.0f}".replace("-", "−")
        axes.annotate(
            label,
            (low, at),
            (8, 0),
            textcoords="offset points",
            va="center",
            size=FONT_SIZE - 1.5,
            color=paint.light,
        )
    weight = "bold" if row.emphasis else "normal"
    write(figure, 2.0, top, short(row.label, 28), weight=weight, va="center")
    write(figure, note_left, top, row.note, weight=weight, va="center", color=MUTED.light)
