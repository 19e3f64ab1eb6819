"""Whole ring-laser ramp runs without bytes: a chamber profile through the ticks of the lab, as arrays at 1 s."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks._thermal_runs import Phase
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.model import UnitModel
from simulators.plant.table import TableParameters

_EAST_DEG = 90.0


@dataclass(frozen=True)
class RlgRunData:
    """One run, row k covering the second that ends at `time_s[k]`; arrays (n,).

    `case_c` (T1) and `block_c` (T2) are the two sensors' readings, `bias_dph` the output with noise, the axis
    east; `true_bias_dph` the mean of the effects and turn-on over the second, without noise and flicker.
    """

    time_s: NDArray[np.float64]
    case_c: NDArray[np.float64]
    block_c: NDArray[np.float64]
    bias_dph: NDArray[np.float64]
    true_bias_dph: NDArray[np.float64]


def ramp_profile(
    *,
    low_c: float = -40.0,
    high_c: float = 65.0,
    ramp_k_per_min: float = 1.0 / 3.0,
    dwell_min: float = 60.0,
    downwards: bool = False,
) -> list[Phase]:
    """Return a profile: soak at one end, ramp to the other, dwell, ramp back, dwell."""
    first, second = (high_c, low_c) if downwards else (low_c, high_c)
    ramp_s = 60.0 * (high_c - low_c) / ramp_k_per_min
    dwell_s = 60.0 * dwell_min
    return [
        Phase("soak", first, dwell_s),
        Phase("ramp_1", second, ramp_s, ramp_k_per_min),
        Phase("dwell_1", second, dwell_s, ramp_k_per_min),
        Phase("ramp_2", first, ramp_s, ramp_k_per_min),
        Phase("dwell_2", first, dwell_s, ramp_k_per_min),
    ]


def rlg_run(
    profile: Sequence[Phase],
    *,
    unit_seed: int = 0,
    run_seed: int = 0,
    change: Callable[[UnitModel], UnitModel] | None = None,
) -> RlgRunData:
    """Run a ring laser through a chamber profile from power-on at the first phase's set point, axis east."""
    unit = UnitConfig("gyro", "rlg", unit_seed=unit_seed, change=change)
    table = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)
    lab = LabPlant(PlantConfig(seed=run_seed, room_temp_c=profile[0].set_point_c, table=table, units=(unit,)))
    lab.table.servo(0.0, True)
    lab.table.demand_angle(0.0, _EAST_DEG)
    at_s = 0.0
    for phase in profile:
        lab.advance(at_s)
        ramp = phase.ramp_k_per_min
        lab.chamber.demand(at_s, set_point_c=phase.set_point_c, ramp_up=ramp, ramp_down=ramp, running=True)
        at_s += round(phase.duration_s)
    lab.advance(at_s)
    count = round(at_s)
    signal, truth = lab.unit("gyro").measure(0.0, count, 1.0), lab.true_drift("gyro")
    bias = truth["bias_dph"]
    return RlgRunData(
        time_s=np.arange(1.0, count + 1.0),
        case_c=truth["case_temp_c"][1:],
        block_c=signal.temp_c,
        bias_dph=np.degrees(signal.angle_increment_rad[:, 0]) * 3600.0,
        true_bias_dph=0.5 * (bias[1:] + bias[:-1]),
    )
