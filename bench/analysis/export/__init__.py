"""A fitted compensation for other machines: a C99 header for firmware, ONNX for the LSTM."""

from bench.analysis.export._study import NETWORK_FILE, export_compensation, export_study

__all__ = ["NETWORK_FILE", "export_compensation", "export_study"]
