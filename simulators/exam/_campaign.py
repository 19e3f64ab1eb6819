"""A campaign of runs without the gyro's errors: chamber air, heat flow by layer, table angle, attitude."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from simulators.plant.fog import fog_network, shupe_row
from simulators.plant.fog_parameters import FOG_MID, FogParameters
from simulators.plant.thermal import step_of

LAYERS = 16
LATITUDE_DEG = 39.10
RATE_STEPS_DPS = (1.0, 5.0, 10.0, 20.0, 50.0, 100.0)
STEP_S = 120
POSITION_S = 300
POSITIONS = ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0), (270.0, 90.0), (270.0, -90.0))
"""Table angle and elevation of the sensitive axis, deg."""


@dataclass(frozen=True)
class Profile:
    """Chamber set points, joined linearly, and the phases that begin at them: (time s, degC, name).

    The last one is the end. Conditions are table rates or attitudes.
    """

    name: str
    points: tuple[tuple[float, float, str], ...]
    conditions: tuple[str, ...]

    @property
    def duration_s(self) -> int:
        """Time of the last point."""
        return int(self.points[-1][0])


_SHOCK = (
    (0.0, 25.0, "equilibrium"),
    (3600.0, 25.0, "shock"),
    (3950.0, -45.0, "soak"),
    (8450.0, -45.0, "return"),
    (8800.0, 25.0, "final"),
    (14000.0, 25.0, ""),
)
_SLOW = (
    (0.0, 25.0, "equilibrium"),
    (3000.0, 25.0, "down"),
    (7200.0, -45.0, "soak"),
    (9000.0, -45.0, "up"),
    (13200.0, 25.0, "final"),
    (14000.0, 25.0, ""),
)
PROFILES = (
    Profile("shock east", _SHOCK, ("east",)),
    Profile("shock up", _SHOCK, ("+20", "-20", "0")),
    Profile("slow ramp", _SLOW, ("east",)),
    Profile("quiet", ((0.0, 25.0, "room"), (7200.0, 25.0, "")), ("east",)),
    Profile("rates", ((0.0, 25.0, "steps"), (3000.0, 25.0, "")), ("steps",)),
    Profile("positions", ((0.0, 25.0, "positions"), (3600.0, 25.0, "")), ("six",)),
)


@dataclass(frozen=True)
class RunTruth:
    """One run as it happened, at 1 s; `layer_c` (n, 16) coil layers from inside, `angle_deg` and
    `edge_rate_dps` (n + 1,) at the edges of the samples; `t_in_c`, `t_out_c` the sensors without noise.
    """

    profile: str
    condition: str
    repeat: int
    time_s: Array
    air_c: Array
    t_in_c: Array
    t_out_c: Array
    board_c: Array
    layer_c: Array
    shupe_dph: Array
    angle_deg: Array
    edge_rate_dps: Array
    azimuth_deg: Array
    elevation_deg: Array
    phase: NDArray[np.str_]


@cache
def _plant() -> tuple[Array, int]:
    """Return the one-tick matrix and the number of states of a 16-layer coil."""
    parameters: FogParameters = replace(FOG_MID, layers=LAYERS)
    network = fog_network(parameters)
    layers = [f"layer_{k}" for k in range(LAYERS)]
    outputs = {name: network.row(name) for name in ("spool_sensor", "case_sensor", "board", *layers)}
    outputs["shupe_dph"] = shupe_row(parameters, network, 1)
    return step_of(network, outputs, ("shupe_dph",)), len(network.names)


def simulate_campaign(seed: int, repeats: int) -> list[RunTruth]:
    """Return the runs of all profiles, `repeats` of each condition, after power-on at room temperature."""
    rng = np.random.default_rng((seed, 11))
    result = []
    for profile in PROFILES:
        plans = [(condition, k) for condition in profile.conditions for k in range(repeats)]
        air = np.stack([_air(profile, rng) for _ in plans])
        outputs = heat_flow(air)
        for (condition, repeat), own_air, out in zip(plans, air, outputs, strict=True):
            result.append(_truth(profile, condition, repeat, own_air, out, rng))
    return result


def _air(profile: Profile, rng: np.random.Generator) -> Array:
    times, points = np.array([point[:2] for point in profile.points]).T
    late_s, room_k, cold_k = rng.normal(0.0, 15.0), rng.normal(0.0, 0.5), rng.normal(0.0, 0.5)
    cold = (25.0 - points) / 70.0
    now = np.arange(1.0, profile.duration_s + 1.0)
    wanted = np.interp(now - late_s, times, points + room_k + cold_k * cold)
    overshoot = np.array([0.0, 0.06]) @ np.stack((wanted, np.gradient(wanted) * 100.0))
    from scipy.signal import lfilter  # slow to import

    lagged, _ = lfilter([1 / 40.0], [1.0, -1 + 1 / 40.0], wanted + overshoot, zi=[wanted[0] * (1 - 1 / 40.0)])
    slow = lfilter([np.sqrt(2 / 90.0)], [1.0, -1 + 1 / 90.0], rng.standard_normal(len(now)))
    return np.asarray(lagged + 0.05 * slow)


def heat_flow(air: Array) -> Array:
    """Return outputs (runs, n, 4 + layers) for air (runs, n): T_in, T_out, board, layers, Shupe rotation."""
    matrix, states = _plant()
    runs, n = air.shape
    # power has been off: the unit starts at room temperature, its board's heat still to come
    state = np.full((states + 2, runs), 0.0)
    state[:states] = air[:, 0]
    state[states + 1] = 1.0
    outputs = np.empty((n, len(matrix) - states, runs))
    for k in range(n):
        state[states] = air[:, k]
        new = matrix @ state
        state[:states] = new[:states]
        outputs[k] = new[states:]
    return np.asarray(np.moveaxis(outputs, 2, 0))


def _truth(
    profile: Profile, condition: str, repeat: int, air: Array, out: Array, rng: np.random.Generator
) -> RunTruth:
    n = profile.duration_s
    time_s = np.arange(1.0, n + 1.0)
    motion = _table(condition, n, float(rng.uniform(0.0, 360.0)))
    starts = np.array([start for start, _, _ in profile.points[:-1]])
    names = np.array([name for _, _, name in profile.points[:-1]])
    phase = names[np.searchsorted(starts, time_s - 1.0, side="right") - 1]
    t_in, t_out, board = out.T[:3]
    heat = air, t_in, t_out, board, out[:, 3:-1], out[:, -1]
    return RunTruth(profile.name, condition, repeat, time_s, *heat, *motion, phase)


def _table(condition: str, n: int, start_deg: float) -> tuple[Array, Array, Array, Array]:
    """Return angle and rate at edges (n + 1,), middle angle (n,) and elevation (n,), deg."""
    edges = np.arange(n + 1.0)
    up = np.full(n, 90.0)
    edge_rate = np.zeros(n + 1)
    if condition == "east":
        angle, elevation = np.full(n + 1, 90.0), np.zeros(n)
    elif condition == "steps":
        rates = np.repeat([sign * rate for rate in RATE_STEPS_DPS for sign in (1.0, -1.0)] * 2, STEP_S)
        rates = np.concatenate((np.zeros(n - len(rates)), rates))
        # 50 deg/s2 at every change of rate
        fine = np.repeat(rates, 10)
        eased = _limited(fine, 5.0)
        angle, elevation = np.concatenate(([0.0], np.cumsum(eased) * 0.1))[::10] + start_deg, up
        edge_rate = 0.5 * (np.append(eased, eased[-1]) + np.insert(eased, 0, eased[0]))[::10]
    elif condition == "six":
        at = np.minimum(np.arange(n) // POSITION_S, 2 * len(POSITIONS) - 1) % len(POSITIONS)
        angles, elevations = np.array(POSITIONS).T
        angle, elevation = np.append(angles[at], angles[at[-1]]), elevations[at]
        # the table goes the short way round
        angle = np.unwrap(np.concatenate((angle[:1], angle[:-1])), period=360.0)
    else:
        angle, elevation = start_deg + float(condition) * edges, up
        edge_rate = np.full(n + 1, float(condition))
    return angle, edge_rate, 0.5 * (angle[1:] + angle[:-1]), elevation


def _limited(wanted: Array, step: float) -> Array:
    """Return a signal that follows `wanted` with at most `step` a sample."""
    result = np.empty(len(wanted))
    value = float(wanted[0])
    for index, target in enumerate(wanted.tolist()):
        value += min(max(target - value, -step), step)
        result[index] = value
    return result
