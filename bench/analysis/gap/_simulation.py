"""Any simulation as the nominal: columns that it foretold, a Python function, or an FMU on recorded inputs.

A model file's `[simulation]` names it. What it foretells takes the place of the input rate, so that a diagnosis
works on what is left and the terms that it names are those which the simulation lacks.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from bench.analysis.gap._fmu import simulate_fmu
from bench.record.exchange import BASE_UNITS, read_table, scale_of, unit_error
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of, names_of_file
from simulators.effects import Stimulus, add_effects

GROUP = "gyrobench.simulations"
"""Entry points: functions of the inputs (name -> values (n,)) that return the rate in deg/s, (n,)."""
_KINDS = ("columns", "function", "fmu")
_KEYS = {*_KINDS, "time", "output", "inputs", "start_values"}
_QUANTITY = {"output": "rate", "time": "time"}
INPUTS: Mapping[str, Callable[[Stimulus], Array]] = {
    "time_s": lambda s: s.time_s - 0.5 * s.period_s,
    "rate_dps": lambda s: s.input_rate_dph / DPH_PER_DPS,
    "table_rate_dps": lambda s: s.table_rate_dps,
    "table_angle_deg": lambda s: 0.5 * (s.angle_deg[1:] + s.angle_deg[:-1]),
    "elevation_deg": lambda s: s.elevation_deg,
    "t_in_c": lambda s: s.t_in_c,
    "t_out_c": lambda s: s.t_out_c,
}
"""What a simulation is given, at the middles of the steps, (n,): `rate_dps` is the true one along the axis."""


@dataclass(frozen=True)
class Simulation:
    """The `[simulation]` of a model file in `folder`, as it stands there."""

    settings: Mapping[str, Any]
    folder: Path

    @property
    def kind(self) -> str:
        """One of "columns", "function", "fmu"."""
        return next(kind for kind in _KINDS if kind in self.settings)

    def moved(self, folder: Path) -> Simulation:
        """Return the same simulation for a model file in another folder: its paths are relative to that."""
        settings = dict(self.settings)
        if self.kind != "function":
            settings[self.kind] = os.path.relpath(self.folder / str(settings[self.kind]), folder)
        return Simulation(settings, folder)

    def foretold_dph(self, stimulus: Stimulus, run_id: str) -> Array:
        """Return what the simulation foretells of a run's output, (n,), NaN where it does not.

        ConfigurationError for a file, function or FMU that cannot be used, or that foretells nothing of the run.
        """
        made = {"columns": self._columns, "function": self._function, "fmu": self._fmu}[self.kind](
            stimulus, run_id
        )
        if made.shape != (len(stimulus),) or not np.isfinite(made).any():
            raise ConfigurationError(
                "the simulation foretells nothing of this run",
                where=run_id,
                found=f"{made.shape} values, {int(np.isfinite(made).sum())} of them numbers",
                expected=f"({len(stimulus)},), the rate of every step of {stimulus.period_s:g} s",
            )
        return made

    def _columns(self, stimulus: Stimulus, run_id: str) -> Array:
        """Return means over the run's steps of a column, by its own times from the run's first step on."""
        file = self.folder / str(self.settings["columns"]).replace("{run}", run_id)
        named = {key: self._column(key) for key in ("time", "output")}
        table = read_table(file, [name for name, _ in named.values()])
        time, rate = (
            table.columns[name] * scale.factor + scale.offset
            for name, scale in ((name, self._scale(key, unit)) for key, (name, unit) in named.items())
        )
        known = np.isfinite(time) & np.isfinite(rate)
        time, rate = time[known], rate[known]
        if len(time) < 2 or not bool((np.diff(time) > 0.0).all()):
            raise ConfigurationError("what a simulation foretold has no times that grow", where=str(file))
        return DPH_PER_DPS * _means(stimulus, time, rate)

    def _function(self, stimulus: Stimulus, run_id: str) -> Array:
        function = _named_function(str(self.settings["function"]))
        inputs = {name: np.array(of(stimulus), np.float64) for name, of in INPUTS.items()}
        _, unit = self._column("output", needed=False)
        scale = self._scale("output", unit or BASE_UNITS["rate"])
        return np.asarray(
            DPH_PER_DPS * (np.asarray(function(inputs)) * scale.factor + scale.offset), np.float64
        )

    def _fmu(self, stimulus: Stimulus, run_id: str) -> Array:
        wanted = dict(self.settings.get("inputs", {}))
        if unknown := sorted(set(wanted.values()) - set(INPUTS)):
            raise ConfigurationError(
                "an FMU's input is given something that is not recorded",
                where="[simulation.inputs]",
                found=", ".join(map(str, unknown)),
                expected=", ".join(INPUTS),
            )
        output, unit = self._column("output")
        scale = self._scale("output", unit)
        given = {variable: np.array(INPUTS[name](stimulus), np.float64) for variable, name in wanted.items()}
        file, started = self.folder / str(self.settings["fmu"]), dict(self.settings.get("start_values", {}))
        values = simulate_fmu(file, given, output, started, len(stimulus), stimulus.period_s)
        return np.asarray(DPH_PER_DPS * (values * scale.factor + scale.offset))

    def _column(self, key: str, *, needed: bool = True) -> tuple[str, str]:
        column = self.settings.get(key, {})
        if not isinstance(column, Mapping) or (needed and not column.get("name")):
            raise ConfigurationError(
                "the simulation does not say its column",
                where=f"[simulation] {key}",
                found=str(column or "nothing"),
                expected=f'{key} = {{ name = "...", unit = "{BASE_UNITS[_QUANTITY[key]]}" }}',
            )
        return str(column.get("name", "")), str(column.get("unit", ""))

    @staticmethod
    def _scale(key: str, unit: str) -> Any:
        scale = scale_of(_QUANTITY[key], unit)
        if scale is None or scale.per_sample:
            raise unit_error(_QUANTITY[key], unit, f"[simulation] {key}")
        return scale


def read_simulation(table: Mapping[str, Any], where: str) -> Simulation | None:
    """Return the simulation that a model file's text names, None without; ConfigurationError for one unclear."""
    if not table:
        return None
    kinds, unknown = [kind for kind in _KINDS if kind in table], sorted(set(table) - _KEYS)
    if len(kinds) != 1 or unknown:
        raise ConfigurationError(
            "the model's [simulation] cannot be used",
            where=where,
            found=", ".join([*kinds, *unknown]) or "nothing",
            expected="one of columns, function, fmu; beside it time, output, inputs, start_values",
        )
    return Simulation(table, Path(where).parent)


