"""A small lab for a hemispherical resonator: Peltier chamber with a cycling fan, turntable on a toothed belt."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter

from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

ROOM_C = 22.0
_AIR_J_PER_K, _CAN_J_PER_K, _FLANGE_J_PER_K = 1800.0, 150.0, 400.0
_LEAK_W_PER_K = 0.9
_HEATS_W, _COOLS_W, _LESS_W_PER_K = 180.0, 95.0, 1.1
"""A Peltier stack at no difference, and the cooling power it loses for each kelvin below the room."""
_FILM_W_PER_K = (1.5, 4.0)
"""Air to can with the fan off and on."""
_CAN_TO_FLANGE_W_PER_K = 1.6
_BRACKET_W_PER_K = 0.1
_ELECTRONICS_W = 2.5
_STEM_PER_S, _RADIATED_PER_S = 1.0 / 900.0, 1.0 / 2400.0
"""What the shell gains a second for each kelvin: by its stem from the flange, by radiation from the can."""
_PROPORTIONAL_W_PER_K, _INTEGRAL_W_PER_K_S = 60.0, 0.25
_BELT_HZ, _BELT_DAMPING = 4.0, 0.08
PULLEYS = 3.7
"""Turns of the motor for one of the table."""
_ECCENTRIC_DEG, _TEETH, _TOOTH_DEG = 0.01, 20, 0.0005
BODIES = ("air", "can", "flange", "shell", "fan")


@dataclass(frozen=True)
class Fan:
    """The chamber's fan: its period, s, and where in it a run begins, 0 to 1."""

    period_s: float
    phase: float


def chambered(set_points_c: Array, step_s: float, fan: Fan, *, cold_start: bool) -> dict[str, Array]:
    """Return air, can, flange and shell, degC, and whether the fan ran (0, 1), each (n,), for demands (n,).

    Air, can and flange are heat balances in W; the shell in its vacuum follows stem and walls. A run begins
    settled; after a cold start the electronics have only just begun to heat.
    """
    start_c = float(set_points_c[0])
    air = start_c
    flange, can = (start_c, start_c) if cold_start else _settled(start_c)
    shell = (_STEM_PER_S * flange + _RADIATED_PER_S * can) / (_STEM_PER_S + _RADIATED_PER_S)
    pump_w = _LEAK_W_PER_K * (start_c - ROOM_C)
    wound_w, phase, effort = pump_w, fan.phase, 0.1
    kept = np.empty((5, len(set_points_c)))
    for k, wanted in enumerate(set_points_c.tolist()):
        phase = (phase + step_s / fan.period_s) % 1.0
        running = phase < 0.35 + 0.5 * effort
        error = wanted - air
        most, least = _HEATS_W, -max(_COOLS_W - _LESS_W_PER_K * max(ROOM_C - air, 0.0), 0.0)
        asked = wound_w + _PROPORTIONAL_W_PER_K * error
        pump_w = min(max(asked, least), most)
        if pump_w == asked:
            wound_w += _INTEGRAL_W_PER_K_S * error * step_s
        effort = pump_w / most if pump_w > 0.0 else pump_w / least
        film_w = _FILM_W_PER_K[running] * (air - can)
        inward_w = _CAN_TO_FLANGE_W_PER_K * (can - flange)
        lost_w = _BRACKET_W_PER_K * (flange - ROOM_C)
        kept[:, k] = air, can, flange, shell, running
        shell += step_s * (_STEM_PER_S * (flange - shell) + _RADIATED_PER_S * radiated_k(can, shell))
        air += step_s * (pump_w - _LEAK_W_PER_K * (air - ROOM_C) - film_w) / _AIR_J_PER_K
        can += step_s * (film_w - inward_w) / _CAN_J_PER_K
        flange += step_s * (inward_w + _ELECTRONICS_W - lost_w) / _FLANGE_J_PER_K
    return dict(zip(BODIES, kept, strict=True))


def _settled(air_c: float) -> tuple[float, float]:
    """Return flange and can, degC, in balance with the air, the fan on for its usual share of the time."""
    film = 0.6 * _FILM_W_PER_K[0] + 0.4 * _FILM_W_PER_K[1]
    through = 1.0 / (1.0 / film + 1.0 / _CAN_TO_FLANGE_W_PER_K)
    flange = (_ELECTRONICS_W + _BRACKET_W_PER_K * ROOM_C + through * air_c) / (through + _BRACKET_W_PER_K)
    return flange, air_c + through * (flange - air_c) / film


def radiated_k(from_c: float, to_c: float) -> float:
    """Return the difference, K, near 25 degC that radiates as much as two temperatures do."""
    near = 25.0 + ZERO_CELSIUS_K
    return float(((from_c + ZERO_CELSIUS_K) ** 4 - (to_c + ZERO_CELSIUS_K) ** 4) / (4.0 * near**3))


def belted(motor: Array, step_s: float) -> Array:
    """Return the table's angle behind pulleys, teeth and the belt's spring, deg, at edges (m + 1,)."""
    turn = np.radians(PULLEYS * motor)
    pulled = motor + _ECCENTRIC_DEG * np.sin(turn) + _TOOTH_DEG * np.sin(_TEETH * turn)
    omega = 2.0 * math.pi * _BELT_HZ
    damping = 2.0 * _BELT_DAMPING * omega
    top, bottom, _ = cont2discrete(([damping, omega**2], [1.0, damping, omega**2]), step_s, method="foh")
    return np.asarray(pulled[0] + lfilter(np.ravel(top), bottom, pulled - pulled[0]))
