"""The hand-written ONNX file against the ONNX checker and onnxruntime, which share no code with the writer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.export._c_header import c_header
from bench.analysis.export._onnx import _varint, lstm_to_onnx
from bench.analysis.thermal import FeatureRun, ThermalRun, prepare
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._stream import Limits
from bench.analysis.thermal._width import PredictionWidth
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from tests.analysis.export.test_c_header import MAIN, build, needs_compiler

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.fixture(scope="module")
def network(compensations: Callable[[str], Compensation]) -> Compensation:
    return compensations("lstm")


@pytest.fixture(scope="module")
def run(test_run: ThermalRun) -> FeatureRun:
    return prepare(test_run)


def features(run: FeatureRun, warm_up: int) -> Array:
    rows = np.column_stack([run.t_in, run.t_out, run.dt_60, run.gradient])
    return np.concatenate([np.repeat(rows[:1], warm_up, axis=0), rows])[:, None].astype(np.float32)


def session(network: Compensation) -> object:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(lstm_to_onnx(network), options, providers=["CPUExecutionProvider"])


def test_checker_accepts_it_and_infers_the_declared_shapes(network: Compensation) -> None:
    loaded = onnx.load_from_string(lstm_to_onnx(network))
    onnx.checker.check_model(loaded, full_check=True)
    assert [(node.op_type) for node in loaded.graph.node].count("LSTM") == 1
    assert (loaded.ir_version, loaded.opset_import[0].version) == (7, 14)
    properties = {item.key: item.value for item in loaded.metadata_props}
    assert properties["warm_up"] == "180"
    shape = loaded.graph.output[0].type.tensor_type.shape.dim
    assert shape[0].dim_param == "steps" and [d.dim_value for d in shape][1:] == [1, 2]


def test_onnxruntime_gives_what_the_model_gives(network: Compensation, run: FeatureRun) -> None:
    zero = np.zeros((1, 1, 24), dtype=np.float32)
    drift, _, _ = session(network).run(None, {"features": features(run, 180), "h0": zero, "c0": zero})
    expected = network.model.predict(run)
    assert np.abs(drift[180:, 0, 0] - expected.bias_dph).max() < 1e-6
    assert np.abs(drift[180:, 0, 1] - expected.sf_error_ppm).max() < 1e-3


def test_state_carried_from_call_to_call_is_the_whole_sequence(
    network: Compensation, run: FeatureRun
) -> None:
    runtime, inputs = session(network), features(run, 180)
    zero = np.zeros((1, 1, 24), dtype=np.float32)
    whole = runtime.run(None, {"features": inputs, "h0": zero, "c0": zero})
    h, c, parts = zero, zero, []
    for part in (inputs[:180], inputs[180:181], inputs[181:400], inputs[400:]):
        drift, h, c = runtime.run(None, {"features": part, "h0": h, "c0": c})
        parts.append(drift)
    np.testing.assert_allclose(np.concatenate(parts)[..., 0], whole[0][..., 0], atol=2e-7)
    np.testing.assert_allclose(h, whole[1], atol=1e-6)


@needs_compiler
@pytest.mark.parametrize("name", ["lstm", "lstm_of_case"])
def test_the_interval_is_that_of_the_stream_and_of_the_c(
    compensations: Callable[[str], Compensation], test_run: ThermalRun, tmp_path: Path, name: str
) -> None:
    """Narrow limits, so that much of the run is beyond them, below and above; both sensors matter."""
    fitted = compensations(name)
    width = PredictionWidth(np.array([[0.01, 0.02, 0.003], [1.0, 0.5, 0.1]]), 5)
    narrow = {"t_in": (-20.0, 20.0), "t_out": (-30.0, 24.0), "dt_60": (-1.0, 0.5), "gradient": (-5.0, 2.0)}
    wide_open = Limits(narrow, (-1e3, 1e3), (-1e6, 1e6), 600.0)
    compensation = replace(fitted, width=width, limits=wide_open)
    seconds = np.column_stack([test_run.time_s, test_run.gyro_temp_c, test_run.case_temp_c])
    stream = compensation.stream(compensation.unit_id)
    streamed = [stream.push(*row, 0.0) for row in seconds.tolist()][::10]
    ours = np.array([[s.bias_dph, s.sf_error_ppm, s.bias_half_dph, s.sf_half_ppm] for s in streamed])

    n, warm_up = fitted.model.settings.hidden, 180
    inputs = features(prepare(test_run), warm_up)
    zero = np.zeros((1, 1, n), dtype=np.float32)
    runtime = session(compensation)
    drift, half = runtime.run(["drift", "half_width"], {"features": inputs, "h0": zero, "c0": zero})
    np.testing.assert_allclose(drift[warm_up:, 0], ours[:, :2], atol=2e-3)
    np.testing.assert_allclose(half[warm_up:, 0], ours[:, 2:], rtol=2e-5)
    assert half[warm_up:, 0, 0].max() > 5.0 * half[warm_up:, 0, 0].min()

    text = MAIN.replace('"%.9g %.9g %.17g %u\\n", r.bias_dph, r.sf_error_ppm, gyrocomp_rate_dps(&r, f), r.flags',
                        '"%.9g %.9g\\n", r.bias_half_dph, r.sf_half_ppm')  # fmt: skip
    compiled = build(tmp_path, c_header(compensation), text)
    theirs = compiled.run(np.column_stack([seconds, np.zeros((len(seconds), 2))]))[::10]
    np.testing.assert_allclose(half[warm_up:, 0], theirs, rtol=2e-5)


def test_without_an_interval_the_file_says_why(network: Compensation) -> None:
    loaded = onnx.load_from_string(lstm_to_onnx(network))
    assert [value.name for value in loaded.graph.output] == ["drift", "h1", "c1"]
    told = {item.key: item.value for item in loaded.metadata_props}
    assert told["interval"].startswith("none: ") and told["inputs"] == "t_in,dt_60,gradient"
    assert (told["model"], told["unit_id"]) == ("lstm", "unit A")


def test_only_a_network_has_an_onnx_form(compensations: Callable[[str], Compensation]) -> None:
    with pytest.raises(ConfigurationError, match=r"'poly3' has no ONNX form.*C header"):
        lstm_to_onnx(compensations("poly3"))


def test_large_dimension_takes_more_than_one_varint_byte() -> None:
    """300 is AC 02 in the encoding guide of protocol buffers."""
    assert _varint(300) == bytes([0xAC, 0x02]) and _varint(0) == b"\0" and _varint(127) == b"\x7f"


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_a_weight_that_is_no_float_is_not_exported(network: Compensation, value: float) -> None:
    state = network.model.to_state()
    weights = {name: array.copy() for name, array in state["weights"].items()}
    weights["w_output"][1, 3] = value
    with pytest.raises(ConfigurationError, match=r"ONNX export.*w_output"):
        lstm_to_onnx(replace(network, model=LstmModel.from_state({**state, "weights": weights})))
