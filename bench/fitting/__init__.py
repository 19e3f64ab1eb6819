"""Fits: features, scale factor, compensation models, their evaluation, Allan deviation, stepwise regression."""

from bench.fitting._alignment import find_shift
from bench.fitting._allan import AllanDeviation, allan_deviation
from bench.fitting._allan_confidence import confidence_interval, degrees_of_freedom, noise_exponents
from bench.fitting._allan_noise import NOISE_NAMES, NOISE_UNITS, NoiseCoefficients, NoiseFit, fit_noise
from bench.fitting._anchor import anchor_runs
from bench.fitting._compensation import Compensation, Corrected, TrainingRun, UnitMismatch
from bench.fitting._dataset import load_thermal_runs, run_checksum
from bench.fitting._evaluate import Scores, bias_stability, block_means, evaluate, noise_floor
from bench.fitting._features import centred_mean, change_per_minute, prepare, trailing_mean
from bench.fitting._grey_box import GREY_BOX_TERMS, GreyBoxModel, GreyBoxParameters
from bench.fitting._hybrid import HybridModel
from bench.fitting._linear_models import (
    STEPWISE_TERMS,
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from bench.fitting._lstm import FitError, LstmModel, LstmSettings
from bench.fitting._registry import model_names, new_model, restore_model
from bench.fitting._scale_factor import (
    RateRun,
    ScaleFactorGroup,
    fit_scale_factor,
    rate_weights,
    scale_factor_group,
)
from bench.fitting._selection import ModelScore, choose, fit_models, score_models
from bench.fitting._stepwise import StepwiseResult, StepwiseStep, cochrane_orcutt_rho, stepwise
from bench.fitting._stream import CompensationStream, CorrectedSample, Flag, Limits
from bench.fitting._study import Study, load_runs, run_study
from bench.fitting._types import FeatureRun, Prediction, Stepper, ThermalModel, ThermalRun

__all__ = [
    "GREY_BOX_TERMS",
    "NOISE_NAMES",
    "NOISE_UNITS",
    "STEPWISE_TERMS",
    "AllanDeviation",
    "Compensation",
    "CompensationStream",
    "Corrected",
    "CorrectedSample",
    "CubicModel",
    "FeatureRun",
    "FitError",
    "Flag",
    "GreyBoxModel",
    "GreyBoxParameters",
    "HybridModel",
    "LaggedRidgeModel",
    "Limits",
    "LstmModel",
    "LstmSettings",
    "ModelScore",
    "MultilinearModel",
    "NoiseCoefficients",
    "NoiseFit",
    "Prediction",
    "RateRun",
    "ScaleFactorGroup",
    "Scores",
    "Stepper",
    "StepwiseModel",
    "StepwiseResult",
    "StepwiseStep",
    "Study",
    "ThermalModel",
    "ThermalRun",
    "TrainingRun",
    "UnitMismatch",
    "allan_deviation",
    "anchor_runs",
    "bias_stability",
    "block_means",
    "centred_mean",
    "change_per_minute",
    "choose",
    "cochrane_orcutt_rho",
    "confidence_interval",
    "degrees_of_freedom",
    "evaluate",
    "find_shift",
    "fit_models",
    "fit_noise",
    "fit_scale_factor",
    "load_runs",
    "load_thermal_runs",
    "model_names",
    "new_model",
    "noise_exponents",
    "noise_floor",
    "prepare",
    "rate_weights",
    "restore_model",
    "run_checksum",
    "run_study",
    "scale_factor_group",
    "score_models",
    "stepwise",
    "trailing_mean",
]
