"""Campaigns: many runs on one bench from one file - planned, run, resumed, rehearsed. See docs/campaign.md."""

from bench.campaign._file import Campaign, Notice, bench_of, load_campaign
from bench.campaign._folder import HUNT_FILE, CampaignFolder
from bench.campaign._plan import PlannedRun, campaign_to_rehearse, check_limits, not_measured, plan_campaign
from bench.campaign._rehearse import rehearse_campaign
from bench.campaign._run import CampaignEnding, CampaignRunner, begin_campaign, resume_campaign

__all__ = [
    "HUNT_FILE",
    "Campaign",
    "CampaignEnding",
    "CampaignFolder",
    "CampaignRunner",
    "Notice",
    "PlannedRun",
    "begin_campaign",
    "bench_of",
    "campaign_to_rehearse",
    "check_limits",
    "load_campaign",
    "not_measured",
    "plan_campaign",
    "rehearse_campaign",
    "resume_campaign",
]
