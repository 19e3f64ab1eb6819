"""Cold shock of a batch: the common model on units that were left out, beside their own fits from the same
runs.

    python -m benchmarks.off_class.batch [--family NAME]

Six units of a family with two bias runs and two scale-factor groups each make the batch; two further units
are judged on seven other profiles, with none, one and three runs of each kind of their own. Every unit has
physics of its own (`seed`), and its bias and scale factor are larger or smaller by 20 % (1 sigma). With one
run a unit's own fit is the grey box; with three it is what `fit cold-shock` ships, networks left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.common.statistics import attained
from bench.analysis.thermal import Scores, ThermalModel, ThermalRun, prepare
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._batch_study import BatchStudy, run_batch
from bench.analysis.thermal._evaluate import evaluate
from bench.analysis.thermal._grey_box import GreyBoxModel
from bench.analysis.thermal._study import run_study
from benchmarks.off_class._profiles import SF_TESTS, TESTS, measured, names
from benchmarks.off_class._thermal_plants import FAMILIES
from benchmarks.off_class.thermal import IN_CLASS, cheap_models, truths

SIZE, SPREAD = 6, 0.2
LEFT_OUT = (SIZE + 1, SIZE + 2)
OWN = (0, 1, 3)

Runs = dict[tuple[str, str], ThermalRun]


@dataclass(frozen=True)
class Outcome:
    """A left-out unit with `own` runs of each kind: share of the attainable improvement of bias in %, and rms
    scale-factor error in ppm, on the profiles that judge; of the batch and of the unit's own fit (None: no
    runs)."""

    unit: int
    own: int
    batch: tuple[float, float]
    alone: tuple[float, float] | None


def unit_runs(family: str, unit: int) -> Runs:
    """Return what a unit measures on every profile, by profile and kind."""
    rng = np.random.default_rng((500, unit))
    size = 1.0 + SPREAD * rng.standard_normal(2)
    made = {}
    for name, truth in truths(family, unit).items():
        own = replace(truth, bias_dph=size[0] * truth.bias_dph, sf_error_ppm=size[1] * truth.sf_error_ppm)
        for kind in ("bias", "scale"):
            run = measured(own, name, kind, rng)
            made[name, kind] = replace(run, run_id=f"unit {unit} {run.run_id}", unit_id=f"unit {unit}")
    return made


def examine(family: str) -> tuple[BatchStudy, list[Outcome]]:
    """Fit the batch of a family and judge it on the units that were left out."""
    first = names()
    batch = []
    for unit in range(1, SIZE + 1):
        runs = unit_runs(family, unit)
        batch += [runs[first[0], "bias"], runs[first[2], "bias"]]
        batch += [runs[first[0], "scale"], runs[first[1], "scale"]]
    study = run_batch(batch)
    outcomes = []
    for unit in LEFT_OUT:
        runs = unit_runs(family, unit)
        tests = [*(runs[name, "bias"] for name in TESTS), *(runs[name, "scale"] for name in SF_TESTS)]
        for count in OWN:
            own = [[runs[name, kind] for kind in ("bias", "scale")] for name in first[:count]]
            model = study.fit.model([prepare(run) for pair in own for run in pair])
            outcomes.append(Outcome(unit, count, _figures(model, tests), _alone(own, tests)))
    return study, outcomes


def _alone(own: Sequence[Sequence[ThermalRun]], tests: Sequence[ThermalRun]) -> tuple[float, float] | None:
    if not own:
        return None
    if len(own) == 1:
        model = GreyBoxModel()
        model.fit(anchor_runs([prepare(run) for run in own[0]]), ())
        return _figures(model, tests)
    *train, last = own
    study = run_study([run for pair in train for run in pair], last, tests, cheap_models())
    return _of_scores(study.scores[study.chosen])


def _figures(model: ThermalModel, tests: Sequence[ThermalRun]) -> tuple[float, float]:
    return _of_scores([evaluate(model.predict(prepare(run)), run) for run in tests])


def _of_scores(scores: Sequence[Scores]) -> tuple[float, float]:
    factors = [score.sf_true_rms_ppm for score in scores if score.sf_true_rms_ppm is not None]
    return attained(scores)[1] or 0.0, float(np.mean(factors))


def lines(families: Sequence[str]) -> Iterator[str]:
    """Return the table's lines."""
    yield (
        "| family | unit | common model | "
        + " | ".join(f"{count} own: batch, alone [%] | batch, alone [ppm]" for count in OWN)
        + " |"
    )
    yield "|---|---|---|" + "---|" * (2 * len(OWN))
    for family in families:
        study, outcomes = examine(family)
        for unit in LEFT_OUT:
            cells = []
            for row in (row for row in outcomes if row.unit == unit):
                for k, spec in enumerate((".1f", ".2f")):
                    alone = "–" if row.alone is None else format(row.alone[k], spec)
                    cells.append(f"{row.batch[k]:{spec}}, {alone}")
            yield f"| {family} | {unit} | {study.chosen} | " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--family", action="append", choices=(IN_CLASS, *FAMILIES), help="default all")
    asked = parser.parse_args(arguments)
    for line in lines(asked.family or (IN_CLASS, *FAMILIES)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
