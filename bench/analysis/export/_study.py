"""A study's compensation and what is exported of it, as files."""

from __future__ import annotations

from pathlib import Path

from bench.analysis.common.state_file import save_file
from bench.analysis.export._c_header import c_header
from bench.analysis.export._onnx import lstm_to_onnx
from bench.analysis.thermal import Compensation, Study

NETWORK_FILE = "lstm.onnx"
"""Only there if a network was fitted: the best of them."""


def export_study(study: Study, folder: Path) -> Path:
    """Write compensation.gyrocomp, compensation.h and, if fitted, lstm.onnx; return the compensation's path."""
    path = export_compensation(study.compensation, folder)
    if study.network is not None:
        save_file(folder / NETWORK_FILE, lstm_to_onnx(study.network))
    return path


def export_compensation(compensation: Compensation, folder: Path) -> Path:
    """Write compensation.gyrocomp and compensation.h; return the compensation's path."""
    path = folder / "compensation.gyrocomp"
    compensation.save(path)
    save_file(folder / "compensation.h", c_header(Compensation.load(path)))
    return path
