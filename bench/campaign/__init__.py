"""Campaigns: many runs on one bench from one file - planned, run, resumed, rehearsed. See docs/campaign.md."""

from bench.campaign._file import (
    Campaign,
    CampaignRun,
    Notice,
    PreparedAnswer,
    Unit,
    bench_of,
    load_campaign,
)
from bench.campaign._folder import CampaignFolder, RunState
from bench.campaign._places import EmulatedPlace, Place, RealPlace
from bench.campaign._plan import (
    PlannedRun,
    PlannedStep,
    check_limits,
    not_measured,
    plan_campaign,
)
from bench.campaign._rehearse import rehearse_campaign
from bench.campaign._run import CampaignEnding, CampaignRunner

__all__ = [
    "Campaign",
    "CampaignEnding",
    "CampaignFolder",
    "CampaignRun",
    "CampaignRunner",
    "EmulatedPlace",
    "Notice",
    "Place",
    "PlannedRun",
    "PlannedStep",
    "PreparedAnswer",
    "RealPlace",
    "RunState",
    "Unit",
    "bench_of",
    "check_limits",
    "load_campaign",
    "not_measured",
    "plan_campaign",
    "rehearse_campaign",
]
