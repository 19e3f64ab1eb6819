"""A lab for a triad of fibre-optic gyros: heat through a wound coil, a chamber on liquid nitrogen, a hydraulic
table that sticks and slips.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from drivers.base.arrays import Array

LAYERS = 32
CHAMBER_S = 0.5
ROOM_C = 23.0
_COIL_J_PER_K, _COIL_W_PER_K = 720.0, 0.45
"""Heat capacity of the potted ring and conductance through its 20 mm."""
_JOINT_W_PER_K, _GAP_W_PER_K = 2.0, 0.25
"""Innermost layer to the hub, outermost layer through the air gap to the shield."""
_HUB_J_PER_K, _HOUSING_J_PER_K, _HUB_TO_HOUSING_W_PER_K = 500.0, 1800.0, 3.5
_FILM_W_PER_K, _TABLE_W_PER_K = 9.0, 0.6
_ELECTRONICS_W = 6.0
"""Of the three gyros, their source and their boards."""
_AIR_J_PER_K, _WALL_J_PER_K, _WALL_W_PER_K, _OUT_W_PER_K = 2500.0, 9000.0, 25.0, 4.0
_NITROGEN_W, _HEATER_W = 1500.0, 1200.0
_DEAD_S, _PULSE_S, _PROBE_S = 10.0, 10.0, 20.0
_PER_K, _PER_K_S = 0.12, 0.0012
BODIES = ("air", "housing", "hub", "coil", "wound", "valve")


def wound_weights() -> Array:
    """Return how a quadrupole winding weighs the warming of each layer, inside first, (LAYERS,).

    From its middle the fibre is wound in turn from both ends, + - - + + - - +. What warms at some distance from
    the middle counts with that distance, with one sign on one half and the other on the other (Shupe).
    """
    signs = np.array([1.0 if j % 4 in (0, 3) else -1.0 for j in range(LAYERS)])
    from_middle = np.array([j // 2 + 0.5 for j in range(LAYERS)])
    return np.asarray(signs * from_middle / (LAYERS / 2))


def conduction() -> tuple[Array, Array, Array]:
    """Return rates of change of layers, hub and housing: (n, n) by themselves, (n,) by air and by table and
    heat, 1/s and K/s.

    The ring is a slab in layers of equal thickness: the heat equation in finite volumes.
    """
    n = LAYERS + 2
    hub, housing = LAYERS, LAYERS + 1
    capacity = np.full(n, _COIL_J_PER_K / LAYERS)
    capacity[hub], capacity[housing] = _HUB_J_PER_K, _HOUSING_J_PER_K
    between = _COIL_W_PER_K * LAYERS
    half = 1.0 / (2.0 * between)
    links = [(j, j + 1, between) for j in range(LAYERS - 1)]
    links += [(0, hub, 1.0 / (1.0 / _JOINT_W_PER_K + half))]
    links += [
        (LAYERS - 1, housing, 1.0 / (1.0 / _GAP_W_PER_K + half)),
        (hub, housing, _HUB_TO_HOUSING_W_PER_K),
    ]
    flows = np.zeros((n, n))
    for one, other, conductance in links:
        flows[one, one] -= conductance
        flows[other, other] -= conductance
        flows[one, other] += conductance
        flows[other, one] += conductance
    flows[housing, housing] -= _FILM_W_PER_K + _TABLE_W_PER_K
    by_air, given = np.zeros(n), np.zeros(n)
    by_air[housing] = _FILM_W_PER_K
    given[hub], given[housing] = _ELECTRONICS_W, _TABLE_W_PER_K * ROOM_C
    return flows / capacity[:, None], by_air / capacity, given / capacity


def chambered(set_points_c: Array, pulse_phase: float, *, cold_start: bool) -> dict[str, Array]:
    """Return air, housing, hub, mean of the coil, its weighted winding and the valve (0, 1), (n,) each.

    Demands (n,) every CHAMBER_S. A run begins settled at the first demand; after a cold start the electronics
    have only just begun to heat. The valve opens for a share of each pulse, and nitrogen comes late.
    """
    flows, by_air, given = conduction()
    n = len(given)
    onward = expm(np.block([[flows, by_air[:, None], given[:, None]], [np.zeros((2, n + 2))]]) * CHAMBER_S)[
        :n
    ]
    air = wall = probe = float(set_points_c[0])
    state = np.full(n + 2, air)
    if not cold_start:
        state[:n] = np.linalg.solve(flows, -by_air * air - given)
    state[n + 1] = 1.0
    wound_up, late = 0.0, [0] * round(_DEAD_S / CHAMBER_S)
    kept: list[tuple[float, ...]] = []
    weights, clock = wound_weights(), pulse_phase * _PULSE_S
    share = 0.0
    shown = np.zeros((4, n + 2))
    shown[0, LAYERS + 1] = shown[1, LAYERS] = 1.0
    shown[2, :LAYERS], shown[3, :LAYERS] = 1.0 / LAYERS, weights
    both, read = np.vstack((onward, shown)), np.empty(n + 4)
    for wanted in set_points_c.tolist():
        probe += (air - probe) * CHAMBER_S / _PROBE_S
        error = wanted - probe
        # the integral winds up within the actuators' range only
        wound_up = min(max(wound_up + _PER_K_S * error * CHAMBER_S, -0.6), 0.6)
        share = min(max(_PER_K * error + wound_up, -1.0), 1.0)
        clock = (clock + CHAMBER_S) % _PULSE_S
        opened = int(clock < -share * _PULSE_S)
        late.append(opened)
        power_w = max(share, 0.0) * _HEATER_W - late.pop(0) * _NITROGEN_W
        state[n] = air
        np.dot(both, state, out=read)
        seen = read[n:].tolist()
        kept.append((air, *seen, opened))
        into_wall = _WALL_W_PER_K * (air - wall)
        state[:n] = read[:n]
        air += CHAMBER_S * (power_w - into_wall - _FILM_W_PER_K * (air - seen[0])) / _AIR_J_PER_K
        wall += CHAMBER_S * (into_wall - _OUT_W_PER_K * (wall - ROOM_C)) / _WALL_J_PER_K
    return dict(zip(BODIES, np.array(kept).T.copy(), strict=True))


_SPRING_PER_S2 = (2.0 * math.pi * 5.0) ** 2
_VISCOUS_PER_S = 2.0 * 0.5 * math.sqrt(_SPRING_PER_S2)
STATIC_DEG, KINETIC_DEG = 0.03, 0.012
"""By how much oil and hoses yield before the seals slip, and while they slide fast."""
_STRIBECK_DPS = 0.1
_INNER = 10


def hydraulic(demand_deg: Array, step_s: float) -> Array:
    """Return the angle of a table driven through its oil against the friction of its seals, deg, (m + 1,).

    x'' = spring (demand - x) - damping x' - friction; the friction is static at rest, falls with speed
    (Stribeck), and the seals stick again wherever the table stands still.
    """
    if np.ptp(demand_deg) < 1e-12:
        return demand_deg
    short = step_s / _INNER
    kinetic, static = _SPRING_PER_S2 * KINETIC_DEG, _SPRING_PER_S2 * STATIC_DEG
    place, speed = float(demand_deg[0]), 0.0
    above, exp, found = static - kinetic, math.exp, [place]
    inner = [k / _INNER for k in range(_INNER)]
    for before, after in pairwise(demand_deg.tolist()):
        moved = after - before
        pulled = moved / step_s
        if speed == 0.0 and abs(before - place) < STATIC_DEG and abs(after - place) < STATIC_DEG:
            found.append(place)
            continue
        for part in inner:
            force = _SPRING_PER_S2 * (before + part * moved - place)
            if speed == 0.0:
                if abs(force) < static:
                    continue
                speed = short * (force - static if force > 0.0 else force + static)
            else:
                slides = kinetic + above * exp((-speed if speed > 0.0 else speed) / _STRIBECK_DPS)
                force += _VISCOUS_PER_S * (pulled - speed)
                faster = speed + short * (force - slides if speed > 0.0 else force + slides)
                if faster * speed <= 0.0:
                    speed = 0.0
                    continue
                speed = faster
            place += short * speed
        found.append(place)
    return np.array(found)
