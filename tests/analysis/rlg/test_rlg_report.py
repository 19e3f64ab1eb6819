"""The regression's report shows what the study found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bench.analysis.rlg import RampRun
from bench.analysis.rlg._study import run_rlg_study
from bench.present.report import render_page, stepwise_page

Runs = Callable[[int], dict[str, RampRun]]


def test_every_step_the_equation_and_the_held_out_figures_are_there(runs: Runs) -> None:
    of = runs(0)
    study = run_rlg_study([of["train"]], [of["reverse"], of["partial"]])
    page = render_page(
        stepwise_page(study, created_utc="2026-01-02T03:04:05.000+00:00", warnings=["<b>odd</b>"])
    )
    assert "&lt;b&gt;odd&lt;/b&gt;" in page and "<b>odd" not in page
    for variant in study.variants:
        assert page.count(variant.name) >= 3
        for row in variant.judged:
            assert f"{row.before_dph:.5f}" in page and f"{row.after_dph:.5f}" in page
            assert f"{row.improvement_pct:.1f}" in page and f"{row.hysteresis_after_dph:.5f}" in page
    assert "Other direction" in page and "Part of the range" in page
    for step in study.variants[0].result.steps[1:]:
        assert f"{'+' if step.action == 'enter' else '−'} {step.term}" in page
    assert "Significance F" in page and "Durbin-Watson" in page and page.count("<svg") >= 2
    assert "x11 = T1-T2" in page
    # plain and corrected tests of every variable stand side by side
    tests = page.split("Tests of the variables")[-1].split("<table")[1].split("</table>")[0]
    assert all(tests.count(f">{name}<") == 1 for name in study.variants[0].result.names)
    inside = sum(len(variant.result.selected) for variant in study.variants[:2])
    assert tests.count(">in<") == inside and tests.count(">out<") == 22 - inside


def test_a_study_without_held_out_runs_says_so_and_names_what_was_left_out(runs: Runs) -> None:
    base = runs(0)["train"]
    dead = replace(base, case_rate=np.zeros_like(base.case_rate), remarks=("9 rows left out: why",))
    page = render_page(stepwise_page(run_rlg_study([dead], []), created_utc="2026-01-02T03:04:05.000+00:00"))
    assert "Not judged" in page and "dT1 left out" in page and "9 rows left out: why" in page
