"""Thermal drift: features, scale factor, compensation models and their evaluation."""

from bench.analysis.thermal._batch_study import BatchStudy, study_batch
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._evaluate import Scores
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._study import Study, load_runs, study_folders
from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper, ThermalModel, ThermalRun

__all__ = [
    "BatchStudy",
    "Compensation",
    "FeatureRun",
    "LstmModel",
    "Prediction",
    "Scores",
    "Stepper",
    "Study",
    "ThermalModel",
    "ThermalRun",
    "load_runs",
    "prepare",
    "study_batch",
    "study_folders",
]
