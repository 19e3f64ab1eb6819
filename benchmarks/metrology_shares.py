"""Whether an input's part of an uncertainty budget is what switching its error on and off shows.

`python -m benchmarks.metrology_shares UNITS` tests each simulated unit twice with the same noise: on a bench
without errors, and on one where a single instrument has the error that its certificate allows, drawn anew for
each unit. By how much a figure then differs scatters as that input's uncertainty in the figure's budget says, if
it is right. The table goes to docs/uncertainty.md.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.figures import Figure
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._from_run import figures_of_record
from benchmarks.metrology import BENCH, GRADES, Grade, Unit, bench_errors, drawn

INPUTS: Mapping[str, tuple[str, ...]] = {
    "time_base_ppm": ("time_base_ppm",),
    "table_rate_ppm": ("table_rate_ppm",),
    "table_angle_deg": ("table_angle_deg",),
    "table_level_deg": ("table_level_deg",),
    "azimuth_deg": ("azimuth_deg",),
    "latitude_deg": ("latitude_deg",),
    "unit_temp_c": ("unit_temp_c",),
    "fixture_deg": ("fixture_deg",),
    "fixture_seat_deg": ("fixture_seat_deg",),
    "axis_cosine_ppm": ("fixture_deg", "table_wobble_deg"),
}
"""Input of a budget -> the instruments whose errors make it."""
_LEAST_SHARE = 0.01


@dataclass(frozen=True)
class Share:
    """An input of a figure: its mean part of the variance, its uncertainty by the budget and by switching."""

    figure: str
    source: str
    share: float
    told: float
    found: float
    units: int


def _figures(unit: Unit) -> dict[str, Figure]:
    found = with_budgets(figures_of_record(unit)[0], unit, BenchErrors(BENCH))
    return {item.name: item for item in found}


def shares(grade: Grade, units: int, inputs: Mapping[str, tuple[str, ...]] = INPUTS) -> Iterator[Share]:
    """Yield every input of every figure of a grade that has at least a hundredth of the variance."""
    tested = [Unit(grade, drawn(grade, seed), seed) for seed in range(units)]
    without = [_figures(unit) for unit in tested]
    for source, quantities in inputs.items():
        changes: dict[str, list[float]] = {}
        for seed in range(units):
            errors = bench_errors(np.random.default_rng((seed, 3)))
            bench = {quantity: errors[quantity] for quantity in quantities}
            for name, figure in _figures(tested[seed].on(bench)).items():
                if name in without[seed]:
                    changes.setdefault(name, []).append(figure.value - without[seed][name].value)
        for name, each in changes.items():
            parts = [
                (figures[name].budget, item)
                for figures in without
                if name in figures and (budget := figures[name].budget) is not None
                for item in budget.contributions
                if item.source == source
            ]
            share = (
                np.mean([budget.share(item) for budget, item in parts if budget is not None])
                if parts
                else 0.0
            )
            if share >= _LEAST_SHARE:
                told = math.sqrt(np.mean([item.uncertainty**2 for _, item in parts]))
                found = float(np.sqrt(np.mean((np.array(each) - np.mean(each)) ** 2)))
                yield Share(name, source, float(share), told, found, len(each))


def rows(grade: Grade, units: int) -> str:
    """Return the lines of a grade for docs/uncertainty.md."""
    lines = [
        f"| {grade.name} | {each.figure} | `{each.source}` | {100.0 * each.share:.0f} % | {each.told:.2g} | "
        f"{each.found:.2g} | {each.found / each.told:.2f} |"
        for each in shares(grade, units)
    ]
    return "\n".join(lines)


_BEGIN, _END = "<!-- shares -->\n", "<!-- end of shares -->"


def write(path: Path, units: int) -> None:
    """Put the table of so many units of each grade into docs/uncertainty.md."""
    columns = "grade | figure | input | share | by the budget | by switching | ratio"
    head = f"| {columns} |\n|---|---|---|---|---|---|---|\n"
    table = head + "\n".join(rows(grade, units) for grade in GRADES) + "\n"
    before, _, rest = path.read_text(encoding="utf-8").partition(_BEGIN)
    path.write_text(before + _BEGIN + table + _END + rest.partition(_END)[2], encoding="utf-8")


if __name__ == "__main__":
    write(Path("docs/uncertainty.md"), int(sys.argv[1]) if len(sys.argv) > 1 else 100)
