"""Curves of what a run has left, one panel a run, all to one scale."""

from __future__ import annotations

from collections.abc import Sequence

from bench.present.report._figures import Panel, limits, panels
from bench.present.report._page import Figures, Key


def left_over_panels(figure_id: str, plots: Sequence[Panel], caption: str, keys: Sequence[Key]) -> Figures:
    """Return the panels, x in h since power-on and y in deg/h, side by side if there are several."""
    every = [curve for plot in plots for curve in plot.curves]
    drawn = panels(
        figure_id,
        plots,
        x_label="Time since power-on, h",
        y_label="°/h",
        x_limits=limits((curve.x for curve in every), margin=0.0),
        y_limits=limits(curve.y for curve in every),
        width=340.0 if len(plots) > 1 else 690.0,
    )
    return Figures(drawn, caption, keys, 2 if len(plots) > 1 else 1)
