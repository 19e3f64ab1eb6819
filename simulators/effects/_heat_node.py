"""Temperature of a body in air with masses at it: two or three lumped masses in exchange of heat."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K
from simulators.effects._channel import ChannelInputs
from simulators.effects._stimulus import follower

_STEFAN_BOLTZMANN = 5.670374419e-8
_FINE, _MOST_PARTS = 0.1, 16
"""Part of the shortest time constant that a step may be, and the parts into which steps are divided for it."""


class Body(NamedTuple):
    """A body (J/K) in exchange (W/K) with what drives it and with a mass behind it; it turns power into heat."""

    conductance: float
    capacity: float
    inner_capacity: float
    inner_conductance: float
    power_w: float


class Heater(NamedTuple):
    """What is done to a body: `share` of the heat commanded comes, out of a heater's mass (0 J/K for none).

    An opening adds W/K to its exchange; `emissive_area_m2` radiates to surroundings at the drive's temperature.
    """

    share: float = 1.0
    capacity: float = 0.0
    conductance: float = 1.0
    opening_w_per_k: float = 0.0
    emissive_area_m2: float = 0.0


def node_temperature(inputs: ChannelInputs, body: Body, start: float, heater: Heater | None = None) -> Array:
    """Temperature of a body in exchange with `drive`, with a mass behind it and a heater, (n,), degC.

    C dT/dt = (G + Go door) (drive - T) + Gi (Ti - T) + Gh (Th - T) + A s (drive^4 - T^4) + P;
    Ci dTi/dt = Gi (T - Ti); Ch dTh/dt = Gh (T - Th) + heat; all begin at `start`. Without opening and radiation
    it is exact for inputs that are linear between samples (sum of modes), else by the trapezoidal rule.
    """
    heater = heater or Heater()
    opens = bool(len(inputs.door)) and heater.opening_w_per_k != 0.0
    if opens or heater.emissive_area_m2 > 0.0:
        return _by_steps(inputs, body, start, heater)
    return _by_modes(inputs, body, start, heater)


def _by_modes(inputs: ChannelInputs, body: Body, start: float, heater: Heater) -> Array:
    conductance, capacity, inner_j, inner_w, power_w = body
    size = 3 if heater.capacity > 0.0 and len(inputs.heat_w) else 2
    exchange = np.zeros((size, size))
    capacities = np.array([capacity, inner_j, heater.capacity][:size])
    for mass, w_per_k in ((1, inner_w), (2, heater.conductance))[: size - 1]:
        exchange[0, 0] -= w_per_k
        exchange[mass, mass] -= w_per_k
        exchange[0, mass] = exchange[mass, 0] = w_per_k
    exchange[0, 0] -= conductance
    rates, modes = np.linalg.eig(exchange / capacities[:, None])
    rates, modes = rates.real, modes.real  # bodies that exchange heat do not swing
    into = np.zeros((size, len(inputs.drive)))
    into[0] = conductance * inputs.drive + power_w
    if len(inputs.heat_w):
        into[size - 1 if size == 3 else 0] += heater.share * inputs.heat_w
    forcing = np.linalg.solve(modes, into / capacities[:, None])
    at_start = np.linalg.solve(modes, np.full(size, start))
    result = np.zeros(len(inputs.drive))
    for k in range(size):
        forced = follower(-forcing[k] / rates[k], -1.0 / rates[k], inputs.period_s, at_start[k])
        result += modes[0, k] * forced
    return result


def _by_steps(inputs: ChannelInputs, body: Body, start: float, heater: Heater) -> Array:
    conductance, capacity, inner_j, inner_w, power_w = body
    count = len(inputs.drive)
    heat = heater.share * inputs.heat_w if len(inputs.heat_w) else np.zeros(count)
    exchange = np.full(count, conductance)
    if len(inputs.door):
        exchange = np.maximum(conductance + heater.opening_w_per_k * inputs.door, 0.0)
    warm_j, warm_w = (heater.capacity, heater.conductance) if heater.capacity > 0.0 else (1.0, 0.0)
    fastest = max((float(exchange.max()) + inner_w + warm_w) / capacity, inner_w / inner_j, warm_w / warm_j)
    parts = min(max(math.ceil(inputs.period_s * fastest / _FINE), 1), _MOST_PARTS)
    step_s = inputs.period_s / parts
    radiates = _STEFAN_BOLTZMANN * heater.emissive_area_m2
    at_inner = inner_w / (1.0 + 0.5 * step_s * inner_w / inner_j)
    at_warm = warm_w / (1.0 + 0.5 * step_s * warm_w / warm_j)
    stored, by_heat = 2.0 * capacity / step_s, 0.5 * step_s / warm_j
    # middles of the parts of every step: (count - 1, parts)
    within = (np.arange(parts) + 0.5) / parts
    drives, heats, exchanges = (
        (x[:-1, None] + within * np.diff(x)[:, None]).tolist()
        for x in (inputs.drive + ZERO_CELSIUS_K, heat, exchange)
    )
    here = inner = warm = start + ZERO_CELSIUS_K
    result = [here]
    direct = heater.capacity <= 0.0
    for row in zip(drives, heats, exchanges, strict=True):
        for drive, power, g in zip(*row, strict=True):
            cube = radiates * here**3
            supply = warm + by_heat * power
            middle = (
                stored * here
                + g * drive
                + at_inner * inner
                + at_warm * supply
                + (power if direct else 0.0)
                + power_w
                + radiates * drive**4
                + 3.0 * cube * here
            ) / (stored + g + at_inner + at_warm + 4.0 * cube)
            here += 2.0 * (middle - here)
            inner += step_s / inner_j * at_inner * (middle - inner)
            warm += step_s / warm_j * (at_warm * (middle - supply) + (0.0 if direct else power))
        result.append(here)
    return np.array(result) - ZERO_CELSIUS_K
