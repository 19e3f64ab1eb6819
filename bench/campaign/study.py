"""What is fitted at the end of a campaign, from its run folders."""

from __future__ import annotations

from pathlib import Path

from bench.analysis.common.fan_out import FanOut
from bench.analysis.thermal import Study, load_runs, run_study
from bench.campaign import Campaign


def study_of(campaign: Campaign, folders: dict[str, Path], *, fan: FanOut) -> Study:
    """Return the study of a campaign's run folders, by run name."""
    gyro = campaign.gyro or ""
    training, validation, tests = (
        load_runs(
            [folders[run.name] for run in campaign.runs if run.role == role],
            gyro,
            allow_invalid=role == "test",
        )
        for role in ("training", "validation", "test")
    )
    return run_study(training, validation, tests, fan=fan)
