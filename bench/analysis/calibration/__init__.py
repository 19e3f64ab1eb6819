"""System-level calibration of an IMU: error model, observability, schedules, their covariance and search."""

from bench.analysis.calibration._by_hand import HandCalibration, HandRecord, calibrate_by_hand
from bench.analysis.calibration._calibrate import Calibration, calibrate, load_record
from bench.analysis.calibration._compensation import ImuCompensation
from bench.analysis.calibration._conventions import (
    DPH_RAD_S,
    PARAMETER_NAMES,
    PARAMETERS,
    STATE_NAMES,
    STATE_UNITS,
    UNIT_SIZE,
    Noise,
    Site,
    Task,
)
from bench.analysis.calibration._estimator import BiasWander, Estimate
from bench.analysis.calibration._further import after
from bench.analysis.calibration._hand_record import load_hand_record
from bench.analysis.calibration._inflation import Inflation
from bench.analysis.calibration._record_noise import RecordNoise
from bench.analysis.calibration._result import Evaluation, evaluate, missed_targets
from bench.analysis.calibration._runs import CalibrationRun, load_calibration_run
from bench.analysis.calibration._schedule import (
    Schedule,
    home_attitude,
    home_text,
    load_scheme,
    moves_text,
    scheme_file,
)
from bench.analysis.calibration._search import Effort, search
from bench.analysis.calibration._table import TABLES, Table
from bench.analysis.calibration._turning import (
    TableAxis,
    TurningPlan,
    plan_turns,
    require_closed,
    table_axes,
    table_type,
)

__all__ = [
    "DPH_RAD_S",
    "PARAMETERS",
    "PARAMETER_NAMES",
    "STATE_NAMES",
    "STATE_UNITS",
    "TABLES",
    "UNIT_SIZE",
    "BiasWander",
    "Calibration",
    "CalibrationRun",
    "Effort",
    "Estimate",
    "Evaluation",
    "HandCalibration",
    "HandRecord",
    "ImuCompensation",
    "Inflation",
    "Noise",
    "RecordNoise",
    "Schedule",
    "Site",
    "Table",
    "TableAxis",
    "Task",
    "TurningPlan",
    "after",
    "calibrate",
    "calibrate_by_hand",
    "evaluate",
    "home_attitude",
    "home_text",
    "load_calibration_run",
    "load_hand_record",
    "load_record",
    "load_scheme",
    "missed_targets",
    "moves_text",
    "plan_turns",
    "require_closed",
    "scheme_file",
    "search",
    "table_axes",
    "table_type",
]
