"""What a run asks of chamber and table, and what they do: the lab's plant without ports, bytes or a session.

The times are those that the procedures expect; their waits for equilibrium take what `expected_duration_s` says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap import Design
from drivers.base.arrays import Array
from drivers.kit.config import Mounting
from simulators.effects import Stimulus
from simulators.plant import LabPlant, PlantConfig, UnitConfig

_EAST_DEG = 90.0
_ROOM_RAMP_K_PER_MIN = 3.0
_MOVE_S = 60.0
"""For the table's way to its first position."""
_REST_S, _SETTLING_S = 60.0, 10.0


@dataclass(frozen=True)
class Act:
    """At `at_s`: the air to `value` degC at `ramp` K/min, the table to an angle in deg or to a rate in deg/s."""

    at_s: float
    kind: Literal["air", "angle", "rate"]
    value: float
    ramp: float = 0.0


@dataclass(frozen=True)
class Part:
    """A stretch that a diagnosis takes: its condition, and its whole seconds."""

    condition: str
    start_s: int
    end_s: int


@dataclass(frozen=True)
class Programme:
    """A run: how the unit lies, what is asked when, which stretches count; `turns` if the table does in them."""

    mounting: Mounting
    acts: tuple[Act, ...]
    parts: tuple[Part, ...]
    turns: bool

    @property
    def elevation_deg(self) -> float:
        """The axis under test (x) above the horizon."""
        return 90.0 if self.mounting == "axis_up" else 0.0

    @property
    def end_s(self) -> int:
        """When the last stretch ends."""
        return self.parts[-1].end_s


def programme_of(design: Design) -> Programme:
    """Return what a design's procedure asks for."""
    values = design.test.parse(dict(design.settings)).model_dump()
    return _PROGRAMMES[design.procedure](values, design)


def _zero_bias(p: Mapping[str, Any], design: Design) -> Programme:
    dwell_s = float(p["east_dwell_s"])
    found_s = 60.0 * p["east_after_min"] + 4.0 * dwell_s
    reference_s = max(60.0 * p["warm_up_min"], found_s + 1800.0)
    shock_s = reference_s + 60.0 * p["hold_min"]
    way_s = 60.0 * (p["room_c"] - p["cold_c"]) / p["ramp_k_per_min"]
    back_s = shock_s + way_s + 60.0 * p["soak_min"]
    end_s = back_s + way_s + 60.0 * 105.0
    acts = (
        Act(1.0, "angle", _EAST_DEG),
        Act(1.0, "air", p["room_c"]),
        *_finding_east(60.0 * p["east_after_min"], dwell_s),
        Act(shock_s, "air", p["cold_c"], p["ramp_k_per_min"]),
        Act(back_s, "air", p["room_c"], p["ramp_k_per_min"]),
    )
    part = Part(f"{_EAST_DEG:.0f} deg", round(found_s + _MOVE_S), round(end_s))
    return Programme("axis_horizontal", acts, (part,), turns=False)


def _finding_east(start_s: float, dwell_s: float) -> tuple[Act, ...]:
    west = _EAST_DEG + 180.0
    angles = (_EAST_DEG, west, west, _EAST_DEG)
    return tuple(Act(start_s + k * dwell_s, "angle", angle) for k, angle in enumerate(angles))


def _scale_factor(p: Mapping[str, Any], design: Design) -> Programme:
    hold_s, way_s = 60.0 * p["hold_min"], 60.0 * (p["room_c"] - p["cold_c"]) / p["ramp_k_per_min"]
    length_s = hold_s + 2.0 * way_s + 60.0 * (p["soak_min"] + 105.0)
    acts, parts = [Act(1.0, "air", p["room_c"])], []
    for number, rate_dps in enumerate((p["rate_dps"], -p["rate_dps"], 0.0)):
        start_s = 60.0 * p["warm_up_min"] + number * length_s
        acts += [
            Act(start_s - 120.0, "rate", rate_dps),
            Act(start_s + hold_s, "air", p["cold_c"], p["ramp_k_per_min"]),
            Act(start_s + hold_s + way_s + 60.0 * p["soak_min"], "air", p["room_c"], p["ramp_k_per_min"]),
        ]
        parts.append(Part(f"{rate_dps:+.0f}", round(start_s), round(start_s + length_s - 180.0)))
    return Programme("axis_up", tuple(acts), tuple(parts), turns=False)


def _ramp(p: Mapping[str, Any], design: Design) -> Programme:
    warm_s, dwell_s = 60.0 * p["warm_up_min"], 60.0 * p["dwell_min"]
    east_s = 4.0 * p["east_dwell_s"] + 200.0 if p["search_east"] else 0.0
    soak_s = warm_s + east_s
    up_s = soak_s + 60.0 * abs(p["low_c"] - p["room_c"]) / _ROOM_RAMP_K_PER_MIN + dwell_s
    hot_s = up_s + 60.0 * abs(p["high_c"] - p["low_c"]) / p["ramp_k_per_min"]
    acts = (
        Act(1.0, "angle", _EAST_DEG),
        Act(1.0, "air", p["room_c"]),
        *(_finding_east(warm_s, p["east_dwell_s"]) if p["search_east"] else ()),
        Act(soak_s, "air", p["low_c"], _ROOM_RAMP_K_PER_MIN),
        Act(up_s, "air", p["high_c"], p["ramp_k_per_min"]),
        Act(hot_s + dwell_s, "air", p["room_c"], _ROOM_RAMP_K_PER_MIN),
    )
    end_s = hot_s + dwell_s + 60.0 * abs(p["high_c"] - p["room_c"]) / _ROOM_RAMP_K_PER_MIN
    part = Part(f"{_EAST_DEG:.0f} deg", round(_MOVE_S), round(end_s))
    return Programme("axis_horizontal", acts, (part,), turns=False)


