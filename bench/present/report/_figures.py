"""The plots of curves, from arrays: lanes over time with shaded phases, small multiples on common axes.

All lengths are in points of the drawing; the page scales a drawing to its column.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bench.present.report._decimation import decimate
from bench.present.report._lettering import BOTTOM, CHARACTER, LINE, WIDE, label_room, length, short, write
from bench.present.report._page import Figures, Key
from bench.present.report._palette import BAND, FLOOR, MUTED, Paint
from bench.present.report._plotting import FONT_SIZE, drawing, place, printable, svg
from bench.present.report._spread import spread
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LEFT = 52.0
_LEADER = {"arrowstyle": "-", "linewidth": 0.6, "shrinkB": 1}
"""The line from a label to what it names."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve, x and y of shape (n,); NaN breaks it."""

    label: str
    x: Array
    y: Array
    paint: Paint
    style: Literal["-", "--", ":"] = "-"
    width: float = 1.4


@dataclass(frozen=True, eq=False)
class Lane:
    """One of several plots above each other on a common x axis."""

    y_label: str
    curves: Sequence[Curve]
    height: float = 170.0


@dataclass(frozen=True, eq=False)
class Panel:
    """One of several small plots on common axes; `floor` shades -floor .. +floor."""

    curves: Sequence[Curve]
    title: str
    note: str = ""
    floor: float | None = None
    description: str = ""


def lanes(
    figure_id: str,
    plots: Sequence[Lane],
    x_label: str,
    caption: str,
    keys: Sequence[Key] = (),
    *,
    phases: Sequence[tuple[float, float, str]] = (),
    description: str = "",
) -> Figures:
    """Return curves in lanes over a common x axis, labelled at their right ends, over shaded phases.

    `phases` are (start, end, name) in x. Names that do not fit above the lanes are left to the shading.
    `description` is for those who cannot see it; without one it is the caption.
    """
    top, gap = (2.0 * LINE + 8.0) if phases else 10.0, 20.0
    height = top + sum(plot.height + gap for plot in plots) - gap + BOTTOM
    x_limits = limits((curve.x for plot in plots for curve in plot.curves), margin=0.0)
    width = WIDE - _LEFT - label_room([curve.label for plot in plots for curve in plot.curves])
    with drawing(WIDE, height) as figure:
        for number, plot in enumerate(plots):
            axes = place(figure, _LEFT, top, width, plot.height)
            axes.set_xlim(*x_limits)
            for start, end, _ in phases[::2]:
                axes.axvspan(start, end, color=BAND.light, linewidth=0, zorder=0)
            _draw(axes, plot.curves, buckets=450)
            axes.set_ylabel(printable(plot.y_label))
            axes.yaxis.set_label_coords(-(_LEFT - 10.0) / width, 0.5)
            _label_ends(axes, plot)
            if number == 0 and phases:
                _name_phases(axes, phases, width)
            if number == len(plots) - 1:
                axes.set_xlabel(printable(x_label))
            else:
                axes.tick_params(labelbottom=False)
            top += plot.height + gap
        return Figures([svg(figure, figure_id, description or caption)], caption, keys)


def panels(
    figure_id: str,
    plots: Sequence[Panel],
    caption: str,
    keys: Sequence[Key],
    *,
    x_label: str,
    y_label: str,
    x_margin: float = 0.0,
    y_margin: float = 0.05,
    columns: int | None = None,
) -> Figures:
    """Return small plots on common axes, each a drawing of its own, so that a page can flow them.

    `columns` stand side by side; None: as many as suit their number. The axes are made once and the curves
    exchanged: making ticks is most of the work.
    """
    if columns is None:
        columns = len(plots) if len(plots) < 3 else 2 if len(plots) == 4 else 3
    width = {1: WIDE, 2: 340.0, 3: 240.0}[columns]
    every = [curve for plot in plots for curve in plot.curves]
    from matplotlib.ticker import MaxNLocator

    noted = any(plot.note for plot in plots)
    left, top, height = 46.0, LINE * (2.0 if noted else 1.0) + 8.0, width * 0.46 + 80.0
    room = int((width - 8.0) / CHARACTER)
    drawn = []
    with drawing(width, height) as figure:
        axes = place(figure, left, top, width - left - 8.0, height - top - BOTTOM)
        axes.set_xlim(*limits((curve.x for curve in every), margin=x_margin))
        axes.set_ylim(*limits((curve.y for curve in every), margin=y_margin))
        axes.set_xlabel(x_label)
        axes.set_ylabel(printable(y_label))
        axes.yaxis.set_label_coords(-(left - 9.0) / (width - left - 8.0), 0.5)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_locator(MaxNLocator(5))
        for number, plot in enumerate(plots, start=1):
            artists: list[Any] = _draw(axes, plot.curves, buckets=220)
            if plot.floor is not None and math.isfinite(plot.floor):
                artists.append(
                    axes.axhspan(-plot.floor, plot.floor, color=FLOOR.light, linewidth=0, zorder=0)
                )
            artists += write(figure, 2.0, 2.0, short(plot.title, room - 2), weight="bold")
            artists += write(figure, 2.0, 2.0 + LINE, short(plot.note, room), color=MUTED.light)
            drawn.append(svg(figure, f"{figure_id}-{number}", plot.description))
            for artist in artists:
                artist.remove()
    return Figures(drawn, caption, keys, columns)


