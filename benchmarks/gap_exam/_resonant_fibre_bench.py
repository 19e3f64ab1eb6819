"""The bench of the resonant fibre gyro's lab: a chamber under a PI controller, a gyro of a potted ring in a
well between hub and can, cut into shells by radius, a direct-drive table on a trunnion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter

from benchmarks.gap_exam._campaign import motor_deg
from drivers.base.arrays import Array

HEAT_STEP_S = 2.0
SHELLS = 8
_INNER_M, _OUTER_M, _HEIGHT_M = 0.050, 0.062, 0.020
_CONDUCTING_W_PER_M_K, _HOLDING_J_PER_M3_K = 0.40, 1.8e6
"""Glass and resin, across the winding."""
_EDGES_M = np.linspace(_INNER_M, _OUTER_M, SHELLS + 1)
RADII_M = 0.5 * (_EDGES_M[1:] + _EDGES_M[:-1])
"""Middles of the shells from the hub outwards."""
_BODIES = ("plate", "base", "can", "board", "hub", "coupler")
_CAPACITY_J_PER_K = {
    "plate": 1900.0,
    "base": 380.0,
    "can": 230.0,
    "board": 95.0,
    "hub": 150.0,
    "coupler": 62.0,
}
_AIR_W_PER_K = {"plate": 3.2, "base": 0.6, "can": 1.6}
_BOARD_W = 3.8
_COOLING_K_PER_MIN, _HEATING_K_PER_MIN = 4.5, 6.0
_FLUID_W_PER_K = 18.0
_CHAMBER_S, _RESET_S = 45.0, 500.0
_SERVO_HZ = 1.6

Knots = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Ring:
    """What units differ in: how well the ring sits on its hub, and the base on the plate, W/K."""

    hub_w_per_k: float = 1.0
    plate_w_per_k: float = 4.0


def heat_flow(ring: Ring) -> tuple[Array, Array, Array]:
    """Return capacities J/K (k,), conductances among bodies and shells (k, k) and to the air (k,), W/K."""
    count = len(_BODIES) + SHELLS
    at = {name: number for number, name in enumerate(_BODIES)}
    volumes = np.pi * np.diff(_EDGES_M**2) * _HEIGHT_M
    capacity = np.array([*_CAPACITY_J_PER_K.values(), *(volumes * _HOLDING_J_PER_M3_K)])
    through = 2.0 * np.pi * _CONDUCTING_W_PER_M_K * _HEIGHT_M / np.log(RADII_M[1:] / RADII_M[:-1])
    half_in = 2.0 * np.pi * _CONDUCTING_W_PER_M_K * _HEIGHT_M / np.log(RADII_M[0] / _INNER_M)
    half_out = 2.0 * np.pi * _CONDUCTING_W_PER_M_K * _HEIGHT_M / np.log(_OUTER_M / RADII_M[-1])
    first = len(_BODIES)
    links = [
        (at["plate"], at["base"], ring.plate_w_per_k),
        (at["base"], at["can"], 1.1),
        (at["base"], at["board"], 0.5),
        (at["base"], at["hub"], 1.4),
        (at["hub"], at["coupler"], 0.11),
        (at["can"], at["coupler"], 0.02),
        (at["hub"], first, 1.0 / (1.0 / ring.hub_w_per_k + 1.0 / half_in)),
        (at["can"], count - 1, 1.0 / (1.0 / 0.6 + 1.0 / half_out)),
        *((first + k, first + k + 1, float(w)) for k, w in enumerate(through)),
    ]
    flow = np.zeros((count, count))
    for one, other, w_per_k in links:
        flow[np.ix_((one, other), (one, other))] += w_per_k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return capacity, flow, np.array([_AIR_W_PER_K.get(name, 0.0) for name in _BODIES] + [0.0] * SHELLS)


def heated(set_point_c: Array, fluid_c: Array, pace: Array, ring: Ring) -> dict[str, Array]:
    """Return temperatures (k, r) of several runs from power-on, degC; all starts at the first set point.

    `set_point_c` (k, r) at the heat's steps; `fluid_c` (k, r) flows through the plate, NaN where none does;
    `pace` (r,) is what the chamber can do against its usual. Bodies by name, the shells as "0" .. from the
    hub outwards, and "air". Heat flows by backward Euler steps.
    """
    capacity, flow, to_air = heat_flow(ring)
    share = HEAT_STEP_S / capacity
    onward = np.linalg.inv(np.eye(len(capacity)) + share[:, None] * (flow + np.diag(to_air)))
    air, held = set_point_c[0].copy(), np.zeros(set_point_c.shape[1])
    nodes = np.repeat(set_point_c[:1], len(capacity), axis=0)
    powers = np.zeros(len(capacity))
    powers[_BODIES.index("board")] = _BOARD_W
    down, up = -_COOLING_K_PER_MIN / 60.0 * pace, _HEATING_K_PER_MIN / 60.0 * pace
    taken = []
    for target, fluid in zip(set_point_c, fluid_c, strict=True):
        taken.append(np.concatenate((air[None], nodes)))
        asked = (target - air) / _CHAMBER_S + held
        drive = np.clip(asked, down, up)
        # the controller does not wind up
        held = held + np.where(asked == drive, HEAT_STEP_S * (target - air) / _CHAMBER_S / _RESET_S, 0.0)
        air = air + HEAT_STEP_S * drive
        fed = to_air[:, None] * air + powers[:, None]
        fed[0] += np.where(np.isnan(fluid), 0.0, _FLUID_W_PER_K * (fluid - nodes[0]))
        nodes = onward @ (nodes + share[:, None] * fed)
    whole = np.stack(taken)
    names = ("air", *_BODIES, *(str(k) for k in range(SHELLS)))
    return {name: whole[:, number] for number, name in enumerate(names)}


def refined(values: Array, at_s: Array) -> Array:
    """Return a smooth curve through values at the heat's steps, at other times."""
    return np.asarray(CubicSpline(np.arange(len(values)) * HEAT_STEP_S, values)(at_s))


