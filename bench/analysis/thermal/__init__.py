"""Thermal drift: features, scale factor, compensation models and their evaluation."""

from bench.analysis.thermal._alignment import find_shift
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._compensation import Compensation, Corrected, TrainingRun
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.analysis.thermal._evaluate import Scores, evaluate, noise_floor
from bench.analysis.thermal._features import centred_mean, change_per_minute, prepare, trailing_mean
from bench.analysis.thermal._grey_box import GREY_BOX_TERMS, GreyBoxModel, GreyBoxParameters
from bench.analysis.thermal._hybrid import HybridModel
from bench.analysis.thermal._linear_models import (
    STEPWISE_TERMS,
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import FitError, LstmSettings
from bench.analysis.thermal._registry import model_names, new_model, restore_model
from bench.analysis.thermal._scale_factor import (
    RateRun,
    ScaleFactorGroup,
    fit_scale_factor,
    rate_weights,
    scale_factor_group,
)
from bench.analysis.thermal._selection import ModelScore, choose, fit_models, score_models
from bench.analysis.thermal._stream import CompensationStream, CorrectedSample, Flag, Limits
from bench.analysis.thermal._study import Study, load_runs, run_study
from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper, ThermalModel, ThermalRun

__all__ = [
    "GREY_BOX_TERMS",
    "STEPWISE_TERMS",
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
    "Prediction",
    "RateRun",
    "ScaleFactorGroup",
    "Scores",
    "Stepper",
    "StepwiseModel",
    "Study",
    "ThermalModel",
    "ThermalRun",
    "TrainingRun",
    "anchor_runs",
    "centred_mean",
    "change_per_minute",
    "choose",
    "evaluate",
    "find_shift",
    "fit_models",
    "fit_scale_factor",
    "load_runs",
    "load_thermal_runs",
    "model_names",
    "new_model",
    "noise_floor",
    "prepare",
    "rate_weights",
    "restore_model",
    "run_study",
    "scale_factor_group",
    "score_models",
    "trailing_mean",
]
