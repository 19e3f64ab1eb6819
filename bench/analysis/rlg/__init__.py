"""Ring-laser gyro over temperature: ramp runs, candidate variables, stepwise regression, compensation."""

from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._cycle import AxisGain, CycleStudy, load_chamber_cycle, study_chamber_cycle
from bench.analysis.rlg._dataset import load_ramp_runs
from bench.analysis.rlg._profile import RampProfile, how_it_differs, hysteresis_dph, profile_of
from bench.analysis.rlg._rows import RampRun, ramp_run
from bench.analysis.rlg._study import BeforeAfter, RlgStudy, StepwiseVariant, judge, run_rlg_study
from bench.analysis.rlg._units import study_units
from bench.analysis.rlg._variables import CANDIDATES, FIVE_TERMS, candidate_matrix

__all__ = [
    "CANDIDATES",
    "FIVE_TERMS",
    "AxisGain",
    "BeforeAfter",
    "CycleStudy",
    "RampProfile",
    "RampRun",
    "RlgCompensation",
    "RlgStudy",
    "StepwiseVariant",
    "candidate_matrix",
    "how_it_differs",
    "hysteresis_dph",
    "judge",
    "load_chamber_cycle",
    "load_ramp_runs",
    "profile_of",
    "ramp_run",
    "run_rlg_study",
    "study_chamber_cycle",
    "study_units",
]
