"""An FMU (FMI 2 or 3) driven by recorded inputs, by FMPy."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import from_extra

_FINER = 4
"""Outputs a step: means of them are what a run has."""


def simulate_fmu(
    file: Path,
    inputs: Mapping[str, Array],
    output: str,
    start_values: Mapping[str, Any],
    steps: int,
    period_s: float,
) -> Array:
    """Return the means over the run's steps of an output of the FMU, (steps,), with inputs (steps,), means too.

    Inputs are taken as linear between the middles of the steps. An FMU for co-simulation takes its inputs at the
    begin of a communication step, a quarter of the run's, and its output at the end stands for all of it.
    ConfigurationError for an FMU that cannot be read, is not for this machine, lacks a variable or fails.
    """
    fmpy = from_extra("fmpy", "fmu", "an FMU as nominal model")
    try:
        description = fmpy.read_model_description(str(file))
    except Exception as error:  # whatever FMPy raises on a damaged file
        raise _unusable(file, f"{type(error).__name__}: {error}") from error
    names = {variable.name for variable in description.modelVariables}
    if missing := [name for name in (*inputs, output, *start_values) if name not in names]:
        raise ConfigurationError(
            "the FMU has no such variable",
            where=str(file),
            found=", ".join(missing),
            expected=", ".join(sorted(names)),
        )
    together, finer_s = description.coSimulation is not None, period_s / _FINER
    signals = None
    if inputs:
        time_s = (np.arange(steps) + 0.5) * period_s - (0.5 * finer_s if together else 0.0)
        signals = np.zeros(steps, dtype=[("time", np.float64), *((name, np.float64) for name in inputs)])
        for name, values in {"time": time_s, **inputs}.items():
            signals[name] = values
    try:
        with redirect_stdout(StringIO()):  # FMPy prints a line for every input that is not given
            result = fmpy.simulate_fmu(
                str(file), start_time=0.0, stop_time=steps * period_s, output_interval=finer_s, input=signals,
                output=[output], start_values=dict(start_values),
                fmi_type="CoSimulation" if together else "ModelExchange",
            )  # fmt: skip
    except Exception as error:  # of FMPy, or of the FMU's own library
        raise _unusable(file, f"{type(error).__name__}: {error}") from error
    edges = np.arange(steps * _FINER + 1) * finer_s
    values = np.interp(edges, np.asarray(result["time"], np.float64), np.asarray(result[output], np.float64))
    fine = values[1:] if together else 0.5 * (values[1:] + values[:-1])
    return np.asarray(fine.reshape(steps, _FINER).mean(axis=1))


def _unusable(file: Path, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the FMU cannot be simulated",
        where=str(file),
        found=found[:300],
        expected="an FMU 2 or 3 with a binary for this machine (`fmpy validate` says more)",
    )