def servo(motor: Array, step_s: float) -> Array:
    """Return the table's angle behind its demand, at the same edges: a servo of second order."""
    w = 2.0 * np.pi * _SERVO_HZ
    b, a = bilinear([w * w], [1.0, 1.8 * w, w * w], fs=1.0 / step_s)
    return np.asarray(motor[0] + lfilter(b, a, motor - motor[0]))


def turned(rates: Knots, edges_s: Array, start_deg: float, dps2: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return the table's angle at edges where it is sent at rates, and in which steps its rate changes."""
    moving = np.zeros(len(edges_s) - 1, bool)
    last = 0.0
    for start_s, rate in rates:
        moving |= (edges_s[1:] > start_s) & (edges_s[:-1] < start_s + abs(rate - last) / dps2 + 2.0)
        last = rate
    return servo(motor_deg(list(rates), edges_s, start_deg, dps2), edges_s[1] - edges_s[0]), moving


def swung(waves: Sequence[tuple[float, float, float, float, int]], edges_s: Array) -> Array:
    """Return the table's angle of waves in turn: (start s, first Hz, last Hz, deg/s at the first, cycles).

    Frequency grows evenly in time; the swing in angle stays, so rate grows with frequency; each wave ends
    where it began.
    """
    angle = np.zeros(len(edges_s))
    for start_s, first_hz, last_hz, dps, cycles in waves:
        lasting = 2.0 * cycles / (first_hz + last_hz)
        since = np.clip(edges_s - start_s, 0.0, lasting)
        phase = 2.0 * np.pi * (first_hz * since + 0.5 * (last_hz - first_hz) / lasting * since**2)
        angle += dps / (2.0 * np.pi * first_hz) * (1.0 - np.cos(phase))
    return angle


def visited(
    positions: Sequence[tuple[float, float, float]], edges_s: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return angle at edges, elevation in the steps and where either moves; positions (start s, turn, up)."""
    _, turn, up = positions[0]
    knots, turns, ups = [-1.0], [turn], [up]
    for start_s, to_turn, to_up in positions[1:]:
        lasting = max(abs(to_turn - turns[-1]) / 25.0, abs(to_up - ups[-1]) / 12.0, 1.0)
        knots += [start_s, start_s + lasting]
        turns += [turns[-1], to_turn]
        ups += [ups[-1], to_up]
    motor, tumbled = np.interp(edges_s, knots, turns), np.interp(edges_s, knots, ups)
    moving = (np.diff(motor) != 0.0) | (np.diff(tumbled) != 0.0)
    return servo(motor, edges_s[1] - edges_s[0]), 0.5 * (tumbled[1:] + tumbled[:-1]), moving
