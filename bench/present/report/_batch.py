"""A batch of units with a common model over temperature: who was in it, what each unit's own runs decide, the
judgement."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.present.report import _parts as parts
from bench.present.report._numbers import DASH, fixed, known, moment, significant
from bench.present.report._page import Cell, Fact, Headline, Page, Row, Section, Table, Verdict

if TYPE_CHECKING:
    from bench.analysis.thermal import BatchStudy, Scores

TARGETS = {"bias_dph": "bias", "sf_error_ppm": "scale factor"}


def batch_page(study: BatchStudy, *, created_utc: str) -> Page:
    """Return the page of a batch."""
    chosen = study.scores[study.chosen]
    sentences = [
        f"{study.chosen} is common to {len(study.units)} units; each has its own coefficients beside it."
    ]
    sentences += [batch_sentence(study, target) for target in chosen]
    return Page(
        title="Cold shock of a batch of units",
        kind="Batch compensation report",
        facts=[
            Fact("Units", ", ".join(study.units)),
            Fact("Common model", study.chosen),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=Verdict(
            "Judged" if study.tests else "Not judged",
            "good" if study.tests else "doubt",
            sentences,
            [
                Headline(
                    f"{TARGETS[target]} left with one own run",
                    fixed(100.0 * left.with_one, 1),
                    "%",
                    fixed(100.0 * left.without, 1),
                )
                for target, left in chosen.items()
            ],
        ),
        sections=[
            Section("Choice of the common model", [_choice(study)]),
            Section("Units", [_units(study)]),
            Section("Test runs", [_tests(study)] if study.tests else []),
        ],
        colophon=parts.OF_RUNS,
    )


def batch_sentence(study: BatchStudy, target: str) -> str:
    """Return what the chosen model leaves of units left out, and whether one run of their own helps."""
    left = study.scores[study.chosen][target]
    helps = "" if left.with_one < left.without else "; a run of the unit's own does not help"
    return (
        f"Of the {TARGETS[target]} drift of units left out it leaves {100.0 * left.without:.1f} % without a run "
        f"of their own and {100.0 * left.with_one:.1f} % with one{helps}."
    )


def _choice(study: BatchStudy) -> Table:
    rows = [
        Row(
            [Cell(name, strong=name == study.chosen)]
            + [
                Cell(fixed(100.0 * value, 1))
                for left in scores.values()
                for value in (left.without, left.with_one)
            ],
            emphasis=name == study.chosen,
        )
        for name, scores in study.scores.items()
    ]
    heads = ["Model"]
    for target in study.scores[study.chosen]:
        heads += [f">{TARGETS[target].capitalize()}, no own run [%]", ">one own run [%]"]
    caption = (
        "What is left over what was there, root mean squares, noise included, over the runs of every unit in "
        "turn, which took no part in the common model."
    )
    return Table(heads, rows, caption)


def _units(study: BatchStudy) -> Table:
    rows = []
    for unit, runs in study.units.items():
        cells = [Cell(unit, strong=True)]
        for target in TARGETS:
            count = sum(getattr(run, target) is not None for run in runs)
            cells += [Cell(str(count)), Cell(fixed(study.determined[unit].get(target), 1))]
        rows.append(Row(cells))
    heads = ["Unit", ">Bias runs", ">numbers decided", ">Scale-factor groups", ">numbers decided"]
    caption = (
        "Own runs of each unit, and how many numbers of its correction they decide; the batch decides the rest. "
        "The compensation of a unit without runs is compensation.gyrocomp beside this page."
    )
    return Table(heads, rows, caption)


def _tests(study: BatchStudy) -> Table:
    rows = []
    for run, score in zip(study.tests, study.judged, strict=True):
        own = run.unit_id if run.unit_id in study.compensations else "common"
        rows.append(Row([Cell(run.run_id), Cell(run.unit_id), Cell(own), *map(Cell, _figures(score))]))
    heads = ["Run", "Unit", "Compensation", ">1σ before [°/h]", ">after [°/h]", ">Less by [%]"]
    heads += [">Attainable [%]", ">SF before [ppm]", ">after [ppm]"]
    caption = (
        "Stability of 100 s means, and rms of the scale-factor error, on runs that took no part in the fit."
    )
    return Table(heads, rows, caption)


def _figures(score: Scores) -> list[str]:
    percent = [score.improvement_pct, score.oracle_pct if known(score.oracle_pct) else score.attainable_pct]
    return [
        *(
            significant(value) if known(value) else DASH
            for value in (score.raw_stability_dph, score.stability_dph)
        ),
        *(fixed(value, 1) if known(value) else DASH for value in percent),
        *(significant(value) if known(value) else DASH for value in (score.sf_raw_rms_ppm, score.sf_rms_ppm)),
    ]
