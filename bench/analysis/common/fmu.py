"""An FMU (FMI 2.0, co-simulation) that executes a model of ours step by step, written by PythonFMU.

It holds what the model is made of, as JSON. Python with gyrobench executes that on the machine that simulates.
"""

from __future__ import annotations

import json
import re
import sys
import uuid
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.files import replace_file
from drivers.base.plugins import from_extra

_WHAT = "writing an FMU"
_MODULE, _GIVEN = "gyrobench_fmu", "gyrobench_fmu.json"
_NEEDS = "It runs Python: gyrobench must be importable by the Python of the machine that simulates."
_SLAVE = '''"""Executes what gyrobench put beside this file; gyrobench must be installed where it runs."""

from pythonfmu import Fmi2Slave

from bench.analysis.common.fmu import Executed


class Gyrobench(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.executed = Executed(self)

    def do_step(self, current_time, step_size):
        return self.executed.step(current_time, step_size)
'''


class Stepped(Protocol):
    """What an FMU can execute. Variables by name, with a unit at its end: start value and meaning, all float.

    `step_s`: the usual communication step; `any_step`: whether others than multiples of it will do.
    """

    inputs: Mapping[str, tuple[float, str]]
    parameters: Mapping[str, tuple[float, str]]
    outputs: Mapping[str, tuple[float, str]]
    step_s: float
    any_step: bool

    def step(self, time_s: float, step_s: float, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the outputs at the end of the step that begins at a time, with inputs that hold during it.

        `values`: inputs and parameters. BenchError for a step that it cannot do.
        """


Maker = Callable[[Mapping[str, Any], Path], Stepped]
"""Makes what is executed of plain JSON values and of the folder that holds the FMU's files."""


def write_fmu(
    file: Path, maker: Maker, given: Mapping[str, Any], about: str, own: Sequence[Path] = ()
) -> None:
    """Write an FMU whose model `maker(given, folder)` makes, where it runs as here; a file there is replaced.

    `maker`: a class or function of a module. `own`: files that the model needs in its folder. What `maker` raises
    is raised here; ConfigurationError for a file that does not end in .fmu or cannot be written, and without
    PythonFMU.
    """
    check_can_write(file)
    builder = from_extra("pythonfmu.builder", "fmu", _WHAT)
    content = {"maker": f"{maker.__module__}:{maker.__qualname__}", "given": dict(given)}
    content |= {"name": _identifier(file.stem), "about": f"{about} {_NEEDS}"}
    any_step = maker(given, Path()).any_step
    with TemporaryDirectory() as made:
        folder = Path(made)
        slave, data = folder / f"{_MODULE}.py", folder / _GIVEN
        slave.write_text(_SLAVE, encoding="utf-8")
        data.write_text(json.dumps(content), encoding="utf-8")
        path = sys.path.copy()
        try:
            built = builder.FmuBuilder.build_FMU(
                slave,
                dest=folder,
                project_files=[data, *own],
                canHandleVariableCommunicationStepSize=any_step,
            )
        finally:  # PythonFMU imports the file by its name and leaves its folder behind
            sys.path[:] = path
            sys.modules.pop(_MODULE, None)
        try:
            replace_file(file, Path(built).read_bytes())
        except OSError as error:
            raise ConfigurationError(
                "the FMU cannot be written", where=str(file), found=error.strerror or str(error)
            ) from error


def check_can_write(file: Path) -> None:
    """Raise ConfigurationError without PythonFMU, and for a file whose name does not end in .fmu."""
    from_extra("pythonfmu", "fmu", _WHAT)
    if file.suffix != ".fmu":
        raise ConfigurationError(
            "an FMU's file ends in .fmu", where=str(file), found=file.suffix or "no ending", expected=".fmu"
        )


def _identifier(name: str) -> str:
    """Return a name as C has them: FMI demands it of a model's identifier."""
    made = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"m_{made}" if not made or made[0].isdigit() else made


class Executed:
    """A model at work in a slave of PythonFMU, in whose resources it lies."""

    def __init__(self, slave: Any) -> None:
        pythonfmu = from_extra("pythonfmu", "fmu", "an FMU")  # it is in the FMU
        folder = Path(slave.resources)
        text = (folder / _GIVEN).read_text(encoding="utf-8")
        content = json.loads(text)
        module, _, name = content["maker"].partition(":")
        self._model: Stepped = getattr(import_module(module), name)(content["given"], folder)
        slave.modelName, slave.description = content["name"], content["about"]
        slave.guid = uuid.uuid5(uuid.NAMESPACE_URL, text)
        slave.default_experiment = pythonfmu.DefaultExperiment(start_time=0.0, step_size=self._model.step_s)
        self._values: dict[str, float] = {}
        causality, initial = pythonfmu.Fmi2Causality, pythonfmu.Fmi2Initial
        variability = pythonfmu.Fmi2Variability
        for variables, facts in (
            (self._model.parameters, {"causality": causality.parameter, "variability": variability.fixed}),
            (self._model.inputs, {"causality": causality.input}),
            (self._model.outputs, {"causality": causality.output, "initial": initial.exact}),
        ):
            for variable, (start, meaning) in variables.items():
                self._values[variable] = start
                made = pythonfmu.Real(variable, start, description=meaning, **facts, **self._access(variable))
                slave.register_variable(made)

    def _access(self, name: str) -> dict[str, Callable[..., Any]]:
        def put(value: float) -> None:
            self._values[name] = value

        return {"getter": lambda: self._values[name], "setter": put}

    def step(self, time_s: float, step_s: float) -> bool:
        """Do one communication step; RuntimeError, which the FMU's logger shows in full, if it cannot be done."""
        try:
            self._values |= self._model.step(time_s, step_s, self._values)
        except BenchError as error:
            raise RuntimeError(str(error)) from error
        return True
