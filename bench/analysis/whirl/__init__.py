"""Whirl of a rotating INS: fitted from gyro data and rotation angle, taken out of the carrier's attitude."""

from bench.analysis.whirl._attitude import remove_slow, tilt_spectrum
from bench.analysis.whirl._compensation import WhirlCompensation
from bench.analysis.whirl._direct import Estimate
from bench.analysis.whirl._gauge import FREE_PART, MEANING, Gauge
from bench.analysis.whirl._runs import load_turns
from bench.analysis.whirl._study import (
    Judgement,
    WhirlStudy,
    integrated_residual,
    study_whirl,
    study_whirl_runs,
)

__all__ = [
    "FREE_PART",
    "MEANING",
    "Estimate",
    "Gauge",
    "Judgement",
    "WhirlCompensation",
    "WhirlStudy",
    "integrated_residual",
    "load_turns",
    "remove_slow",
    "study_whirl",
    "study_whirl_runs",
    "tilt_spectrum",
]
