"""The bench of the tuned-rotor lab: a chamber with a cycling fan and layered air, a gyro as a slab with contact
resistance, a motor and a heater, a table driven through a worm gear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter

from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

HEAT_STEP_S = 4.0
STEFAN_BOLTZMANN_W = 5.670374419e-8
"""W/m^2/K^4 (CODATA 2018)."""
_RADIATING_M2 = 0.018
_FILM_W_PER_K = (0.9, 1.7)
"""Air to case, fan off and on."""
_MIXING_S = (160.0, 18.0)
"""Layers of the air settle or mix, fan off and on."""
_WALL_S = 1100.0
_COOLING_K_PER_MIN, _HEATING_K_PER_MIN = 3.0, 4.5
_MOTOR_W = 2.6
_HEATER_C, _HEATER_W_PER_K, _HEATER_MOST_W = -8.0, 0.8, 4.0
_COGS, _COGGING_DEG = 24, 3.0 / 3600.0
_PLAY_DEG = 0.004
_SWAY_HZ, _SWAY_DAMPING = 0.9, 0.15


@dataclass(frozen=True)
class Slab:
    """Conduction in one dimension through cells, and by a joint into a core, by backward Euler steps."""

    cells: int = 8
    capacity_j_per_k: float = 300.0
    through_w_per_k: float = 0.8
    joint_w_per_k: float = 1.1
    core_j_per_k: float = 210.0

    @property
    def capacities(self) -> Array:
        """J/K of the cells from the face inwards and of the core, (cells + 1,)."""
        return np.array([self.capacity_j_per_k / self.cells] * self.cells + [self.core_j_per_k])

    def to_face(self, film_w_per_k: Array) -> Array:
        """Return the conductance from air to the middle of the first cell."""
        return np.asarray(1.0 / (1.0 / film_w_per_k + 0.5 / (self.cells * self.through_w_per_k)))

    def step(self, step_s: float) -> Array:
        """Return the matrix that takes temperatures and K of heat let in to the next, (cells + 1, cells + 1)."""
        inside = self.cells * self.through_w_per_k
        half = 0.5 / inside
        joint = self.joint_w_per_k / (1.0 + self.joint_w_per_k * half)
        between = np.array([inside] * (self.cells - 1) + [joint])
        flow = np.zeros((self.cells + 1, self.cells + 1))
        for cell, w_per_k in enumerate(between):
            flow[cell : cell + 2, cell : cell + 2] += w_per_k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return np.asarray(np.linalg.inv(np.eye(self.cells + 1) + step_s * flow / self.capacities[:, None]))


def fan_of(seconds: float, rng: np.random.Generator) -> Array:
    """Return a fan's state, 0 or 1, at the heat's steps: on 100 to 180 s, off 50 to 90 s, at no fixed beat."""
    steps = int(seconds / HEAT_STEP_S) + 2
    on_off = rng.uniform((100.0, 50.0), (180.0, 90.0), (int(seconds / 150.0) + 2, 2)).ravel()
    switches = np.cumsum(on_off) - rng.uniform(0.0, 200.0)
    return np.asarray((np.searchsorted(switches, np.arange(steps) * HEAT_STEP_S) % 2 == 0).astype(float))


def heated(set_point_c: Array, fan: Array, slab: Slab) -> dict[str, Array]:
    """Return temperatures (k, r) of several runs from power-on, degC: everything starts at the first set point.

    `set_point_c` and `fan` (k, r) at the heat's steps. Nodes: "air", "top" of the air, "face", "middle" and
    "inner" of the slab, "core".
    """
    supply, wall, layers = set_point_c[0].copy(), set_point_c[0].copy(), np.zeros_like(set_point_c[0])
    nodes = np.repeat(set_point_c[:1], slab.cells + 1, axis=0)
    onward, per_j = slab.step(HEAT_STEP_S), HEAT_STEP_S / slab.capacities
    films = slab.to_face(np.array(_FILM_W_PER_K))
    down, up = (HEAT_STEP_S / 60.0 * k for k in (_COOLING_K_PER_MIN, _HEATING_K_PER_MIN))
    taken = []
    for target, blown in zip(set_point_c, fan, strict=True):
        supply = supply + np.clip(0.06 * (target - supply), -down, up)
        wall = wall + HEAT_STEP_S / _WALL_S * (supply - wall)
        standing = (1.0 - blown) * np.clip(0.12 * (supply - wall), -4.0, 4.0)
        layers = layers + HEAT_STEP_S / np.where(blown > 0.5, _MIXING_S[1], _MIXING_S[0]) * (
            standing - layers
        )
        air = supply - 0.5 * layers
        warm, cold = nodes[0] + ZERO_CELSIUS_K, wall + ZERO_CELSIUS_K
        heat = np.zeros_like(nodes)
        heat[0] = np.where(blown > 0.5, films[1], films[0]) * (air - nodes[0])
        heat[0] += STEFAN_BOLTZMANN_W * _RADIATING_M2 * (cold**4 - warm**4)
        heat[-2] = np.clip(_HEATER_W_PER_K * (_HEATER_C - nodes[-2]), 0.0, _HEATER_MOST_W)
        heat[-1] = _MOTOR_W
        taken.append(np.stack((air, supply + 0.5 * layers, *nodes[[0, slab.cells // 2, -2, -1]])))
        nodes = onward @ (nodes + per_j[:, None] * heat)
    whole = np.stack(taken)
    return {
        name: whole[:, number]
        for number, name in enumerate(("air", "top", "face", "middle", "inner", "core"))
    }


def refined(values: Array, at_s: Array) -> Array:
    """Return a smooth curve through values at the heat's steps, at other times."""
    return np.asarray(CubicSpline(np.arange(len(values)) * HEAT_STEP_S, values)(at_s))