def _means(stimulus: Stimulus, time_s: Array, values: Array) -> Array:
    """Return means over the steps of a course at times from the first step's begin on, NaN beyond its ends."""
    edges = np.arange(len(stimulus) + 1) * stimulus.period_s
    usual = float(np.median(np.diff(time_s)))
    knots = np.union1d(edges, time_s)
    area = np.concatenate(([0.0], np.cumsum(np.diff(knots) * _middle(np.interp(knots, time_s, values)))))
    means = np.diff(area[np.searchsorted(knots, edges)]) / stimulus.period_s
    reached = (edges[:-1] >= time_s[0] - 1.5 * usual) & (edges[1:] <= time_s[-1] + 1.5 * usual)
    return np.where(reached, means, np.nan)


def _middle(values: Array) -> Array:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


_OWN_FUNCTIONS: dict[str, Callable[..., Any]] = {}


def take_own(file: Path) -> None:
    """Take effects and functions for `[simulation]` from a Python file of the user's own; its code runs.

    ConfigurationError for a file that cannot be used, defines neither, or an effect of a name that is taken.
    """
    values = names_of_file(file)
    functions = {
        name: value
        for name, value in values.items()
        if inspect.isfunction(value) and value.__module__ == values["__name__"]
    }
    if not add_effects(values.values(), file) and not functions:
        raise ConfigurationError(
            "the file defines no effect",
            where=str(file),
            found="no Effect, Disturbance or ChannelEffect of its own, and no function",
            expected="MINE = Effect(...), see docs/add_an_effect.md",
        )
    _OWN_FUNCTIONS.update(functions)


def _named_function(name: str) -> Callable[[Mapping[str, Array]], Array]:
    """Return a function by its name in a file that was taken, or by that of an entry point."""
    found = _OWN_FUNCTIONS.get(name) or next(
        (point.load() for point in entry_points_of(GROUP) if point.name == name), None
    )
    if not callable(found):
        known = [*_OWN_FUNCTIONS, *sorted(point.name for point in entry_points_of(GROUP))]
        raise ConfigurationError(
            "there is no such simulation",
            where="[simulation] function",
            found=name,
            expected=f"a function of a file given by --effects, or an entry point of {GROUP}: "
            + (", ".join(known) or "there is none"),
        )
    return cast(Callable[[Mapping[str, Array]], Array], found)
