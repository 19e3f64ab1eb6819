"""The hand-written ONNX file against the ONNX checker and onnxruntime, which share no code with the writer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bench.analysis.export._onnx import lstm_to_onnx
from bench.analysis.thermal import FeatureRun, ThermalRun, prepare
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._lstm import LstmModel
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.fixture(scope="module")
def model(compensations: Callable[[str], Compensation]) -> LstmModel:
    model = compensations("lstm").model
    assert isinstance(model, LstmModel)
    return model


@pytest.fixture(scope="module")
def run(test_run: ThermalRun) -> FeatureRun:
    return prepare(test_run)


def features(run: FeatureRun, warm_up: int) -> Array:
    rows = np.column_stack([run.t_in, run.dt_60, run.gradient])
    return np.concatenate([np.repeat(rows[:1], warm_up, axis=0), rows])[:, None].astype(np.float32)


def session(model: LstmModel) -> object:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(lstm_to_onnx(model), options, providers=["CPUExecutionProvider"])


def test_checker_accepts_it_and_infers_the_declared_shapes(model: LstmModel) -> None:
    loaded = onnx.load_from_string(lstm_to_onnx(model))
    onnx.checker.check_model(loaded, full_check=True)
    assert [(node.op_type) for node in loaded.graph.node].count("LSTM") == 1
    assert (loaded.ir_version, loaded.opset_import[0].version) == (7, 14)
    properties = {item.key: item.value for item in loaded.metadata_props}
    assert properties["warm_up"] == "180"
    shape = loaded.graph.output[0].type.tensor_type.shape.dim
    assert shape[0].dim_param == "steps" and [d.dim_value for d in shape][1:] == [1, 2]


def test_onnxruntime_gives_what_the_model_gives(model: LstmModel, run: FeatureRun) -> None:
    zero = np.zeros((1, 1, 24), dtype=np.float32)
    drift, _, _ = session(model).run(None, {"features": features(run, 180), "h0": zero, "c0": zero})
    expected = model.predict(run)
    assert np.abs(drift[180:, 0, 0] - expected.bias_dph).max() < 1e-6
    assert np.abs(drift[180:, 0, 1] - expected.sf_error_ppm).max() < 1e-3


def test_state_carried_from_call_to_call_is_the_whole_sequence(model: LstmModel, run: FeatureRun) -> None:
    runtime, inputs = session(model), features(run, 180)
    zero = np.zeros((1, 1, 24), dtype=np.float32)
    whole = runtime.run(None, {"features": inputs, "h0": zero, "c0": zero})
    h, c, parts = zero, zero, []
    for part in (inputs[:180], inputs[180:181], inputs[181:400], inputs[400:]):
        drift, h, c = runtime.run(None, {"features": part, "h0": h, "c0": c})
        parts.append(drift)
    np.testing.assert_allclose(np.concatenate(parts)[..., 0], whole[0][..., 0], atol=2e-7)
    np.testing.assert_allclose(h, whole[1], atol=1e-6)


def test_large_dimension_takes_more_than_one_varint_byte() -> None:
    """300 is AC 02 in the encoding guide of protocol buffers."""
    from bench.analysis.export._onnx import _varint

    assert _varint(300) == bytes([0xAC, 0x02]) and _varint(0) == b"\0" and _varint(127) == b"\x7f"


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_a_weight_that_is_no_float_is_not_exported(model: LstmModel, value: float) -> None:
    state = model.to_state()
    weights = {name: array.copy() for name, array in state["weights"].items()}
    weights["w_output"][1, 3] = value
    with pytest.raises(ConfigurationError, match=r"ONNX export.*w_output"):
        lstm_to_onnx(LstmModel.from_state({**state, "weights": weights}))
