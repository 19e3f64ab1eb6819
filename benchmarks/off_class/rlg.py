"""Ring laser: what the fitted equation reaches of the attainable, at several spreads from power-on to power-on.

    python -m benchmarks.off_class.rlg [--units N] [--first N] [--fitted N]

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
from benchmarks.off_class._ring_lasers import FAMILIES, limits_pct, unit_runs

SPREADS = (0.03, 0.10, 0.20)
GOALS = {0.03: 95.0, 0.10: 90.0, 0.20: 85.0}
_KINDS = ("train", "repeat", "reverse", "repeat", "faster", "partial")
_FITTED = 3


@dataclass(frozen=True)
class Outcome:
    """Of every unit: shares of the true drift's improvement in %, and the improvement in %.

    `shares`: of what was taken; `equations`: of the corrected equation; `limits`: of a compensation that knows
    every effect but its size. `inside`: rows in the 95 % interval of the bias, `kept`: runs whose improvement was
    in the interval promised, `above_low`: at least at its lower end, in % of all.
    """

    shares: tuple[float, ...]
    equations: tuple[float, ...]
    limits: tuple[float, ...]
    improvements: tuple[float, ...]
    inside: float
    kept: float
    above_low: float
    taken: tuple[str, ...]


def examine(family: str, spread: float, units: Sequence[int], fitted: int = _FITTED) -> Outcome:
    """Fit and judge units of a family on the first `fitted` runs of three."""
    shares, equations, limits, improvements, taken = [], [], [], [], []
    inside, kept, low = [], [], []
    for unit in units:
        kinds = (*_KINDS[:fitted], *_KINDS[_FITTED:])
        runs = unit_runs(FAMILIES[family], unit, spread, kinds)
        study = run_rlg_study(runs[:fitted], runs[fitted:])
        shares.append(attained(study.chosen.judged)[1] or 0.0)
        equations.append(attained(study.equation.judged)[1] or 0.0)
        oracle = attained(study.chosen.judged)[0] or np.nan
        known = limits_pct(FAMILIES[family], unit, spread, kinds, fitted)
        limits.append(100.0 * float(np.mean(known)) / oracle)
        improvements.append(study.chosen.mean_improvement_pct)
        taken.append(study.choice.taken)
        for row in study.chosen.judged:
            if row.promise is not None and row.inside is not None:
                inside.append(row.inside)
                low.append(row.promise.low_pct <= row.improvement_pct)
                kept.append(low[-1] and row.improvement_pct <= row.promise.high_pct)
    held = [100.0 * float(np.mean(part)) if part else np.nan for part in (inside, kept, low)]
    return Outcome(
        tuple(shares),
        tuple(equations),
        tuple(limits),
        tuple(improvements),
        held[0],
        held[1],
        held[2],
        tuple(taken),
    )


def rows() -> Iterator[Row]:
    """Return the worst and the median family's share of the attainable at each spread, and what is held."""
    inside, kept = [], []
    for spread in SPREADS:
        found = [examine(family, spread, range(usual(4, 1))) for family in FAMILIES]
        shares = [float(np.mean(one.shares)) for one in found]
        limit = min(float(np.mean(one.limits)) for one in found)
        for name, value in (("worst", min(shares)), ("median", float(np.median(shares)))):
            title = f"ring laser, {100 * spread:.0f} % from run to run, {name} of families"
            if name == "worst":
                title += f" (known forms: {limit:.0f})"
            yield figure(title, value, GOALS[spread], "goal", "% of attainable")
        inside += [one.inside for one in found]
        kept += [one.kept for one in found]
    yield figure("ring laser, rows in the 95 % interval of bias", float(np.mean(inside)), 92.0, "goal", "%")
    yield figure("ring laser, improvement within that promised", float(np.mean(kept)), 90.0, "goal", "%")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--units", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="the first unit's number")
    parser.add_argument("--fitted", type=int, choices=(1, 2, 3), default=_FITTED, help="runs that are fitted")
    asked = parser.parse_args(arguments)
    print(
        "| family | spread, % | improvement, % | of attainable, % (worst unit) | equation | known forms | "
        "in 95 % interval | promise held (lower end) | taken |\n" + "|---" * 9 + "|"
    )
    every = []
    for family in FAMILIES:
        for spread in SPREADS:
            o = examine(family, spread, range(asked.first, asked.first + asked.units), asked.fitted)
            every.append((o.inside, o.kept, o.above_low))
            counts = ", ".join(f"{o.taken.count(name)} {name}" for name in dict.fromkeys(o.taken))
            cells = [
                family,
                f"{100 * spread:.0f}",
                f"{np.mean(o.improvements):.1f}",
                f"{np.mean(o.shares):.1f} ({min(o.shares):.1f})",
                f"{np.mean(o.equations):.1f}",
                f"{np.mean(o.limits):.1f} ({min(o.limits):.1f})",
                f"{o.inside:.1f}",
                f"{o.kept:.0f} ({o.above_low:.0f})",
                counts,
            ]
            print(f"| {' | '.join(cells)} |", flush=True)
    inside, kept, low = np.mean(every, axis=0)
    print(
        f"all: {inside:.1f} % of rows in the interval, {kept:.1f} % of promises held, lower end {low:.1f} %"
    )


if __name__ == "__main__":
    main()
