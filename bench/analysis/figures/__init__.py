"""Figures of gyro test standards as plain functions: IEEE Std 647 (ring laser), 952 (fibre optic), GJB 2426A."""

from bench.analysis.figures._bias import BiasFigures
from bench.analysis.figures._from_run import (
    Figure,
    StandardFigures,
    figures_of_unit,
    figures_over_runs,
    standard_figures,
)
from bench.analysis.figures._scale_factor import ScaleFactorFigures

__all__ = [
    "BiasFigures",
    "Figure",
    "ScaleFactorFigures",
    "StandardFigures",
    "figures_of_unit",
    "figures_over_runs",
    "standard_figures",
]
