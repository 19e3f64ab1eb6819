"""Plants for examining the diagnosis: physics that is not the catalogue's, drawn by seed."""

from simulators.exam._campaign import LATITUDE_DEG, RunTruth, heat_flow, simulate_campaign
from simulators.exam._case import (
    KINDS,
    SF_SIGMA_PPM,
    SHEET,
    SLOPE_SIGMA_DPH,
    ExamCase,
    draw_case,
    outputs_dph,
    read_temperature,
    signal_dph,
)
from simulators.exam._physics import KNOWN, UNKNOWN

__all__ = [
    "KINDS",
    "KNOWN",
    "LATITUDE_DEG",
    "SF_SIGMA_PPM",
    "SHEET",
    "SLOPE_SIGMA_DPH",
    "UNKNOWN",
    "ExamCase",
    "RunTruth",
    "draw_case",
    "heat_flow",
    "outputs_dph",
    "read_temperature",
    "signal_dph",
    "simulate_campaign",
]
