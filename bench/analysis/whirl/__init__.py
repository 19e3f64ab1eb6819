"""Whirl of a rotating INS: fitted from gyro data and rotation angle, taken out of the carrier's attitude."""

from bench.analysis.whirl._angle import Alignment, align_angle, interpolated_angle
from bench.analysis.whirl._attitude import (
    Oscillation,
    carrier_tilt,
    oscillation,
    remove_slow,
    tilt_spectrum,
    uncompensated,
    unit_attitude,
)
from bench.analysis.whirl._checks import (
    alignment_findings,
    earth_rate_findings,
    require_fit_for_whirl,
    rotation_findings,
)
from bench.analysis.whirl._compensation import WhirlCompensation, WhirlStream
from bench.analysis.whirl._direct import DEFAULT_LINES, DirectFit, Estimate, drift_separation, fit_direct
from bench.analysis.whirl._gauge import FREE_PART, MEANING, Gauge, gauge_tilt
from bench.analysis.whirl._integral import (
    FourierFit,
    body_lines,
    fit_integral,
    match_coefficients,
    nominal_angle,
)
from bench.analysis.whirl._kinematics import (
    body_tilt,
    body_to_rotating,
    body_to_true,
    harmonic_matrix,
    rotation,
    rotation_vector,
    whirl_rate,
)
from bench.analysis.whirl._lines import CANDIDATES, Line, choose_lines, patent_order, scan_lines
from bench.analysis.whirl._residual import (
    heading_from_body_rate,
    make_blocks,
    residual_increments,
    slack,
)
from bench.analysis.whirl._runs import Turns, load_turns
from bench.analysis.whirl._study import Judgement, WhirlStudy, integrated_residual, judge, study_whirl
from bench.analysis.whirl._types import Finding, NotObservable, TurnRecord, UnfitRotation

__all__ = [
    "CANDIDATES",
    "DEFAULT_LINES",
    "FREE_PART",
    "MEANING",
    "Alignment",
    "DirectFit",
    "Estimate",
    "Finding",
    "FourierFit",
    "Gauge",
    "Judgement",
    "Line",
    "NotObservable",
    "Oscillation",
    "TurnRecord",
    "Turns",
    "UnfitRotation",
    "WhirlCompensation",
    "WhirlStream",
    "WhirlStudy",
    "align_angle",
    "alignment_findings",
    "body_lines",
    "body_tilt",
    "body_to_rotating",
    "body_to_true",
    "carrier_tilt",
    "choose_lines",
    "drift_separation",
    "earth_rate_findings",
    "fit_direct",
    "fit_integral",
    "gauge_tilt",
    "harmonic_matrix",
    "heading_from_body_rate",
    "integrated_residual",
    "interpolated_angle",
    "judge",
    "load_turns",
    "make_blocks",
    "match_coefficients",
    "nominal_angle",
    "oscillation",
    "patent_order",
    "remove_slow",
    "require_fit_for_whirl",
    "residual_increments",
    "rotation",
    "rotation_findings",
    "rotation_vector",
    "scan_lines",
    "slack",
    "study_whirl",
    "tilt_spectrum",
    "uncompensated",
    "unit_attitude",
    "whirl_rate",
]