def limits(arrays: Iterable[Array], *, margin: float) -> tuple[float, float]:
    """Return limits that hold every finite value of `arrays` with a margin; 0 .. 1 if there is none.

    Without a margin, for an axis of time, a start close to zero becomes zero.
    """
    known = [array[np.isfinite(array)] for array in arrays]
    values = np.concatenate(known) if known else np.empty(0)
    if not len(values):
        return (0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    if not margin and 0.0 < low < 0.03 * high:
        low = 0.0
    room = margin * (high - low) if high > low else 0.5
    return low - room, high + room


def _draw(axes: Axes, curves: Sequence[Curve], buckets: int) -> list[Any]:
    lines = []
    for curve in curves:
        x, y = decimate(curve.x, curve.y, buckets)
        lines += axes.plot(x, y, curve.style, color=curve.paint.light, linewidth=curve.width, scalex=False)
    return lines


def _label_ends(axes: Axes, plot: Lane) -> None:
    """Write every curve's name beside its last value; names of curves that end together are moved apart."""
    low, high = axes.get_ylim()
    ends = [_last(curve.y) for curve in plot.curves]
    heights = [(end - low) / (high - low) * plot.height for end in ends]
    for curve, end, height in zip(
        plot.curves, heights, spread(heights, [LINE] * len(ends), 0.0, plot.height), strict=True
    ):
        if not curve.label:
            continue
        axes.annotate(
            printable(short(curve.label, 28)),
            (1.0, end / plot.height),
            (16.0, height - end),
            xycoords="axes fraction",
            textcoords="offset points",
            color=curve.paint.light,
            va="center",
            arrowprops=_LEADER | {"color": curve.paint.light, "relpos": (0.0, 0.5), "shrinkA": 0},
        )


def _name_phases(axes: Axes, phases: Sequence[tuple[float, float, str]], width: float) -> None:
    """Write the phases' names above the first lane, tied to their bands; all of them or those that fit."""
    low, high = axes.get_xlim()
    scale = width / (high - low)
    names = [printable(name.replace("_", " ")) for _, _, name in phases]
    sizes = [length(name) * CHARACTER + 7.0 for name in names]
    centres = [((start + end) / 2.0 - low) * scale for start, end, _ in phases]
    places = spread(centres, sizes, 2.0 - _LEFT, WIDE - _LEFT - 2.0)
    all_fit = sum(sizes) < WIDE - 4.0
    for (start, end, _), name, size, centre, apart in zip(phases, names, sizes, centres, places, strict=True):
        if all_fit or size < (end - start) * scale:
            moved = apart if all_fit else centre
            axes.annotate(
                name,
                (centre / width, 1.0),
                (moved - centre, 12.0),
                xycoords="axes fraction",
                textcoords="offset points",
                color=MUTED.light,
                ha="center",
                va="bottom",
                size=FONT_SIZE - 0.5,
                arrowprops=_LEADER | {"color": MUTED.light, "relpos": (0.5, 0.0), "shrinkA": 1},
            )


def _last(y: Array) -> float:
    known = y[np.isfinite(y)]
    return float(known[-1]) if len(known) else 0.0
