"""Begins a campaign or goes on with one: what can be refused is refused before anything is written."""

from __future__ import annotations

from pathlib import Path

from bench.campaign._file import Campaign, bench_of, load_campaign
from bench.campaign._folder import CampaignFolder
from bench.campaign._plan import check_limits
from bench.control.disk import check_disk, estimated_bytes
from bench.control.lease import take_lease
from bench.lab.emulated import Plant
from bench.record.benchfile import BenchFile
from drivers.base.errors import ConfigurationError


def begin_campaign(
    campaign_file: Path, file: BenchFile, out: Path, *, plant: Plant | None = None, ask: bool = False
) -> CampaignFolder:
    """Begin a campaign on the bench, or with `plant` on emulated labs; nothing has moved yet.

    Refused: a demand beyond the limits, a disk without room, a bench in use, a folder that is not empty.
    """
    campaign = load_campaign(campaign_file, file)
    bench = bench_of(campaign, file)
    check_limits(campaign, bench)
    check_disk(estimated_bytes(campaign.expected_duration_s(), bench), out, "the campaign", "--out")
    if plant is None:
        take_lease(bench, f"campaign {campaign.title}").release()  # only to see that the bench is free
    return CampaignFolder.create(out, campaign_file, campaign, file, plant, ask)


def resume_campaign(path: Path) -> CampaignFolder:
    """Open a campaign that was begun, to go on with it; refused if the disk has no room for the runs left."""
    folder = CampaignFolder(path)
    open_runs = [state.run for state in folder.states() if state.state == "open"]
    left_s = sum(run.test.expected_duration_s(run.values) for run in open_runs)
    needed = estimated_bytes(left_s, bench_of(folder.campaign, folder.file))
    check_disk(needed, path, "what is left of the campaign", "--out of a new campaign")
    return folder


def campaign_to_rehearse(campaign_file: Path, file: BenchFile, out: Path) -> tuple[Campaign, Path]:
    """Return a campaign and the folder in `out` for its runs; refused beyond limits, over runs, without room."""
    campaign = load_campaign(campaign_file, file)
    check_limits(campaign, bench_of(campaign, file))
    runs_folder = out / "runs"
    if runs_folder.exists() and any(runs_folder.iterdir()):
        raise ConfigurationError(
            "the folder already holds runs",
            where=str(runs_folder),
            expected="a new or empty folder: runs are never overwritten",
            remedy="name another one with --out, or remove this one",
        )
    check_disk(estimated_bytes(campaign.expected_duration_s(), file), out, "the campaign", "--out")
    return campaign, runs_folder
