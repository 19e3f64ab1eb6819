"""Heading effect of a space-stable platform INS: extraction, temperature, models, compensation in real time."""

from bench.analysis.heading._checks import Finding
from bench.analysis.heading._compensation import HeadingCompensation
from bench.analysis.heading._compensator import Compensated, HeadingCompensator, PositionCorrector
from bench.analysis.heading._files import (
    checksum_of_log,
    load_log,
    site_of_run,
    study_heading_logs,
    unit_of_log,
)
from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import Form, LaggedModel, fit_lagged, regressors
from bench.analysis.heading._log import PlatformLog, Site, stays
from bench.analysis.heading._nine import NineCoefficients, compensate_nine, fit_nine, integrate
from bench.analysis.heading._study import HeadingStudy, Judgement, judge, study_heading, without_start
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference

__all__ = [
    "Compensated",
    "Finding",
    "Form",
    "HeadingCompensation",
    "HeadingCompensator",
    "HeadingStudy",
    "Judgement",
    "LaggedModel",
    "NineCoefficients",
    "PlatformLog",
    "PositionCorrector",
    "ReferenceTemperature",
    "Site",
    "checksum_of_log",
    "compensate_nine",
    "fit_lagged",
    "fit_nine",
    "fit_reference",
    "integrate",
    "judge",
    "load_log",
    "position_error",
    "regressors",
    "site_of_run",
    "stays",
    "study_heading",
    "study_heading_logs",
    "unit_of_log",
    "without_start",
]
