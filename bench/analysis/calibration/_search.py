"""Search for schedules under a table: a beam over the grid's graph, then annealing by exhaustive re-routing.

The beam grows all schedules together and keeps, for every attitude, the best by a mean of sigma over target that
weighs the worst. Annealing takes a window of a schedule, evaluates every path the table allows between its ends,
and draws one by its merit (heat bath); a schedule that closes may also begin at any of its positions.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bench.analysis.calibration._annealing import anneal
from bench.analysis.calibration._beam import grow_beam
from bench.analysis.calibration._conventions import PARAMETERS, Task
from bench.analysis.calibration._graph import QUARTERS, Graph, Path, build_graph, stretch_of
from bench.analysis.calibration._schedule import ANGLES, Schedule
from bench.analysis.calibration._segments import scaled_variances
from bench.analysis.calibration._table import Table
from bench.analysis.common.fan_out import ALONE, FanOut
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class Merit:
    """Worst and rms of sigma over target."""

    worst: float
    rms: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best schedule found, how many were evaluated, and in words what was searched and what is proven."""

    schedule: Schedule
    merit: Merit
    evaluated: int
    statement: str


@dataclass(frozen=True)
class Effort:
    """How hard to look: beam width per attitude, annealing steps of each start, number of starts."""

    beam_width: int = 16
    steps: int = 400
    starts: int = 4


def merit_of(sigma: Array, task: Task) -> Merit:
    """Return the merit of posterior sigma (24,), SI."""
    return _merit(sigma / task.target_sigma)


def _merit(ratio: Array) -> Merit:
    return Merit(float(ratio.max()), float(np.sqrt(np.mean(ratio**2))))


def search(
    task: Task,
    table: Table,
    turns: int,
    pattern: Schedule,
    *,
    effort: Effort = Effort(),
    seed: int = 0,
    angles_deg: Sequence[int] = QUARTERS,
    fan: FanOut = ALONE,
    outer: str | None = None,
) -> SearchResult:
    """Return the best closed schedule of `turns` turns by +-`angles_deg` that the table can make.

    `pattern` gives dwell, rate and turn profile; `fan` says where the annealings run, each with random numbers of
    its own. `outer`: where the outer axis of a two-axis table points; the schedule then runs on it from its own
    home, heading and all. None: the table may have to start it a quarter turn of heading away. ConfigurationError
    for angles that are not 90, 180, 270 or 360, or if no such schedule closes.
    """
    if not angles_deg or not set(angles_deg) <= set(ANGLES):
        raise ConfigurationError(
            "turns by other angles are not searched",
            found=", ".join(str(angle) for angle in angles_deg) or "none",
            expected="some of " + ", ".join(str(angle) for angle in ANGLES),
        )
    graph = build_graph(task, table, pattern, tuple(dict.fromkeys(angles_deg)), outer)
    weight = (task.prior_sigma[PARAMETERS] / task.target_sigma) ** 2
    found, evaluated = grow_beam(graph, weight, turns, effort.beam_width)
    if not found:
        raise ConfigurationError(
            "no schedule closes",
            found=f"{turns} turns on a {table} table",
            expected="an even number, or more turns",
        )
    starts = list(enumerate(_diverse(found, effort.starts)))
    finished = fan.map(partial(_annealed, graph, weight, effort.steps, seed), starts)
    evaluated += sum(count for _, _, count in finished)
    path, _, _ = min(finished, key=lambda annealed: annealed[1])
    reached = stretch_of(graph, path.home, path.moves, rest=True)
    ratio = np.sqrt(scaled_variances(reached.information) * weight)
    degrees = ", ".join(str(angle) for angle in angles_deg)
    kind = "quarter turns" if tuple(angles_deg) == QUARTERS else f"turns by {degrees} deg"
    pointing = f", outer axis {outer}" if outer and table == "two-axis-horizontal" else ""
    return SearchResult(
        schedule=graph.schedule(path.home, path.moves, f"searched-{table}-{turns}"),
        merit=_merit(ratio),
        evaluated=evaluated,
        statement=(
            f"Searched: {turns} {kind} that close, {table} table{pointing}, {pattern.dwell_s:g} s dwell; beam of "
            f"{effort.beam_width} per attitude and home, {effort.starts} annealings of {effort.steps} steps, "
            f"{evaluated} schedules evaluated. Best found, not proven best."
        ),
    )


def _annealed(
    graph: Graph, weight: Array, steps: int, seed: int, start: tuple[int, Path]
) -> tuple[Path, float, int]:
    number, path = start
    return anneal(graph, weight, path, steps, np.random.default_rng((seed, number)))


def _diverse(paths: Sequence[Path], count: int) -> list[Path]:
    """Return the best path of each home in turn, until there are `count`."""
    by_home: dict[int, list[Path]] = {}
    for path in paths:
        by_home.setdefault(path.home, []).append(path)
    rounds = itertools.chain.from_iterable(itertools.zip_longest(*by_home.values()))
    return [path for path in rounds if path is not None][:count]
