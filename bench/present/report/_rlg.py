"""The report of a ring laser's study: what to expect, bias before and after, every step, statistics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.common.statistics import attained
from bench.present.report import _parts as parts
from bench.present.report._figures import Curve, Lane, lanes, panels
from bench.present.report._numbers import DASH, fixed, moment, significant
from bench.present.report._page import (
    Block,
    Cell,
    Fact,
    Facts,
    Figures,
    Headline,
    Page,
    Row,
    Section,
    Table,
    Verdict,
    named,
)
from bench.present.report._palette import BLUE, MUTED, ORANGE
from bench.present.report._rlg_expected import choice_sentence, expected_blocks, expected_sentence
from bench.present.report._rlg_judged import judged_blocks
from bench.present.report._rlg_units import over_temperature
from bench.present.report._tables import checksum_table

if TYPE_CHECKING:
    from bench.analysis.rlg import Judged, RampRun, RlgStudy, StepwiseVariant

_PAPER_PCT = 65.0
_TINIEST = 1e-300
"""A probability below this is printed as this."""
_TERMS = [
    ("Stability", "Sample standard deviation of 100 s means of the bias over the whole run, 1σ, °/h."),
    (
        "Differs by",
        "How a run differs from those fitted, by its own case temperatures: direction of the first ramp, rate, "
        "range; another day if by none of them.",
    ),
    ("F, p", "F test of the term that moved; p holds if residuals of neighbouring rows are independent."),
    ("Five terms", "The paper's equation: T1, dT1, T1·dT1, dT1² and T1 − T2, all of them in."),
    (
        "Stepwise, corrected",
        "A lag-1 correlation of the residuals is taken off the rows first (Cochrane and Orcutt); without it "
        "smooth terms that mean nothing are kept far more often than p says.",
    ),
    ("Significance F", "Probability of so large an F of the whole regression if no term had any effect."),
    (
        "Effective rows",
        "n (1 − ρ)/(1 + ρ), what the rows are worth with the lag-1 correlation ρ of their residuals.",
    ),
    (
        "Attained",
        "Improvement as a part of what subtracting the true drift would give (emulated units only).",
    ),
]


def stepwise_page(
    study: RlgStudy, *, created_utc: str, bench_name: str = "", warnings: Sequence[str] = ()
) -> Page:
    """Return the report of a study."""
    best = study.chosen
    remarks = [f"Run {run.run_id}: {text}" for run in (*study.training, *study.tests) for text in run.remarks]
    return Page(
        title=f"Bias of {study.unit_id} over temperature",
        kind="Stepwise regression report",
        facts=[
            Fact("Unit under test", study.unit_id),
            Fact("Bench", bench_name or DASH),
            Fact("Fitted on", ", ".join(run.run_id for run in study.training)),
            Fact("Judged on", ", ".join(run.run_id for run in study.tests) or DASH),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=_verdict(study, best),
        sections=[
            parts.warnings([*warnings, *remarks]),
            Section("Bias before and after", judged_blocks(study)),
            Section("What to expect", expected_blocks(study)),
            Section("Output over temperature", _over_temperature(study)),
            Section("Held-out runs", [_course(n, run, best) for n, run in enumerate(study.tests, start=1)]),
            Section("Final equations", [_statistics(study), *_equations(study)]),
            Section("Tests of the variables", [*_left_out(study), _tests(study)]),
            *(Section(f"Steps: {variant.name}", [_steps(variant)]) for variant in study.variants[:2]),
            Section(
                "Provenance",
                checksum_table(
                    {run.run_id: run.checksum for run in (*study.training, *study.tests) if run.checksum},
                    "Checksums of the runs.",
                ),
            ),
        ],
        terms=_TERMS,
        colophon=parts.OF_RUNS,
    )


def _verdict(study: RlgStudy, best: Judged) -> Verdict:
    if not best.judged:
        return Verdict(
            "Not judged",
            "doubt",
            [
                "No run was held out: R² says how well the equation describes the runs it was made of, no more.",
                choice_sentence(study),
                expected_sentence(study),
            ],
            [Headline("R²", fixed(study.equation.result.final.r2, 4))],
        )
    mean = best.mean_improvement_pct
    worst = min(best.judged, key=lambda row: row.improvement_pct)
    good = mean >= _PAPER_PCT
    share = attained(best.judged)[1]
    runs = "one run" if len(best.judged) == 1 else f"{len(best.judged)} runs"
    sentences = [
        f"On {runs} that had no part in the fit, {best.name} improves the stability of 100 s "
        f"means by {mean:.1f} % in the mean; the worst is {worst.run_id} with {worst.improvement_pct:.1f} %.",
        choice_sentence(study),
        expected_sentence(study),
    ]
    headlines = [
        Headline("mean improvement", fixed(mean, 1), "%"),
    ]
    if study.promise is not None:
        low, high = fixed(study.promise.low_pct, 0), fixed(study.promise.high_pct, 0)
        headlines.append(Headline("promised", f"{low} to {high}", "%"))
    if share is not None:
        headlines.append(Headline("of what is possible", fixed(share, 1), "%"))
    return Verdict("Improved" if good else "Below 65 %", "good" if good else "doubt", sentences, headlines)


def _over_temperature(study: RlgStudy) -> list[Block]:
    runs = [(run, "held out") for run in study.tests] or [(run, "fitted") for run in study.training]
    plots = [over_temperature(run.run_id, note, run, study.chosen) for run, note in runs]
    caption = "Bias from its mean over the case temperature, before and after what was taken."
    keys, label = parts.BEFORE_AFTER, "Case temperature, °C"
    return [panels("over-temperature", plots, caption, keys, x_label=label, y_label="Bias, °/h")]


def _course(number: int, run: RampRun, best: Judged) -> Figures:
    hours = run.time_s / 3600.0
    left = run.bias_dph - best.compensation.drift_dph(run)
    plots = [
        Lane(
            "Temperature, °C",
            [Curve("case", hours, run.case_c, ORANGE), Curve("block", hours, run.block_c, BLUE)],
            height=90.0,
        ),
        Lane(
            "Rate, °C/min",
            [Curve("case", hours, run.case_rate, ORANGE), Curve("block", hours, run.block_rate, BLUE)],
            height=70.0,
        ),
        Lane("Gradient, °C", [Curve("T1 − T2", hours, run.case_c - run.block_c, BLUE)], height=70.0),
        parts.before_after(
            "Bias from its mean, °/h", hours, run.bias_dph - run.bias_dph.mean(), left - left.mean()
        ),
    ]
    caption = f"Run {run.run_id}: temperatures, their rates and gradient, bias before and after {best.name}."
    smooth = best.compensation.smooth
    if smooth is not None and smooth.runs > 1:
        width = best.compensation.half_width_dph(run)
        bounds = [
            Curve(label, hours, sign * width, MUTED, "--", 0.9) for label, sign in (("95 %", 1.0), ("", -1.0))
        ]
        plots.append(Lane("Left, °/h", [*bounds, Curve("after", hours, left, BLUE)], height=110.0))
        caption += " Last: what is left with the offset of this power-on, in the interval told for it."
    return lanes(f"held-out-{number}", plots, "Time, h", caption)


def _statistics(study: RlgStudy) -> Table:
    heads = ["Figure", *(f">{variant.name}" for variant in study.variants)]
    figures: list[tuple[str, list[float]]] = [
        ("Terms", [len(v.result.selected) for v in study.variants]),
        ("Rows", [v.result.n for v in study.variants]),
        ("Multiple R", [v.result.multiple_r for v in study.variants]),
        ("R²", [v.result.final.r2 for v in study.variants]),
        ("Adjusted R²", [v.result.adjusted_r2 for v in study.variants]),
        ("RMSE, °/h", [v.result.final.rmse for v in study.variants]),
        ("F", [v.result.f for v in study.variants]),
        ("Significance F", [max(v.result.significance_f, _TINIEST) for v in study.variants]),
        ("Correlation taken off", [v.result.whitening_rho for v in study.variants]),
        ("Lag-1 correlation of residuals", [v.result.lag1_correlation for v in study.variants]),
        ("Durbin-Watson", [v.result.durbin_watson for v in study.variants]),
        ("Effective rows", [v.result.effective_n for v in study.variants]),
    ]
    rows = [Row([Cell(name)] + [Cell(_figure(value)) for value in values]) for name, values in figures]
    return Table(
        heads, rows, "Statistics on the training runs; of the corrected regression, on its whitened rows."
    )


def _equations(study: RlgStudy) -> list[Block]:
    blocks: list[Block] = []
    for variant in study.variants:
        final, names = variant.result.final, variant.result.names
        rows = [named("1", significant(final.intercept, 6), *[DASH] * 4)]
        for index in np.flatnonzero(final.included):
            error = final.standard_error[index]
            rows.append(
                named(
                    names[index],
                    significant(float(final.coefficient[index]), 6),
                    significant(float(error), 3),
                    significant(float(final.coefficient[index] / error) ** 2, 4),
                    _figure(float(final.p_value[index])),
                    fixed(float(variant.result.vif[index]), 1),
                )
            )
        heads = ["Term", ">Coefficient", ">Standard error", ">F", ">p", ">VIF"]
        blocks += [
            Facts([Fact(variant.name, variant.compensation.equation(), code=True)]),
            Table(heads, rows, f"{variant.name}: coefficients in °/h per unit of the term (°C, °C/min)."),
        ]
    return blocks


def _steps(variant: StepwiseVariant) -> Table:
    rows = []
    for number, step in enumerate(variant.result.steps):
        inside = [name for name, used in zip(variant.result.names, step.included, strict=True) if used]
        moved = {"start": "start", "enter": f"+ {step.term}", "remove": f"− {step.term}"}[step.action]
        cells = [
            str(number),
            moved,
            _figure(step.f),
            _figure(step.p),
            fixed(step.r2, 6),
            significant(step.rmse, 4),
        ]
        rows.append(Row([*map(Cell, cells), Cell(", ".join(inside) or DASH)]))
    heads = [">Step", "Moved", ">F", ">p", ">R²", ">RMSE [°/h]", "Terms in"]
    return Table(heads, rows, f"Every step of {variant.name}.")


def _tests(study: RlgStudy) -> Table:
    """F and p of every variable, plain and corrected side by side; of one that is out, if it were added."""
    plain, corrected = study.variants[:2]
    rows = []
    for number, name in enumerate(plain.result.names):
        cells = []
        for variant in (plain, corrected):
            final = variant.result.final
            inside = bool(final.included[number])
            error = float(final.standard_error[number])
            f = (float(final.coefficient[number]) / error) ** 2 if error > 0.0 else math.nan
            cells += [Cell("in" if inside else "out", strong=inside), Cell(_figure(f))]
            cells.append(Cell(_figure(float(final.p_value[number]))))
        rows.append(named(name, *cells))
    heads = ["Variable", plain.name, ">F", ">p", corrected.name, ">F", ">p"]
    caption = (
        "The plain tests take the rows for independent; the corrected ones take off the lag-1 correlation first. "
        "F and p of a variable that is out are what it would have if added alone."
    )
    return Table(heads, rows, caption)


def _left_out(study: RlgStudy) -> list[Block]:
    from bench.analysis.rlg import CANDIDATES  # scipy behind it takes longer to import than all reports

    names = study.variants[0].result.names
    numbers = {name: f"x{number}" for number, name in enumerate(CANDIDATES, start=1)}
    offered = ", ".join(f"{numbers[name]} = {name}" if name in numbers else name for name in names)
    facts = [Fact("Offered", offered)]
    facts += [Fact(f"{name} left out", why) for name, why in study.left_out]
    return [Facts(facts)]


def _figure(value: float) -> str:
    if value == _TINIEST:
        return f"< {significant(value, 1)}"
    if isinstance(value, int) or (math.isfinite(value) and value == round(value) and abs(value) < 1e6):
        return str(round(value))
    return significant(value, 4)
