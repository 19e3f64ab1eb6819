"""A study's models by their figures on held-out runs: table of means, table by run, verdict on the chosen one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from bench.analysis.common.statistics import attained
from bench.present.report._numbers import column, fixed, known, mean, significant
from bench.present.report._page import Block, Cell, Headline, Row, Table, Tone, named

if TYPE_CHECKING:
    from bench.analysis.thermal import Scores, Study

Models = Mapping[str, Sequence["Scores"]]


def ranked(study: Study) -> dict[str, Sequence[Scores]]:
    """Return the scores by model, the largest mean improvement first (then the smallest scale-factor error)."""

    def rank(model: str) -> tuple[float, float]:
        improvement = mean(score.improvement_pct for score in study.scores[model])
        rms = mean(map(sf_rms_ppm, study.scores[model]))
        return (-improvement if improvement is not None else 1e9, rms if rms is not None else 1e9)

    return {model: study.scores[model] for model in sorted((item.name for item in study.selection), key=rank)}


def sf_rms_ppm(score: Scores) -> float | None:
    """Return the rms scale-factor error, against the truth where it is known."""
    return score.sf_rms_ppm if score.sf_true_rms_ppm is None else score.sf_true_rms_ppm


def _sf_max_ppm(score: Scores) -> float | None:
    return score.sf_max_ppm if score.sf_true_max_ppm is None else score.sf_true_max_ppm


def outside_sentence(score: Scores) -> str:
    """Return what a run's comparison holds inside and outside the compensation's range; "" for all inside."""
    split = score.apart
    if split is None or not split.outside:
        return ""
    unit = "ppm" if score.stability_dph is None else "°/h"
    parts = [
        f"{where} {significant(before)} → {significant(after)} {unit}"
        for where, before, after in (
            ("inside", split.inside_before, split.inside_after),
            ("outside", split.outside_before, split.outside_after),
        )
        if before is not None
    ]
    share = fixed(100.0 * split.outside / split.count, 1)
    said = f"{split.outside} of {split.count} s ({share} %) are out of the compensation's range"
    return f"{score.run_id}: {said}; 1σ {', '.join(parts)}."


def model_table(models: Models, chosen: str) -> list[Block]:
    """Return the models with their means over the held-out runs; columns that nobody fills are left out."""
    by_model = list(models.values())
    improvements = [[score.improvement_pct for score in scores] for scores in by_model]
    before = [mean(score.raw_stability_dph for score in scores) for scores in by_model]
    after = [mean(score.stability_dph for score in scores) for scores in by_model]
    sf_rms = [mean(map(sf_rms_ppm, scores)) for scores in by_model]
    columns = [
        (">Bias stability before [°/h]", column(before)),
        (">after [°/h]", column(after)),
        (">Improvement [%]", [fixed(mean(values), 1) for values in improvements]),
        (">least [%]", [fixed(_most(values, min), 1) for values in improvements]),
        (">of attainable [%]", [fixed(attained(scores)[1], 1) for scores in by_model]),
        (">Largest peak [°/h]", column(_most(s.true_max_dph for s in scores) for scores in by_model)),
        (">Scale-factor error, rms [ppm]", column(sf_rms, 2, 2)),
        (">largest [ppm]", column((_most(map(_sf_max_ppm, scores)) for scores in by_model), 2, 1)),
    ]
    filled = [(head, cells) for head, cells in columns if any(cell != fixed(None, 0) for cell in cells)]
    rows = [
        replace(named(model, *(cells[number] for _, cells in filled)), emphasis=model == chosen)
        for number, model in enumerate(models)
    ]
    caption = (
        "Models on held-out runs, means over the runs unless a head says otherwise. Shaded: the chosen one."
    )
    return [Table(["Model", *(head for head, _ in filled)], rows, caption)]


def run_matrix(models: Models, chosen: str) -> list[Block]:
    """Return the improvement of every model on every held-out run, under the attainable."""
    runs: dict[str, float | None] = {}
    for scores in models.values():
        for score in scores:
            if known(score.improvement_pct):
                runs.setdefault(score.run_id, score.oracle_pct)
    if len(runs) < 2:
        return []
    rows = []
    limits = list(runs.values())
    if any(known(value) for value in limits):
        rows.append(Row([Cell("attainable"), *(Cell(fixed(value, 1)) for value in (*limits, mean(limits)))]))
    for model, scores in models.items():
        by_run = {score.run_id: score.improvement_pct for score in scores}
        values = [by_run.get(run) for run in runs]
        if any(known(value) for value in values):
            cells = [fixed(value, 1) for value in (*values, mean(values))]
            rows.append(replace(named(model, *cells), emphasis=model == chosen))
    caption = "Improvement of bias stability on every held-out run, %."
    return [Table(["Model", *(f">{run}" for run in runs), ">Mean"], rows, caption)]


def judged(scores: Sequence[Scores]) -> Tone:
    """Return whether the chosen model makes things better on held-out runs."""
    improvement = mean(score.improvement_pct for score in scores)
    if improvement is not None:
        return "good" if improvement > 0.0 else "bad"
    raw, rms = mean(score.sf_raw_rms_ppm for score in scores), mean(map(sf_rms_ppm, scores))
    return "doubt" if raw is None or rms is None else "good" if rms < raw else "bad"


def sentence(study: Study) -> str:
    """Return what the chosen model does to the bias stability of held-out runs."""
    scores = study.scores[study.chosen]
    before, after = mean(s.raw_stability_dph for s in scores), mean(s.stability_dph for s in scores)
    who = f"Model {study.chosen} for unit {study.compensation.unit_id}"
    if before is None or after is None:
        return f"{who} was not judged on a held-out bias run."
    count = sum(known(score.stability_dph) for score in scores)
    runs = "one held-out run" if count == 1 else f"{count} held-out runs, mean"
    of_what = f"the bias stability (1σ of 100 s means; {runs})"
    if after < before:
        return f"{who} lowers {of_what} from {significant(before)} to {significant(after)} °/h."
    return f"{who} does not lower {of_what} ({significant(before)} before, {significant(after)} °/h after)."


def headlines(scores: Sequence[Scores], floor_dph: float | None) -> list[Headline]:
    """Return the chosen model's means over the held-out runs."""
    shown = []
    before, after = mean(s.raw_stability_dph for s in scores), mean(s.stability_dph for s in scores)
    if before is not None and after is not None:
        note = f"noise floor {significant(floor_dph)} °/h" if known(floor_dph) else "1σ of 100 s means"
        shown.append(Headline("Bias stability, mean", significant(after), "°/h", significant(before), note))
    improvement = mean(score.improvement_pct for score in scores)
    if improvement is not None:
        limit, share = attained(scores)
        note = "" if share is None else f"{fixed(share, 1)} % of the attainable {fixed(limit, 1)} %"
        shown.append(Headline("Improvement of bias stability", fixed(improvement, 1), "%", note=note))
    raw, rms = mean(s.sf_raw_rms_ppm for s in scores), mean(map(sf_rms_ppm, scores))
    if rms is not None:
        largest = _most(map(_sf_max_ppm, scores))
        note = "rms" if largest is None else f"rms; largest {significant(largest, 2)} ppm"
        before_text = "" if raw is None else significant(raw)
        shown.append(Headline("Scale-factor error, mean", significant(rms, 2), "ppm", before_text, note))
    return shown


def _most(values: Iterable[float | None], choose: Callable[..., float] = max) -> float | None:
    numbers = [value for value in values if value is not None and known(value)]
    return choose(numbers) if numbers else None
