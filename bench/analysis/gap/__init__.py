"""Where simulation and bench part, which effect is missing, and how much of the gap closes once it is in."""

from bench.analysis.gap._batch import Batch, BatchEffect, diagnose_batch
from bench.analysis.gap._channels import ChannelFinding
from bench.analysis.gap._describe import UnknownPart
from bench.analysis.gap._designs import Design, designs_for, key_of, other_equipment
from bench.analysis.gap._diagnose import Diagnosis, closed_model, diagnose
from bench.analysis.gap._effect_facts import effect_facts
from bench.analysis.gap._exam_folder import hold_exam, read_exam
from bench.analysis.gap._facts import (
    batch_facts,
    diagnosis_facts,
    foretold_facts,
    identifiable_facts,
    log_gap_facts,
)
from bench.analysis.gap._fast import FastFinding
from bench.analysis.gap._fast_lines import FastLine
from bench.analysis.gap._findings import Cause, Finding, Place, Shrinkage
from bench.analysis.gap._foretell import ForetoldSigmas, foretell
from bench.analysis.gap._identify import Identifiable, identifiable
from bench.analysis.gap._learn import Learned
from bench.analysis.gap._missing import write_missing_fmu
from bench.analysis.gap._model_file import Model, Term, model_text, parse_model, read_model
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._outlook import UNKNOWN, Choice, Outlook, information_gained, outlook
from bench.analysis.gap._position import PositionFinding
from bench.analysis.gap._rate import RateFinding
from bench.analysis.gap._recordings import Recordings, read_batch, read_recordings
from bench.analysis.gap._rehearsal import LogCurve, LogGap, LogGaps, log_gaps
from bench.analysis.gap._score import Exam, Marked
from bench.analysis.gap._series import Difference, differences, write_missing
from bench.analysis.gap._simulation import Simulation, take_own
from bench.analysis.gap._suggest import Suggestion, suggest

__all__ = [
    "UNKNOWN",
    "Batch",
    "BatchEffect",
    "Cause",
    "ChannelFinding",
    "Choice",
    "Design",
    "Diagnosis",
    "Difference",
    "Exam",
    "FastFinding",
    "FastLine",
    "Finding",
    "ForetoldSigmas",
    "Identifiable",
    "Learned",
    "LogCurve",
    "LogGap",
    "LogGaps",
    "Marked",
    "Model",
    "Noise",
    "Outlook",
    "Place",
    "PositionFinding",
    "RateFinding",
    "Recordings",
    "Shrinkage",
    "Simulation",
    "Suggestion",
    "Term",
    "UnknownPart",
    "batch_facts",
    "closed_model",
    "designs_for",
    "diagnose",
    "diagnose_batch",
    "diagnosis_facts",
    "differences",
    "effect_facts",
    "foretell",
    "foretold_facts",
    "hold_exam",
    "identifiable",
    "identifiable_facts",
    "information_gained",
    "key_of",
    "log_gap_facts",
    "log_gaps",
    "model_text",
    "other_equipment",
    "outlook",
    "parse_model",
    "read_batch",
    "read_exam",
    "read_model",
    "read_recordings",
    "suggest",
    "take_own",
    "write_missing",
    "write_missing_fmu",
]
