"""Heading effect of a space-stable platform INS: extraction, temperature, models, compensation in real time."""

from bench.analysis.heading._compensation import HeadingCompensation
from bench.analysis.heading._compensator import HeadingCompensator, PositionCorrector
from bench.analysis.heading._files import (
    checksum_of_log,
    load_log,
    site_of_run,
    study_heading_logs,
    unit_of_log,
)
from bench.analysis.heading._lagged import Form, LaggedModel, regressors
from bench.analysis.heading._log import PlatformLog, stays
from bench.analysis.heading._modulus import ModulusTest
from bench.analysis.heading._nine import NineCoefficients, integrate
from bench.analysis.heading._second import SecondChoice
from bench.analysis.heading._settling import Settling
from bench.analysis.heading._study import HeadingStudy, Judgement, judge, study_heading, without_start
from bench.analysis.heading._temperature import fit_reference

__all__ = [
    "Form",
    "HeadingCompensation",
    "HeadingCompensator",
    "HeadingStudy",
    "Judgement",
    "LaggedModel",
    "ModulusTest",
    "NineCoefficients",
    "PlatformLog",
    "PositionCorrector",
    "SecondChoice",
    "Settling",
    "checksum_of_log",
    "fit_reference",
    "integrate",
    "judge",
    "load_log",
    "regressors",
    "site_of_run",
    "stays",
    "study_heading",
    "study_heading_logs",
    "unit_of_log",
    "without_start",
]
