"""Whole thermal runs without bytes: a chamber profile through the lab's own ticks, as arrays at 1 s.

Same physics and noise as the emulated lab, for developing models and testing fits: 16,000 s take under a second.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.kit.config import Mounting
from simulators.plant.chamber import ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig, UnitKind
from simulators.plant.model import UnitModel
from simulators.plant.table import TableParameters

_EAST_DEG = 90.0
_REFERENCE_S = 1800.0


@dataclass(frozen=True)
class Phase:
    """Part of a chamber profile: go to `set_point_c` at `ramp_k_per_min` (0 = at once); lasts `duration_s`."""

    name: str
    set_point_c: float
    duration_s: float
    ramp_k_per_min: float = 0.0


@dataclass(frozen=True)
class ThermalRunData:
    """One run, row k covering the second that ends at `time_s[k]`; arrays (n,).

    `rate_dps` is the gyro's mean output over the second with noise and Earth rate, `bias_dph` the same less the
    table's rate, in deg/h. `true_bias_dph` is the mean of the effects and turn-on (no noise, no Earth rate),
    `true_sf_error_ppm` that of the scale-factor error at rest. `t_in_c`, `t_out_c` are the unit's own sensor and
    the one on its case; `air_temp_c`, `set_point_c` the chamber's. `phase` holds the phase's name for each row,
    `reference_s` start and end of the 30 min before the first shock.
    """

    time_s: NDArray[np.float64]
    t_in_c: NDArray[np.float64]
    t_out_c: NDArray[np.float64]
    rate_dps: NDArray[np.float64]
    bias_dph: NDArray[np.float64]
    true_bias_dph: NDArray[np.float64]
    true_sf_error_ppm: NDArray[np.float64]
    coil_temp_c: NDArray[np.float64]
    coil_rate_k_per_min: NDArray[np.float64]
    air_temp_c: NDArray[np.float64]
    set_point_c: NDArray[np.float64]
    phase: NDArray[np.str_]
    reference_s: tuple[float, float]


@dataclass(frozen=True)
class RunSetup:
    """What a run is made on: unit, seeds, table rate, place and chamber."""

    model: UnitKind = "fog_mid"
    unit_seed: int = 0
    run_seed: int = 0
    rate_dps: float = 0.0
    mounting: Mounting = "axis_horizontal"
    latitude_deg: float = 39.10
    change: Callable[[UnitModel], UnitModel] | None = None
    chamber: ChamberParameters = field(default_factory=ChamberParameters)


def simulate_thermal_run(profile: Sequence[Phase], setup: RunSetup) -> ThermalRunData:
    """Run a FOG through a chamber profile from power-on at the first phase's set point.

    The table stands at 90 deg (axis east-west) or, with the axis up, turns at `setup.rate_dps` from power-on. It
    is free of ripple here; the first row includes its spin-up. Phase durations are rounded to whole seconds.
    """
    room_c = profile[0].set_point_c
    lab = _lab(setup, room_c)
    starts_s = np.concatenate(([0.0], np.cumsum([round(phase.duration_s) for phase in profile])))
    for phase, start_s in zip(profile, starts_s[:-1], strict=True):
        ramp = phase.ramp_k_per_min
        lab.advance(float(start_s))
        lab.chamber.demand(
            float(start_s), set_point_c=phase.set_point_c, ramp_up=ramp, ramp_down=ramp, running=True
        )
    count = round(float(starts_s[-1]))
    lab.advance(float(count))
    return _collect(lab, profile, starts_s, count, setup.rate_dps)


def cold_shock(
    *,
    cold_c: float = -45.0,
    ramp_k_per_min: float = 12.0,
    soak_min: float = 75.0,
    room_c: float = 25.0,
    grade: Literal["mid", "nav"] = "mid",
    unit_seed: int = 0,
    run_seed: int = 0,
    rate_dps: float = 0.0,
    mounting: Mounting | None = None,
    equilibrium_min: float = 90.0,
    return_min: float = 90.0,
    shocks: int = 1,
    between_min: float = 20.0,
) -> ThermalRunData:
    """Cold shock: equilibrium at room, ramp down, soak, ramp back, `return_min` more at room (nominal: 16,000 s).

    Of several `shocks` each but the first begins `between_min` after the set point is back at room.
    Without `mounting` the axis is horizontal, east-west, for `rate_dps` 0 (a bias run) and up for other rates;
    the zero-rate run of a scale-factor group needs `mounting="axis_up"`. A slow ramp is `ramp_k_per_min=3`.
    """
    profile = [
        *_start(room_c, equilibrium_min),
        *_shock(cold_c, room_c, ramp_k_per_min, soak_min, between_min) * (shocks - 1),
        *_shock(cold_c, room_c, ramp_k_per_min, soak_min, return_min),
    ]
    return simulate_thermal_run(profile, _setup(grade, unit_seed, run_seed, rate_dps, mounting))


def _start(room_c: float, equilibrium_min: float) -> list[Phase]:
    seconds = equilibrium_min * 60.0
    reference = min(_REFERENCE_S, seconds)
    return [Phase("equilibrium", room_c, seconds - reference), Phase("reference", room_c, reference)]


def _shock(cold_c: float, room_c: float, ramp: float, soak_min: float, after_min: float) -> list[Phase]:
    ramp_s = abs(room_c - cold_c) / ramp * 60.0
    return [
        Phase("shock", cold_c, ramp_s, ramp),
        Phase("soak", cold_c, soak_min * 60.0, ramp),
        Phase("return", room_c, ramp_s, ramp),
        Phase("final_equilibrium", room_c, after_min * 60.0, ramp),
    ]


def _setup(
    grade: Literal["mid", "nav"], unit_seed: int, run_seed: int, rate_dps: float, mounting: Mounting | None
) -> RunSetup:
    return RunSetup(
        model="fog_mid" if grade == "mid" else "fog_nav",
        unit_seed=unit_seed,
        run_seed=run_seed,
        rate_dps=rate_dps,
        mounting=mounting or ("axis_up" if rate_dps else "axis_horizontal"),
    )


def _lab(setup: RunSetup, room_c: float) -> LabPlant:
    """Return a lab with the one unit, its table where the run needs it."""
    unit = UnitConfig(
        "gyro", setup.model, unit_seed=setup.unit_seed, mounting=setup.mounting, change=setup.change
    )
    table = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0, max_acceleration_dps2=1000.0)
    lab = LabPlant(
        PlantConfig(setup.latitude_deg, setup.run_seed, room_c, setup.chamber, table, units=(unit,))
    )
    lab.table.servo(0.0, True)
    if setup.mounting == "axis_horizontal":
        lab.table.demand_angle(0.0, _EAST_DEG)
    else:
        lab.table.demand_rate(0.0, setup.rate_dps)
    return lab


def _collect(
    lab: LabPlant, profile: Sequence[Phase], starts_s: NDArray[np.float64], count: int, rate_dps: float
) -> ThermalRunData:
    signal = lab.unit("gyro").measure(0.0, count, 1.0)
    truth, air = lab.true_drift("gyro"), lab.chamber.record()
    time_s = np.arange(1.0, count + 1.0)
    output_dps = np.degrees(signal.angle_increment_rad[:, 0])
    names = np.array([phase.name for phase in profile])
    shock_s = float(next(t for t, name in zip(starts_s, names, strict=False) if name == "shock"))
    return ThermalRunData(
        time_s=time_s,
        t_in_c=signal.temp_c,
        t_out_c=truth["case_temp_c"][1:],
        rate_dps=output_dps,
        bias_dph=(output_dps - rate_dps) * 3600.0,
        true_bias_dph=_second_means(truth["bias_dph"]),
        true_sf_error_ppm=_second_means(truth["sf_error_ppm"]),
        coil_temp_c=truth["coil_temp_c"][1:],
        coil_rate_k_per_min=truth["coil_rate_k_per_min"][1:],
        air_temp_c=air["air_temp_c"][1:],
        set_point_c=air["set_point_c"][1:],
        phase=names[np.searchsorted(starts_s[1:-1], time_s - 1.0, side="right")],
        reference_s=(shock_s - _REFERENCE_S, shock_s),
    )


def _second_means(at_ticks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over each second of a quantity that is linear between ticks, (n + 1,) -> (n,)."""
    return 0.5 * (at_ticks[1:] + at_ticks[:-1])
