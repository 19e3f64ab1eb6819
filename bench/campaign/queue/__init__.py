"""What a bench is to do next: orders in a file of the runs folder, each started once, as a process of its own."""

from bench.campaign.queue._file import (
    CampaignOrder,
    Ended,
    Hold,
    HuntOrder,
    Item,
    Order,
    QueueState,
    ResumeOrder,
    RunOrder,
)
from bench.campaign.queue._presets import Preset, Presets
from bench.campaign.queue._work import BenchQueue

__all__ = [
    "BenchQueue",
    "CampaignOrder",
    "Ended",
    "Hold",
    "HuntOrder",
    "Item",
    "Order",
    "Preset",
    "Presets",
    "QueueState",
    "ResumeOrder",
    "RunOrder",
]
