"""Thermal drift: features, scale factor, compensation models and their evaluation."""

from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.analysis.thermal._evaluate import Scores, evaluate
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import FitError, LstmSettings
from bench.analysis.thermal._registry import model_names, new_model
from bench.analysis.thermal._stream import CompensationStream, Flag, Limits
from bench.analysis.thermal._study import Study, load_runs, run_study
from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper, ThermalModel, ThermalRun

__all__ = [
    "Compensation",
    "CompensationStream",
    "FeatureRun",
    "FitError",
    "Flag",
    "LaggedRidgeModel",
    "Limits",
    "LstmModel",
    "LstmSettings",
    "Prediction",
    "Scores",
    "Stepper",
    "Study",
    "ThermalModel",
    "ThermalRun",
    "evaluate",
    "load_runs",
    "load_thermal_runs",
    "model_names",
    "new_model",
    "prepare",
    "run_study",
]