def _rotation(p: Mapping[str, Any], design: Design) -> Programme:
    count = int(p["reversals"]) + 1
    stretch_s = 360.0 * p["turns"] / abs(p["rate_dps"]) / count + _SETTLING_S
    rates = [p["rate_dps"] * (-1.0) ** number for number in range(count)]
    acts = [Act(1.0, "angle", 0.0)]
    acts += [Act(_MOVE_S + _REST_S + k * stretch_s, "rate", rate) for k, rate in enumerate(rates)]
    stop_s = _MOVE_S + _REST_S + count * stretch_s
    acts.append(Act(stop_s, "rate", 0.0))
    part = Part(f"{rates[0]:+.0f}", round(_MOVE_S), round(stop_s + _REST_S))
    return Programme("z_up", tuple(acts), (part,), turns=True)


def _cycled(p: Mapping[str, Any], design: Design) -> Programme:
    """The rates as the design foretells them; the air ramps from the end of the rates at room temperature."""
    (stimulus,) = design.stimuli.values()
    acts = [Act(1.0, "air", p["room_c"]), *_turning(stimulus, 1.0)]
    if p["over_temperature"]:
        ways = list(pairwise((p["room_c"], p["low_c"], p["high_c"], p["room_c"])))
        takes_s = [60.0 * (abs(end - start) / p["ramp_k_per_min"] + p["dwell_min"]) for start, end in ways]
        at_s = len(stimulus) - sum(takes_s) + 60.0 * p["dwell_min"]  # no dwell at the end of the last
        for (_, end_c), leg_s in zip(ways, takes_s, strict=True):
            acts.append(Act(at_s, "air", end_c, p["ramp_k_per_min"]))
            at_s += leg_s
    part = Part("+0", round(_MOVE_S), len(stimulus))
    return Programme("axis_up", tuple(sorted(acts, key=lambda act: act.at_s)), (part,), turns=True)


def _rates(p: Mapping[str, Any], design: Design) -> Programme:
    """The rates as the design foretells them, after what the standard test does before."""
    (stimulus,) = design.stimuli.values()
    before_s = 60.0 * (p["warm_up_min"] + p["bias_min"]) + 3600.0 * p["noise_h"]
    part = Part("+0", round(before_s), round(before_s) + len(stimulus))
    return Programme("axis_up", tuple(_turning(stimulus, before_s)), (part,), turns=True)


def _turning(stimulus: Stimulus, start_s: float) -> list[Act]:
    """Return the table's rates as a stretch has them, which begins at `start_s`."""
    wanted = stimulus.table_rate_dps
    changes = [0, *(np.flatnonzero(np.abs(np.diff(wanted)) > 1e-6) + 1).tolist()]
    return [Act(start_s + at, "rate", float(wanted[at])) for at in changes]


_PROGRAMMES: Mapping[str, Callable[[Mapping[str, Any], Design], Programme]] = {
    "zero-bias-cold-shock": _zero_bias,
    "scale-factor-cold-shock": _scale_factor,
    "thermal-ramp": _ramp,
    "constant-rotation": _rotation,
    "standard-test": _rates,
    "rates-over-temperature": _cycled,
}


def made(programme: Programme, latitude_deg: float, seed: int, units: Sequence[UnitConfig] = ()) -> LabPlant:
    """Return the lab's plant after a run of the programme."""
    plant = LabPlant(PlantConfig(latitude_deg=latitude_deg, seed=seed, units=tuple(units)))
    plant.table.servo(0.0, on=True)
    for unit in units:
        plant.mount(unit.name, programme.mounting)
    for act in programme.acts:
        if act.kind == "air":
            plant.chamber.demand(
                act.at_s, set_point_c=act.value, ramp_up=act.ramp, ramp_down=act.ramp, running=True
            )
        elif act.kind == "angle":
            plant.table.demand_angle(act.at_s, act.value, 90.0)
        else:
            plant.table.demand_rate(act.at_s, act.value)
    plant.advance(programme.end_s + 2.0)
    return plant


def angles_deg(plant: LabPlant, edges_s: Array) -> Array:
    """Return the table's true angle at times (n,)."""
    angle = plant.table.total_angles_deg(edges_s)
    return angle if len(angle) == len(edges_s) else np.full(len(edges_s), angle[0])


def changing(rate_dps: Array) -> NDArray[np.bool_]:
    """Return which seconds (n,) the table's telemetry does not follow: those in which its rate changes."""
    steps = np.flatnonzero(np.abs(np.diff(rate_dps)) > 0.1)
    left_out = np.zeros(len(rate_dps), dtype=np.bool_)
    for at in steps:
        left_out[max(at - 1, 0) : at + 3] = True
    return left_out
