"""The LSTM as an ONNX file, written with no ONNX package: the protobuf wire format by hand.

Sources: protocol buffers wire format (varint and length-delimited fields); onnx.proto3 of ONNX IR version 7
for the field numbers; operator LSTM-14 for gate order (i, o, f, c) and shapes. The graph takes all four features
in physical units, those included that only the prediction interval needs. It keeps the state outside (h0, c0 in;
h1, c1 out) and leaves the sequence length free, so the same file runs a whole run or one step at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._stream import FEATURES, Limits
from bench.analysis.thermal._width import LEAST_RANGE, LEVEL, PER_EXCESS, TERMS, PredictionWidth
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

IR_VERSION = 7
OPSET = 14
_FLOAT, _INT64 = 1, 7
_ATTRIBUTE_INT = 2
_VARINT, _BYTES = 0, 2


def lstm_to_onnx(compensation: Compensation) -> bytes:
    """Return the network of a compensation as ONNX bytes.

    Inputs `features` (steps, 1, 4) in the order t_in degC, t_out degC, dt_60 degC/min, gradient degC, of which
    the network takes its own; `h0`, `c0` (1, 1, hidden). Outputs `drift` (steps, 1, 2) in deg/h and ppm; `h1`,
    `c1`; and, if the compensation has prediction intervals, `half_width` (steps, 1, 2) in deg/h and ppm, as a
    stream of it gives them. Start with h0 = c0 = 0 and feed the first sample `warm_up` times
    (in the metadata) before the run.
    ConfigurationError for a model that is no fitted network, and for a weight that is no number.
    """
    model = compensation.model
    if not isinstance(model, LstmModel):
        raise ConfigurationError(
            f"the model {model.name!r} has no ONNX form",
            where="ONNX export",
            found=f"a compensation of unit {compensation.unit_id} by {model.name}",
            expected="one by a network, lstm",
            remedy="take the C header, which every model has",
        )
    weights, n, seen = model.weights, model.weights.hidden, model.settings.inputs
    w_input, w_hidden, bias = (
        _reordered(rows, n) for rows in (weights.w_input, weights.w_hidden, weights.bias)
    )
    initialisers: dict[str, Array | NDArray[np.int64]] = {
        "seen": np.array([FEATURES.index(name) for name in seen]),
        "input_low": weights.input_low,
        "input_slope": 2.0 / (weights.input_high - weights.input_low),
        "one": np.ones(1),
        "W": w_input[None],
        "R": w_hidden[None],
        "B": np.concatenate([bias, np.zeros(4 * n)])[None],
        "w_output": weights.w_output.T,
        "b_output": weights.b_output,
        "target_scale": weights.target_scale,
        "target_mid": weights.target_mid,
    }
    nodes = [
        _node("Gather", ["features", "seen"], ["inputs"], {"axis": 2}),
        _node("Sub", ["inputs", "input_low"], ["shifted"]),
        _node("Mul", ["shifted", "input_slope"], ["stretched"]),
        _node("Sub", ["stretched", "one"], ["normalised"]),
        _node("LSTM", ["normalised", "W", "R", "B", "", "h0", "c0"], ["y", "h1", "c1"], {"hidden_size": n}),
        _node("Squeeze", ["y", "direction_axis"], ["hidden"]),
        _node("MatMul", ["hidden", "w_output"], ["projected"]),
        _node("Add", ["projected", "b_output"], ["outputs"]),
        _node("Mul", ["outputs", "target_scale"], ["scaled"]),
        _node("Add", ["scaled", "target_mid"], ["drift"]),
    ]
    inputs = [_value("features", "steps", 1, len(FEATURES)), _value("h0", 1, 1, n), _value("c0", 1, 1, n)]
    outputs = [_value("drift", "steps", 1, 2), _value("h1", 1, 1, n), _value("c1", 1, 1, n)]
    if compensation.width is not None:
        constants, more = _width(compensation.width, compensation.limits)
        initialisers |= constants
        nodes += more
        outputs.append(_value("half_width", "steps", 1, 2))
    graph = b"".join(
        [
            *(_field(1, node) for node in nodes),
            _field(2, b"lstm_drift"),
            *(_field(5, _tensor(name, value)) for name, value in initialisers.items()),
            _field(5, _tensor("direction_axis", np.array([1]))),
            *(_field(11, value) for value in inputs),
            *(_field(12, value) for value in outputs),
        ]
    )
    metadata = {
        "warm_up": str(model.settings.warm_up),
        "features": "t_in_degc,t_out_degc,dt_60_degc_per_min,gradient_degc",
        "inputs": ",".join(seen),
        "outputs": "bias_dph,sf_error_ppm",
        "model": model.name,
        "unit_id": compensation.unit_id,
        "interval": "none: no runs were left out of fits of this network"
        if compensation.width is None
        else f"half_width: {LEVEL:.0%} of means of 100 s, noise included",
        "input_low": ",".join(repr(float(v)) for v in weights.input_low),
        "input_high": ",".join(repr(float(v)) for v in weights.input_high),
    }
    properties = (
        _field(14, _field(1, key.encode()) + _field(2, text.encode())) for key, text in metadata.items()
    )
    opset = _field(8, _int_field(2, OPSET))
    return b"".join(
        [_int_field(1, IR_VERSION), _field(2, b"gyrobench"), _field(7, graph), opset, *properties]
    )


def _width(
    width: PredictionWidth, limits: Limits
) -> tuple[dict[str, Array | NDArray[np.int64]], list[bytes]]:
    """Return constants and nodes of `PredictionWidth.half_widths`."""
    low, high = np.array([limits.inputs[name] for name in FEATURES]).T
    constants: dict[str, Array | NDArray[np.int64]] = {
        "range_low": low,
        "range_high": high,
        "per_range": PER_EXCESS / np.maximum(high - low, LEAST_RANGE),
        "zero": np.zeros(1),
        "last_axis": np.array([2]),
        "changes": np.array([FEATURES.index(name) for name in TERMS]),
        "width_base": width.coefficients[:, 0],
        "width_slopes": width.coefficients[:, 1:].T,
    }
    nodes = [
        _node("Sub", ["range_low", "features"], ["under"]),
        _node("Sub", ["features", "range_high"], ["over"]),
        _node("Max", ["under", "zero"], ["below"]),
        _node("Max", ["over", "zero"], ["above"]),
        _node("Add", ["below", "above"], ["beyond"]),
        _node("Mul", ["beyond", "per_range"], ["parts"]),
        _node("ReduceSum", ["parts", "last_axis"], ["excess"]),
        _node("Add", ["excess", "one"], ["wider"]),
        _node("Gather", ["features", "changes"], ["signed"], {"axis": 2}),
        _node("Abs", ["signed"], ["sizes"]),
        _node("MatMul", ["sizes", "width_slopes"], ["sloped"]),
        _node("Add", ["sloped", "width_base"], ["inside"]),
        _node("Mul", ["inside", "wider"], ["half_width"]),
    ]
    return constants, nodes


def _reordered(rows: Array, hidden: int) -> Array:
    """Gate rows from i, f, g, o (ours) to i, o, f, g (ONNX, which calls g c)."""
    i, f, g, o = (rows[k * hidden : (k + 1) * hidden] for k in range(4))
    return np.concatenate([i, o, f, g])


def _node(
    operator: str, inputs: Sequence[str], outputs: Sequence[str], integers: Mapping[str, int] | None = None
) -> bytes:
    attributes = [
        _field(1, key.encode()) + _int_field(3, value) + _int_field(20, _ATTRIBUTE_INT)
        for key, value in (integers or {}).items()
    ]
    return b"".join(
        [
            *(_field(1, name.encode()) for name in inputs),
            *(_field(2, name.encode()) for name in outputs),
            _field(3, outputs[0].encode()),
            _field(4, operator.encode()),
            *(_field(5, attribute) for attribute in attributes),
        ]
    )


def _tensor(name: str, value: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> bytes:
    whole = np.issubdtype(value.dtype, np.integer)
    with np.errstate(over="ignore"):
        stored = value.astype("<i8" if whole else "<f4")
    if not np.isfinite(stored).all():
        raise ConfigurationError(
            "a constant is no number, or beyond the range of a float32",
            where="ONNX export",
            found=f"{name}: {value[~np.isfinite(stored)][0]}",
            expected="finite weights and ranges",
            remedy="fit the network again",
        )
    raw = stored.tobytes()
    dims = b"".join(_int_field(1, size) for size in value.shape)
    return dims + _int_field(2, _INT64 if whole else _FLOAT) + _field(8, name.encode()) + _field(9, raw)


def _value(name: str, *shape: int | str) -> bytes:
    dims = (_field(2, size.encode()) if isinstance(size, str) else _int_field(1, size) for size in shape)
    tensor_type = _int_field(1, _FLOAT) + _field(2, b"".join(_field(1, dim) for dim in dims))
    return _field(1, name.encode()) + _field(2, _field(1, tensor_type))


def _field(number: int, payload: bytes) -> bytes:
    return _varint(number << 3 | _BYTES) + _varint(len(payload)) + payload


def _int_field(number: int, value: int) -> bytes:
    return _varint(number << 3 | _VARINT) + _varint(value)


def _varint(value: int) -> bytes:
    """Base-128 varint, least significant group first; `value` >= 0."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
