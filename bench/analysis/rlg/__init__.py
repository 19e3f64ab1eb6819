"""Ring-laser gyro over temperature: ramp runs, candidate variables, stepwise regression, compensation."""

from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._cycle import CycleStudy, Spread, load_chamber_cycle, study_chamber_cycle
from bench.analysis.rlg._dataset import load_ramp_runs, study_units
from bench.analysis.rlg._judge import BeforeAfter
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._study import Judged, RlgStudy, StepwiseVariant
from bench.analysis.rlg._variables import CANDIDATES

__all__ = [
    "CANDIDATES",
    "BeforeAfter",
    "CycleStudy",
    "Judged",
    "RampRun",
    "RlgCompensation",
    "RlgStudy",
    "Spread",
    "StepwiseVariant",
    "load_chamber_cycle",
    "load_ramp_runs",
    "study_chamber_cycle",
    "study_units",
]
