"""Where simulation and bench part, which effect is missing, and how much of the gap closes once it is in."""

from bench.analysis.gap._causes import Cause
from bench.analysis.gap._cells import BANDS
from bench.analysis.gap._channel_cells import ChannelPlace, channel_bands
from bench.analysis.gap._channel_data import ChannelSeries, load_channels
from bench.analysis.gap._channel_shrinkage import ChannelShrinkage
from bench.analysis.gap._channels import (
    ChannelCause,
    ChannelCurve,
    ChannelDiagnosis,
    diagnose_channels,
    scatter_sentence,
    with_channels,
)
from bench.analysis.gap._close import Shrinkage, closed_model, shrinkage
from bench.analysis.gap._data import GapRun, Group, check_runs, group_runs
from bench.analysis.gap._describe import UnknownPart
from bench.analysis.gap._diagnose import Diagnosis, diagnose
from bench.analysis.gap._exam import Answer, Closed, Sealed, close, examined, make_case, nominal_model
from bench.analysis.gap._examination import case_kinds, examine
from bench.analysis.gap._fit import Floor
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._model_file import (
    ChannelTerm,
    DisturbanceTerm,
    Model,
    Term,
    model_text,
    parse_model,
    read_model,
)
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._platform import (
    HeadingPlace,
    PlatformDiagnosis,
    PlatformShrinkage,
    diagnose_platform,
    is_platform_run,
    load_platform_run,
    platform_closed,
)
from bench.analysis.gap._platform_rehearsal import heading_log_gaps
from bench.analysis.gap._rehearsal import LogCurve, LogGap, channel_log_gaps, log_gaps
from bench.analysis.gap._run_folder import load_gap_runs
from bench.analysis.gap._score import Line, Marked, Reliability, reliability, shrinkage_quantiles, table
from bench.analysis.gap._series import Difference, differences
from bench.analysis.gap._suggest import Suggestion, suggest
from bench.analysis.gap._where import SIGNIFICANT, PhasePlace, Place, RegimePlace

__all__ = [
    "BANDS",
    "SIGNIFICANT",
    "Answer",
    "Cause",
    "ChannelCause",
    "ChannelCurve",
    "ChannelDiagnosis",
    "ChannelPlace",
    "ChannelSeries",
    "ChannelShrinkage",
    "ChannelTerm",
    "Closed",
    "Diagnosis",
    "Difference",
    "DisturbanceTerm",
    "Floor",
    "GapRun",
    "Group",
    "HeadingPlace",
    "Line",
    "LogCurve",
    "LogGap",
    "Marked",
    "Model",
    "Noise",
    "PhasePlace",
    "Place",
    "PlatformDiagnosis",
    "PlatformShrinkage",
    "RegimePlace",
    "Reliability",
    "Sealed",
    "Shrinkage",
    "Suggestion",
    "Term",
    "UnknownPart",
    "case_kinds",
    "channel_bands",
    "channel_log_gaps",
    "check_runs",
    "close",
    "closed_model",
    "diagnose",
    "diagnose_channels",
    "diagnose_platform",
    "differences",
    "examine",
    "examined",
    "group_runs",
    "heading_log_gaps",
    "is_platform_run",
    "load_channels",
    "load_gap_runs",
    "load_platform_run",
    "log_gaps",
    "make_case",
    "model_text",
    "nominal_model",
    "parse_model",
    "platform_closed",
    "read_mapped_runs",
    "read_model",
    "reliability",
    "scatter_sentence",
    "shrinkage",
    "shrinkage_quantiles",
    "suggest",
    "table",
    "with_channels",
]
