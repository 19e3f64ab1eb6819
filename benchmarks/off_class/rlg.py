"""Ring laser: what the fitted equation reaches of the attainable, at several spreads from power-on to power-on.

    python -m benchmarks.off_class.rlg [--units N]

Three runs are fitted (two alike, one reversed), three others judge: another day, a faster one, part of the range.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.common.statistics import attained
from bench.analysis.rlg._study import run_rlg_study
from benchmarks._measure import Row, figure, usual
from benchmarks.off_class._ring_lasers import FAMILIES, unit_runs

SPREADS = (0.03, 0.10, 0.20)
GOALS = {0.03: 95.0, 0.10: 90.0, 0.20: 85.0}
_KINDS = ("train", "repeat", "reverse", "repeat", "faster", "partial")
_FITTED = 3


@dataclass(frozen=True)
class Outcome:
    """Share of the true drift's improvement in %, of every unit, and the improvement itself."""

    shares: tuple[float, ...]
    improvements: tuple[float, ...]


def examine(family: str, spread: float, units: int) -> Outcome:
    """Fit and judge units of a family."""
    shares, improvements = [], []
    for unit in range(units):
        runs = unit_runs(FAMILIES[family], unit, spread, _KINDS)
        study = run_rlg_study(runs[:_FITTED], runs[_FITTED:])
        shares.append(attained(study.chosen.judged)[1] or 0.0)
        improvements.append(study.chosen.mean_improvement_pct)
    return Outcome(tuple(shares), tuple(improvements))


def rows() -> Iterator[Row]:
    """Return the worst and the median family's share of the attainable at each spread."""
    for spread in SPREADS:
        shares = [float(np.mean(examine(family, spread, usual(4, 1)).shares)) for family in FAMILIES]
        for name, value in (("worst", min(shares)), ("median", float(np.median(shares)))):
            title = f"ring laser, {100 * spread:.0f} % from run to run, {name} of families"
            yield figure(title, value, GOALS[spread], "goal", "% of attainable")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--units", type=int, default=4)
    asked = parser.parse_args(arguments)
    print("| family | spread, % | improvement, % | of attainable, % (worst unit) |\n|---|---|---|---|")
    for family in FAMILIES:
        for spread in SPREADS:
            o = examine(family, spread, asked.units)
            print(
                f"| {family} | {100 * spread:.0f} | {np.mean(o.improvements):.1f} | "
                f"{np.mean(o.shares):.1f} ({min(o.shares):.1f}) |",
                flush=True,
            )


if __name__ == "__main__":
    main()
