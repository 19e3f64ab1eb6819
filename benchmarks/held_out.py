"""Accuracy on held-out profiles, through the emulated bench: fit on four bias runs and three scale-factor groups,
choose on one of each, judge on seven other profiles and five other groups.

    python -m benchmarks.held_out [FOLDER]

An existing FOLDER with the runs is fitted again without rehearsing.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from bench.analysis.common.fan_out import fan_out
from bench.analysis.common.statistics import attained
from bench.analysis.thermal import Study
from bench.campaign import load_campaign, rehearse_campaign
from bench.campaign.study import study_of
from bench.lab.emulated import Plant
from bench.present.report import outside_sentence
from bench.record.benchfile import load_bench_file
from drivers.base.clock import host_seconds

ROOT = Path(__file__).parent
TARGETS = {"chosen": 97.0, "hybrid": 95.0}


def run(folder: Path) -> Study:
    """Rehearse what is missing and fit; runs stay in `folder`."""
    file = load_bench_file(ROOT.parent / "examples" / "demo.toml")
    campaign = load_campaign(ROOT / "held_out_campaign.toml", file)
    jobs = len(os.sched_getaffinity(0))
    runs = folder / "runs"
    if not runs.exists():
        started = host_seconds()
        results = rehearse_campaign(campaign, file, Plant(), runs, jobs=jobs)
        bench_s = sum(result.duration_s for result in results.values())
        wall_s = host_seconds() - started
        hours, speed = bench_s / 3600.0, bench_s / wall_s
        print(f"{len(results)} runs, {hours:.0f} h of bench time in {wall_s:.0f} s ({speed:,.0f} x)")
    with fan_out(jobs) as fan:
        return study_of(campaign, {entry.name: runs / entry.name for entry in campaign.runs}, fan=fan)


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("held-out")
    study = run(folder)
    bias = [run.run_id for run in study.tests if run.bias_dph is not None]
    groups = [run.run_id for run in study.tests if run.sf_error_ppm is not None]
    print("\nImprovement of bias stability in % (and of what subtracting the true drift gives)\n")
    print("| model | " + " | ".join(bias) + " | mean | of attainable |")
    print("|---|" + "---|" * (len(bias) + 2))
    for score in study.selection:
        rows = {row.run_id: row for row in study.scores[score.name]}
        values = [rows[name].improvement_pct or 0.0 for name in bias]
        share = attained([rows[name] for name in bias])[1] or 0.0
        cells = " | ".join(f"{value:.1f}" for value in values)
        print(f"| {score.name} | {cells} | {sum(values) / len(values):.1f} | {share:.1f} |")
    oracle = {row.run_id: row.oracle_pct or 0.0 for row in study.scores[study.chosen]}
    cells = " | ".join(f"{oracle[name]:.1f}" for name in bias)
    print(f"| true drift | {cells} | {sum(oracle[name] for name in bias) / len(bias):.1f} | 100.0 |")
    print("\nScale-factor error against the truth, ppm rms (largest)\n")
    print("| model | " + " | ".join(groups) + " |")
    print("|---|" + "---|" * len(groups))
    for score in study.selection:
        rows = {row.run_id: row for row in study.scores[score.name]}
        cells = " | ".join(f"{rows[n].sf_true_rms_ppm:.2f} ({rows[n].sf_true_max_ppm:.1f})" for n in groups)
        print(f"| {score.name} | {cells} |")
    for row in study.scores[study.chosen]:
        if text := outside_sentence(row):
            print(text)
    print(f"\nchosen on the validation runs: {study.chosen}")


if __name__ == "__main__":
    main()
