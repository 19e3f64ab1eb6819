"""Figures of gyro test standards as plain functions: IEEE Std 647 (ring laser), 952 (fibre optic), GJB 2426A."""

from bench.analysis.figures._bias import (
    BiasFigures,
    averaged_stability,
    bias_figures,
    repeatability,
    temperature_sensitivity,
    warm_up_time_s,
)
from bench.analysis.figures._from_run import (
    Figure,
    StandardFigures,
    figures_of_unit,
    figures_over_runs,
    standard_figures,
)
from bench.analysis.figures._scale_factor import (
    ScaleFactorFigures,
    ScaleFactorFit,
    fit_rate_sequence,
    relative_repeatability_ppm,
    scale_factor_figures,
    scale_factor_sensitivity_ppm_per_k,
)
from bench.analysis.figures._small_rates import RateStep, input_axis_misalignment, resolution, threshold

__all__ = [
    "BiasFigures",
    "Figure",
    "RateStep",
    "ScaleFactorFigures",
    "ScaleFactorFit",
    "StandardFigures",
    "averaged_stability",
    "bias_figures",
    "figures_of_unit",
    "figures_over_runs",
    "fit_rate_sequence",
    "input_axis_misalignment",
    "relative_repeatability_ppm",
    "repeatability",
    "resolution",
    "scale_factor_figures",
    "scale_factor_sensitivity_ppm_per_k",
    "standard_figures",
    "temperature_sensitivity",
    "threshold",
    "warm_up_time_s",
]
