"""Heading effect of a space-stable platform INS: extraction, temperature, models, compensation in real
time."""

from bench.analysis.heading._calibration import Priors
from bench.analysis.heading._checks import Finding, check_log, check_phase, phase_offset_deg, refuse_unsound
from bench.analysis.heading._compensation import HeadingCompensation
from bench.analysis.heading._compensator import Compensated, HeadingCompensator, PositionCorrector
from bench.analysis.heading._files import (
    COLUMNS,
    Site,
    checksum_of_log,
    load_log,
    site_of_run,
    unit_of_log,
)
from bench.analysis.heading._frames import (
    earth_rotation_deg,
    gravitation_latitude_deg,
    position_error,
    position_error_finite,
    position_rows,
    sidereal_rad,
)
from bench.analysis.heading._lagged import Evidence, Form, LaggedModel, fit_lagged, regressors
from bench.analysis.heading._log import PlatformLog, Stay, log_from_positions, settled, stays
from bench.analysis.heading._logs import study_heading_logs
from bench.analysis.heading._nine import (
    HeadingPoint,
    NineCoefficients,
    compensate_nine,
    fit_nine,
    integrate,
    solve_nine,
)
from bench.analysis.heading._study import (
    DriftCourse,
    HeadingStudy,
    Judgement,
    judge,
    study_heading,
    without_start,
)
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference, fourier_terms, lagged
from bench.analysis.heading._window import MovingWindow, WindowEstimate, extract

__all__ = [
    "COLUMNS",
    "Compensated",
    "DriftCourse",
    "Evidence",
    "Finding",
    "Form",
    "HeadingCompensation",
    "HeadingCompensator",
    "HeadingPoint",
    "HeadingStudy",
    "Judgement",
    "LaggedModel",
    "MovingWindow",
    "NineCoefficients",
    "PlatformLog",
    "PositionCorrector",
    "Priors",
    "ReferenceTemperature",
    "Site",
    "Stay",
    "WindowEstimate",
    "check_log",
    "check_phase",
    "checksum_of_log",
    "compensate_nine",
    "earth_rotation_deg",
    "extract",
    "fit_lagged",
    "fit_nine",
    "fit_reference",
    "fourier_terms",
    "gravitation_latitude_deg",
    "integrate",
    "judge",
    "lagged",
    "load_log",
    "log_from_positions",
    "phase_offset_deg",
    "position_error",
    "position_error_finite",
    "position_rows",
    "refuse_unsound",
    "regressors",
    "settled",
    "sidereal_rad",
    "site_of_run",
    "solve_nine",
    "stays",
    "study_heading",
    "study_heading_logs",
    "unit_of_log",
    "without_start",
]
