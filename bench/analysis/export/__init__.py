"""A fitted compensation for other machines: a C99 header for firmware, ONNX for the LSTM."""

from bench.analysis.export._c_header import c_header
from bench.analysis.export._c_program import CConstant, CProgram, c_programs
from bench.analysis.export._onnx import lstm_to_onnx
from bench.analysis.export._study import NETWORK_FILE, export_study

__all__ = ["NETWORK_FILE", "CConstant", "CProgram", "c_header", "c_programs", "export_study", "lstm_to_onnx"]
