"""What is fitted at the end of a campaign, from its run folders."""

from __future__ import annotations

from pathlib import Path

from bench.analysis.common.fan_out import FanOut
from bench.analysis.thermal import Study, study_folders
from bench.campaign import Campaign


def study_of(campaign: Campaign, folders: dict[str, Path], *, fan: FanOut) -> Study:
    """Return the study of a campaign's run folders, by run name."""
    training, validation, tests = (
        [folders[run.name] for run in campaign.runs if run.role == role]
        for role in ("training", "validation", "test")
    )
    return study_folders(training, validation, tests, campaign.gyro or "", fan=fan)
