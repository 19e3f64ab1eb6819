"""Recordings of the emulated lab's physics (chamber controller, heat network) as a run folder gives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._channel_data import ChannelSeries
from simulators.effects import ChannelInputs, Demand
from simulators.plant.chamber import ChamberAir, ChamberDemand, ChamberParameters
from simulators.plant.fog import fog_network
from simulators.plant.fog_parameters import FOG_MID, FogThermal
from simulators.plant.noise import NoiseSource
from simulators.plant.thermal import tick_matrix

PROFILE = ((0.0, 25.0), (3600.0, -45.0), (8400.0, 25.0))
END_S = 15000
_STEP_S = 10


def recorded(
    seed: int,
    chamber: ChamberParameters | None = None,
    thermal: FogThermal | None = None,
    *,
    ramp_k_per_min: float = 12.0,
    sensor: tuple[float, float] = (0.0, 0.0),
) -> list[ChannelSeries]:
    """Air, case and gyro temperature of a cold shock; `sensor` is the gyro sensor's offset in K and gain in %."""
    rng = np.random.default_rng(seed)
    air = ChamberAir(chamber or ChamberParameters(), 25.0, NoiseSource(seed, "chamber"))
    network = fog_network(replace(FOG_MID, thermal=thermal or FogThermal()))
    names = ("case_sensor", "spool_sensor")
    rows = np.stack([network.row(name) for name in names])
    step = tick_matrix(network, rows, np.zeros_like(rows))
    size = len(network.names)
    state = np.append(np.full(size, 25.0), (0.0, 1.0))
    values = np.empty((END_S, 3))
    for tick in range(END_S):
        for start, target in PROFILE:
            if tick == start:
                air.apply(ChamberDemand(start, target, ramp_k_per_min, ramp_k_per_min, True))
        air.tick()
        state[size] = air.unit_air_c(tick)
        found = step @ state
        state[:size] = found[:size]
        values[tick] = air.air_c, found[size], found[size + 1]
    values[:, 2] = 25.0 + (values[:, 2] - 25.0) * (1.0 + 0.01 * sensor[1]) + sensor[0]
    values[:, 1:] += rng.normal(0.0, 0.02, (END_S, 2))
    values = np.round(values, 2)
    means = values.reshape(-1, _STEP_S, 3).mean(axis=1).T
    time_s = (np.arange(len(means[0])) + 0.5) * _STEP_S
    return _series(f"run {seed}", time_s, means, values[0], ramp_k_per_min)


def _series(
    run_id: str,
    time_s: NDArray[np.float64],
    means: NDArray[np.float64],
    first: NDArray[np.float64],
    ramp: float,
) -> list[ChannelSeries]:
    demands = tuple(Demand(start, target, ramp / 60.0) for start, target in PROFILE)
    target = np.array([each.target for each in demands])[
        np.searchsorted([each.time_s for each in demands], time_s, side="right") - 1
    ]
    phase = np.array(["reference", "shock", "return"])[
        np.searchsorted([3600.0, 8400.0], time_s, side="right")
    ]
    since = (
        time_s
        - np.array([start for start, _ in PROFILE])[
            np.searchsorted([start for start, _ in PROFILE], time_s, side="right") - 1
        ]
    )
    quiet = since > 350.0 + 1800.0
    air, case, _ = means
    inputs = (
        ChannelInputs(time_s, target, float(air[0]), _STEP_S, demands),
        ChannelInputs(time_s, air, float(first[1]), _STEP_S),
        ChannelInputs(time_s, case, float(first[2]), _STEP_S),
    )
    names = ("chamber_air", "case_temperature", "gyro_temperature")
    return [
        ChannelSeries(name, run_id, own, values, phase, quiet, 0.01)  # type: ignore[arg-type]
        for name, own, values in zip(names, inputs, means, strict=True)
    ]


def turned(
    seed: int,
    *,
    error_ppm: float = 0.0,
    servo_ppm: float = 0.0,
    bearing_ppm: float = 0.0,
    angle_noise: float = 0.0,
) -> ChannelSeries:
    """Rate telemetry of a table at 6 deg/s for 1200 s whose bearing rubs once and twice a turn, not as a sine."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(1200.0)
    rate = 6.0 * (1.0 + 1e-6 * error_ppm)
    angle = rate * time_s
    turn = np.radians(angle)
    rub = bearing_ppm * np.exp(2.0 * (np.cos(turn - 0.7) - 1.0)) + servo_ppm * np.cos(2.0 * turn)
    values = rate * (1.0 + 1e-6 * rub) + rng.normal(0.0, 2e-6 + angle_noise, len(time_s))
    inputs = ChannelInputs(time_s, np.full(len(time_s), 6.0), 6.0, 1.0, (), angle % 360.0)
    phase = np.full(len(time_s), "turn")
    return ChannelSeries(
        "table_rate", f"turn {seed}", inputs, values, phase, np.ones(len(time_s), bool), 1e-6
    )
