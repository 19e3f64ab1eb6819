"""Whirl of a rotating INS: fitted from gyro data and rotation angle, taken out of the carrier's attitude."""

from bench.analysis.whirl._angle import align_angle
from bench.analysis.whirl._attitude import (
    carrier_tilt,
    oscillation,
    remove_slow,
    tilt_spectrum,
    uncompensated,
    unit_attitude,
)
from bench.analysis.whirl._compensation import WhirlCompensation, WhirlStream
from bench.analysis.whirl._direct import DirectFit, Estimate, fit_direct
from bench.analysis.whirl._gauge import FREE_PART, MEANING, Gauge
from bench.analysis.whirl._integral import body_lines, fit_integral, match_coefficients
from bench.analysis.whirl._lines import choose_lines, scan_lines
from bench.analysis.whirl._residual import heading_from_body_rate
from bench.analysis.whirl._runs import Turns, load_turns
from bench.analysis.whirl._study import Judgement, WhirlStudy, integrated_residual, judge, study_whirl
from bench.analysis.whirl._types import Finding, NotObservable, TurnRecord, UnfitRotation

__all__ = [
    "FREE_PART",
    "MEANING",
    "DirectFit",
    "Estimate",
    "Finding",
    "Gauge",
    "Judgement",
    "NotObservable",
    "TurnRecord",
    "Turns",
    "UnfitRotation",
    "WhirlCompensation",
    "WhirlStream",
    "WhirlStudy",
    "align_angle",
    "body_lines",
    "carrier_tilt",
    "choose_lines",
    "fit_direct",
    "fit_integral",
    "heading_from_body_rate",
    "integrated_residual",
    "judge",
    "load_turns",
    "match_coefficients",
    "oscillation",
    "remove_slow",
    "scan_lines",
    "study_whirl",
    "tilt_spectrum",
    "uncompensated",
    "unit_attitude",
]
