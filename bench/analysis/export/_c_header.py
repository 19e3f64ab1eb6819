"""A compensation as one C99 header for firmware: constants, state, step, self-test; no allocation, only tanhf.

The header does what `CompensationStream` does: the same features from one-second temperatures, the same holds,
limits and flags. Constants are IEEE 754 values printed with the digits that restore them, under one CRC.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

import jinja2
import numpy as np

from bench.analysis.export._c_program import TEMPLATES, CConstant, Real, c_programs
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._features import CHANGE_S, WINDOW_S
from bench.analysis.thermal._regression import TARGETS
from bench.analysis.thermal._stream import FEATURES, LONGEST_GAP_S, Flag
from bench.analysis.thermal._width import PER_EXCESS
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

SELF_TEST_STEPS = 32
_PREFIX = "gyrocomp"


def c_header(compensation: Compensation) -> str:
    """Return the header's text; all its names begin with gyrocomp.

    ConfigurationError if the model has no C form or a constant is beyond the range of its C type.
    """
    programs = c_programs(compensation.model)
    constants, parts = _own_constants(compensation), []
    environment = _environment()
    for program in programs:
        prefix = f"{_PREFIX}_{program.tag}_"
        constants += [replace(constant, name=prefix + constant.name) for constant in program.constants]
        names = {"k": prefix, "s": f"{program.tag}_", **program.sizes}
        parts.append(environment.from_string(program.source).make_module(names))
    t_range = compensation.limits.inputs["t_in"]
    return environment.get_template("header.h.j2").render(
        p=_PREFIX,
        P=_PREFIX.upper(),
        guard=f"{_PREFIX.upper()}_H",
        version=version("gyrobench"),
        unit_id=_quotable(compensation.unit_id),
        model=_quotable(compensation.model.name),
        step_s=compensation.step_s,
        warm_up=max([program.sizes.get("warm_up", 0) for program in programs], default=0),
        reference_temp_c=compensation.reference_temp_c,
        k_ref=compensation.k_ref,
        trained_from_s=math.ceil(compensation.limits.trained_from_s),
        t_range=t_range,
        training_runs=[_quotable(run.run_id) for run in compensation.training_runs],
        flags=[(flag.name, flag.value) for flag in Flag],
        constants=constants,
        doubles=any(constant.real == "double" for constant in constants),
        crc=_crc(constants),
        programs=parts,
        window=WINDOW_S,
        change=CHANGE_S,
        longest_gap=LONGEST_GAP_S,
        self_test=SELF_TEST_STEPS,
        width=compensation.width is not None,
        per_excess=PER_EXCESS,
    )


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["c_float"] = lambda value: _literal(float(value), "float")
    environment.filters["literals"] = lambda constant: [
        _literal(float(value), constant.real) for value in np.ravel(constant.values)
    ]
    return environment


def _own_constants(compensation: Compensation) -> list[CConstant]:
    limits, width = compensation.limits, compensation.width
    inputs, outputs = _self_test(compensation)
    return [
        CConstant(f"{_PREFIX}_input_range", np.array([limits.inputs[name] for name in FEATURES]), "double"),
        CConstant(f"{_PREFIX}_output_range", np.array([getattr(limits, name) for name in TARGETS]), "double"),
        *([] if width is None else [CConstant(f"{_PREFIX}_width", width.coefficients, "double")]),
        CConstant(f"{_PREFIX}_self_test_inputs", inputs),
        CConstant(f"{_PREFIX}_self_test_outputs", outputs),
    ]


def _self_test(compensation: Compensation) -> tuple[Array, Array]:
    """Inputs (n, 4) that sweep the valid range, as float32 values, and the clamped drift (n, 2) they give."""
    phase = np.linspace(0.0, np.pi, SELF_TEST_STEPS)
    low, high = np.array([compensation.limits.inputs[name] for name in FEATURES]).T
    swing = 0.5 + 0.5 * np.cos(np.outer(phase, [1.0, 1.3, 2.1, 2.7]))
    inputs = (low + (high - low) * swing).astype(np.float32).astype(np.float64)
    stepper = compensation.model.stepper()
    outputs = np.array([stepper.step(*map(float, row)) for row in inputs])
    return inputs, compensation.limits.clamp(outputs)[0]


def _crc(constants: Sequence[CConstant]) -> int:
    crc = 0
    for constant in constants:
        crc = zlib.crc32(constant.values.astype("<f4" if constant.real == "float" else "<f8").tobytes(), crc)
    return crc


def _literal(value: float, real: Real) -> str:
    """A C literal that reads back as the same IEEE 754 value: 9 digits for float, 17 for double."""
    with np.errstate(over="ignore"):
        stored = float(np.float32(value)) if real == "float" else value
    if not math.isfinite(stored):
        raise ConfigurationError(
            f"a constant is beyond the range of a C {real}", where="C export", found=repr(value)
        )
    text = f"{stored:.9g}" if real == "float" else f"{stored:.17g}"
    if not any(mark in text for mark in ".e"):
        text += ".0"
    return f"{text}f" if real == "float" else text


def _quotable(text: str) -> str:
    """Text for a C string and a C comment: anything but plain characters becomes an underscore."""
    return re.sub(r"[^A-Za-z0-9 ._+:-]", "_", text)
