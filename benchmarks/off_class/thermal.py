"""Cold shock: what `fit cold-shock` ships on gyros of other physics, beside what the true drift would give.

    python -m benchmarks.off_class.thermal [--all-models] [--units N]

Without `--all-models` the two networks are left out: they take most of the time and were never chosen.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.common.statistics import attained
from bench.analysis.thermal import Study, prepare
from bench.analysis.thermal._registry import model_names
from bench.analysis.thermal._regression import TARGETS, anchored_errors
from bench.analysis.thermal._study import run_study
from benchmarks._measure import Row, figure
from benchmarks._thermal_runs import cold_shock
from benchmarks.off_class._profiles import Truth, campaign, names, profiles, truths_of
from benchmarks.off_class._thermal_plants import FAMILIES
from drivers.base.arrays import Array

IN_CLASS = "emulated fibre gyro (in class)"
NETWORKS = ("lstm", "hybrid")
GOALS = {"worst": 95.0, "median": 98.0}


@dataclass(frozen=True)
class Outcome:
    """Shares of the attainable improvement in % over the held-out profiles, by model, and which was shipped."""

    family: str
    unit: int
    shares: dict[str, float]
    shipped: str
    coverage: tuple[float, float] = (float("nan"), float("nan"))
    half_width: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def share(self) -> float:
        """The shipped model's."""
        return self.shares[self.shipped]

    @property
    def best(self) -> str:
        """The model that would have been best."""
        return max(self.shares, key=lambda name: self.shares[name])

    @property
    def behind_second(self) -> float:
        """By how much the shipped model is behind the second best of all, points; 0 if it is one of the two."""
        second = sorted(self.shares.values())[-2]
        return max(0.0, second - self.share)


def in_class(seed: int) -> dict[str, Truth]:
    """Return what the emulated lab's own mid-grade gyro does on the profiles."""
    made = {}
    for name, (cold, ramp, soak_min, room) in zip(names(), profiles(), strict=True):
        shocks = 2 if name == "double" else 1
        data = cold_shock(
            cold_c=cold, ramp_k_per_min=ramp, soak_min=soak_min, room_c=room, unit_seed=seed, shocks=shocks
        )
        made[name] = Truth(data.t_in_c, data.t_out_c, data.true_bias_dph, data.true_sf_error_ppm)
    return made


def truths(family: str, unit: int) -> dict[str, Truth]:
    """Return what a unit of a family does on every profile."""
    return in_class(unit) if family == IN_CLASS else truths_of(FAMILIES[family](unit))


def examine(family: str, unit: int, models: Sequence[str]) -> tuple[Outcome, Study]:
    """Fit and judge the campaign of a unit of a family."""
    made = campaign(truths(family, unit), 100 + unit)
    study = run_study(made.training, made.validation, made.tests, models)
    shares = {name: attained(rows)[1] or 0.0 for name, rows in study.scores.items()}
    return Outcome(family, unit, shares, study.chosen, *intervals(study)), study


def intervals(study: Study) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how many % of the held-out means of 100 s lie in the 95 % intervals, and the mean half widths, of
    bias (deg/h) and scale factor (ppm)."""
    compensation = study.compensation
    inside: dict[str, list[Array]] = {target: [] for target in TARGETS}
    widths: dict[str, list[Array]] = {target: [] for target in TARGETS}
    for run in study.tests:
        features = prepare(run)
        half = compensation.half_widths(features)
        if half is None:
            continue
        for column, target in enumerate(TARGETS):
            if getattr(features, target) is not None:
                error = anchored_errors([compensation.model.predict(features)], [features], target)
                own = half[features.weight > 0, column]
                inside[target].append(np.abs(error) <= own)
                widths[target].append(own)
    share = [100.0 * float(np.concatenate(inside[target]).mean()) for target in TARGETS]
    mean = [float(np.concatenate(widths[target]).mean()) for target in TARGETS]
    return (share[0], share[1]), (mean[0], mean[1])


def cheap_models() -> tuple[str, ...]:
    """Return the models without the networks."""
    return tuple(name for name in model_names() if name not in NETWORKS)


def rows() -> Iterator[Row]:
    """Return the shipped model's share of the attainable, family by family, the worst and the median."""
    shares, coverage, behind = [], [], []
    for family in FAMILIES:
        outcome, _ = examine(family, 0, cheap_models())
        shares.append(outcome.share)
        coverage += [*outcome.coverage]
        behind.append(outcome.behind_second)
        title = f"cold shock, {family}: {outcome.shipped}"
        yield figure(
            title,
            outcome.share,
            outcome.shares[outcome.best],
            f"best model, {outcome.best}",
            "% of attainable",
        )
    for title, value in (("worst", min(shares)), ("median", float(np.median(shares)))):
        yield figure(f"cold shock, {title} of families", value, GOALS[title], "goal", "% of attainable")
    yield figure(
        "cold shock, behind the second best", max(behind), 1.0, "goal, at most", "points", least=True
    )
    yield figure("cold shock, 95 % intervals, worst of families", min(coverage), 85.0, "goal", "% inside")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--all-models", action="store_true", help="with the networks")
    parser.add_argument("--units", type=int, default=1, help="units of each family")
    parser.add_argument("--family", action="append", choices=(IN_CLASS, *FAMILIES), help="default all")
    asked = parser.parse_args(arguments)
    models = model_names() if asked.all_models else cheap_models()
    print(
        "| family | unit | "
        + " | ".join(models)
        + " | shipped | share | behind second | in 95 %: bias, SF | half width |"
    )
    print("|---|---|" + "---|" * (len(models) + 5))
    for family in asked.family or (IN_CLASS, *FAMILIES):
        for unit in range(asked.units):
            outcome, study = examine(family, unit, models)
            cells = " | ".join(f"{outcome.shares[name]:.1f}" for name in models)
            shipped = "+".join(study.selection[0].parts) or outcome.shipped
            told = "{:.1f}, {:.1f} | {:.3f} deg/h, {:.1f} ppm".format(*outcome.coverage, *outcome.half_width)
            behind = f"{outcome.share:.1f} | {outcome.behind_second:.1f}"
            print(f"| {family} | {unit} | {cells} | {shipped} | {behind} | {told} |", flush=True)


if __name__ == "__main__":
    main()