def limited_rate(
    knots: Sequence[tuple[float, float]], edges_s: Array, dps_per_s: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the motor's angle in deg at edges and whether it speeds up or brakes in the steps between."""
    times, rates = [edges_s[0]], [0.0]
    for start_s, rate in knots:
        times += [start_s, start_s + max(abs(rate - rates[-1]) / dps_per_s, 1e-3)]
        rates += [rates[-1], rate]
    knot_s, rate_dps = np.array([*times, edges_s[-1] + 1.0]), np.array([*rates, rates[-1]])
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (rate_dps[1:] + rate_dps[:-1]) * np.diff(knot_s))))
    # the integral of a polygon, exactly
    k = np.clip(np.searchsorted(knot_s, edges_s, "right") - 1, 0, len(knot_s) - 2)
    since = edges_s - knot_s[k]
    slope = (rate_dps[k + 1] - rate_dps[k]) / np.maximum(knot_s[k + 1] - knot_s[k], 1e-9)
    at = angle[k] + since * (rate_dps[k] + 0.5 * slope * since)
    changing = np.diff(np.interp(edges_s, knot_s, rate_dps)) != 0.0
    return np.asarray(at), np.asarray(changing)


def driven(motor_deg: Array, step_s: float) -> Array:
    """Return the table's angle behind motor, worm gear and shaft, at the same edges.

    The motor cogs, the gear has play, the shaft sways: w^2 / (s^2 + 2 d w s + w^2).
    """
    cogged = motor_deg + _COGGING_DEG * np.sin(np.radians(_COGS * motor_deg))
    behind = np.empty_like(cogged)
    held = cogged[0]
    for k, angle in enumerate(cogged.tolist()):
        held = min(max(held, angle - _PLAY_DEG), angle + _PLAY_DEG)
        behind[k] = held
    w = 2.0 * np.pi * _SWAY_HZ
    b, a = bilinear([w * w], [1.0, 2.0 * _SWAY_DAMPING * w, w * w], fs=1.0 / step_s)
    return np.asarray(behind[0] + lfilter(b, a, behind - behind[0]))
