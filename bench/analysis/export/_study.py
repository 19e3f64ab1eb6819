"""A study's compensation and what is exported of it, as files."""

from __future__ import annotations

from pathlib import Path

from bench.analysis.common.state_file import save_file
from bench.analysis.export._c_header import c_header
from bench.analysis.export._onnx import lstm_to_onnx
from bench.analysis.thermal import Compensation, LstmModel, Study

NETWORK_FILE = "lstm.onnx"
"""Only there if the network was fitted."""


def export_study(study: Study, folder: Path) -> Path:
    """Write compensation.gyrocomp, compensation.h and, if fitted, lstm.onnx; return the compensation's path."""
    path = folder / "compensation.gyrocomp"
    study.compensation.save(path)
    save_file(folder / "compensation.h", c_header(Compensation.load(path)))
    network = study.models.get(LstmModel.name)
    if isinstance(network, LstmModel):
        save_file(folder / NETWORK_FILE, lstm_to_onnx(network))
    return path
