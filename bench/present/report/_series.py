"""What a procedure worked out beside single figures: a table each, and its curves where it asks for a plot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._numbers import significant
from bench.present.report._page import Block, Cell, Row, Table
from bench.present.report._palette import PURPLE
from bench.record.events.run import Series


def series_blocks(every: Sequence[Series]) -> list[Block]:
    """Return the tables and plots of a run's series, in its order."""
    blocks: list[Block] = []
    for number, series in enumerate(every, start=1):
        if series.plot and len(series.columns) > 1:
            blocks.append(_plot(f"series-{number}", series))
        rows = [
            Row([Cell(significant(value, 6)) for value in row])
            for row in zip(*series.columns.values(), strict=True)
        ]
        blocks.append(Table([f">{head}" for head in series.columns], rows, _sentence(series.title)))
    return blocks


def _plot(figure_id: str, series: Series) -> Block:
    """Return every column over the first, each in a lane of its own: they have units of their own."""
    (x_name, x), *others = (
        (name, np.array([np.nan if value is None else value for value in values]))
        for name, values in series.columns.items()
    )
    plots = [Lane(_axis(name), [Curve("", x, y, PURPLE)], height=150.0) for name, y in others]
    return lanes(figure_id, plots, _axis(x_name), _sentence(series.title))


def _axis(head: str) -> str:
    """Return a heading as axes have it: "error [ppm]" is "error, ppm"."""
    return head.replace(" [", ", ").removesuffix("]") if head.endswith("]") else head


def _sentence(title: str) -> str:
    return title if title.endswith((".", "!", "?")) else f"{title}."
