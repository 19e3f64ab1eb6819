"""A fitted compensation for other machines: a C99 header for firmware, ONNX for the LSTM."""

from bench.analysis.export._c_header import c_header
from bench.analysis.export._c_program import CConstant, CProgram, c_programs
from bench.analysis.export._onnx import lstm_to_onnx

__all__ = ["CConstant", "CProgram", "c_header", "c_programs", "lstm_to_onnx"]
