"""Tables of models: their means over the held-out runs, and every run on its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from bench.present.report._content import ModelScore
from bench.present.report._numbers import column, fixed, known, mean
from bench.present.report._page import Block, Cell, Column, Row, Table, named, numbers, texts

Scores = Mapping[str, Sequence[ModelScore]]


def by_model(scores: Sequence[ModelScore]) -> dict[str, list[ModelScore]]:
    """Return the scores by model, the largest mean improvement first (then the smallest scale-factor error)."""
    groups: dict[str, list[ModelScore]] = {}
    for score in scores:
        groups.setdefault(score.model, []).append(score)

    def rank(item: tuple[str, list[ModelScore]]) -> tuple[float, float]:
        improvement = mean(score.improvement_percent for score in item[1])
        rms = mean(score.sf_rms_ppm for score in item[1])
        return (-improvement if improvement is not None else 1e9, rms if rms is not None else 1e9)

    return dict(sorted(groups.items(), key=rank))


def by_run(scores: Sequence[ModelScore]) -> dict[str, ModelScore]:
    """Return one model's scores by run."""
    return {score.run_id: score for score in scores}


def attained(scores: Sequence[ModelScore]) -> tuple[float | None, float | None]:
    """Return (mean attainable improvement, share of it attained), both in %, over the runs that know both."""
    both = [score for score in scores if known(score.improvement_percent) and known(score.attainable_percent)]
    limit, reached = mean(s.attainable_percent for s in both), mean(s.improvement_percent for s in both)
    if limit is None or reached is None or limit <= 0.0:
        return limit, None
    return limit, 100.0 * reached / limit


def model_table(models: Scores, chosen: str) -> list[Block]:
    """Return the models with their means over the held-out runs; columns that nobody fills are left out."""
    if not models:
        return []
    improvement = [mean(score.improvement_percent for score in scores) for scores in models.values()]
    columns = [
        ("Bias stability before [°/h]", column(_means(models, "stability_raw_dph"))),
        ("after [°/h]", column(_means(models, "stability_comp_dph"))),
        ("Improvement [%]", [fixed(value, 1) for value in improvement]),
        ("least [%]", [fixed(_least(scores), 1) for scores in models.values()]),
        ("of attainable [%]", [fixed(attained(scores)[1], 1) for scores in models.values()]),
        ("Largest peak [°/h]", column(_largest(models, "peak_dph"))),
        ("Scale-factor error, rms [ppm]", column(_means(models, "sf_rms_ppm"), 2, 2)),
        ("largest [ppm]", column(_largest(models, "sf_max_ppm"), 2, 1)),
    ]
    filled = [(head, cells) for head, cells in columns if any(cell != fixed(None, 0) for cell in cells)]
    rows = [
        replace(named(model, *(cells[number] for _, cells in filled)), emphasis=model == chosen)
        for number, model in enumerate(models)
    ]
    caption = (
        "Models on held-out runs, means over the runs unless a head says otherwise. Shaded: the chosen one."
    )
    return [Table(texts("Model") + numbers(*(head for head, _ in filled)), rows, caption)]


def run_matrix(models: Scores, chosen: str) -> list[Block]:
    """Return the improvement of every model on every held-out run, under the attainable."""
    runs: dict[str, ModelScore] = {}
    for scores in models.values():
        for score in scores:
            if known(score.improvement_percent):
                runs.setdefault(score.run_id, score)
    if len(runs) < 2:
        return []
    rows = []
    limits = [score.attainable_percent for score in runs.values()]
    if any(known(value) for value in limits):
        rows.append(Row([Cell("attainable"), *(Cell(fixed(value, 1)) for value in (*limits, mean(limits)))]))
    for model, scores in models.items():
        found = by_run(scores)
        values = [found[run].improvement_percent if run in found else None for run in runs]
        if any(known(value) for value in values):
            cells = [fixed(value, 1) for value in (*values, mean(values))]
            rows.append(replace(named(model, *cells), emphasis=model == chosen))
    heads = [Column(score.kind or score.run_id, number=True) for score in runs.values()]
    caption = "Improvement of bias stability on every held-out run, %."
    return [Table(texts("Model") + heads + numbers("Mean"), rows, caption)]


def _means(models: Scores, name: str) -> list[float | None]:
    return [mean(getattr(score, name) for score in scores) for scores in models.values()]


def _largest(models: Scores, name: str) -> list[float | None]:
    found = ([getattr(score, name) for score in scores] for scores in models.values())
    return [max((value for value in values if known(value)), default=None) for values in found]


def _least(scores: Sequence[ModelScore]) -> float | None:
    values = [score.improvement_percent for score in scores]
    return min((value for value in values if value is not None and known(value)), default=None)
