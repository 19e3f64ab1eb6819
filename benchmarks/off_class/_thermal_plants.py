"""Five gyros over temperature by five physics, none of them the emulated fibre gyro's nor any model's.

Each integrates its own heat flow at 1 s for all runs side by side and returns temperatures, bias and scale-factor
error; `seed` draws its parameters. Magnitudes are set on the first training profile: 0.4 deg/h and 300 ppm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.off_class._profiles import Plant, Truth, scaled
from drivers.base.arrays import Array

Nodes = dict[str, Array]


def _vary(seed: int, salt: int) -> Callable[[float], float]:
    rng = np.random.default_rng((seed, salt))
    return lambda value: float(value * (1.0 + 0.15 * rng.uniform(-1.0, 1.0))) if seed else value


def _truths(t_in: Array, t_out: Array, bias: Array, factor: Array) -> list[Truth]:
    return [Truth(*(part[:, k] for part in (t_in, t_out, bias, factor))) for k in range(t_in.shape[1])]


def _integrate(air: Array, start: Nodes, rates: Callable[[Nodes, Array, int], Nodes]) -> Nodes:
    """Euler at 1 s from two hours at the first air temperature; returns each state over time, (n, runs)."""
    runs = air.shape[1]
    state = {name: np.broadcast_to(value, (runs,)).astype(np.float64) for name, value in start.items()}
    for name in state:
        state[name] = state[name] + (air[0] if name.startswith("t_") else 0.0)
    kept = {name: np.empty(air.shape) for name in state}
    for k, now in enumerate(air):
        slopes = rates(state, now, k)
        state = {name: value + slopes[name] for name, value in state.items()}
        for name, value in state.items():
            kept[name][k] = value
    return kept


def convection(seed: int = 0) -> Plant:
    """Natural convection, frost and its latent heat, electronics that saturate, play, interference fringes."""
    v = _vary(seed, 1)
    free, metal, seat, inner, power = v(0.9), v(0.35), v(0.22), v(0.12), v(2.6)

    def rates(s: Nodes, air: Array, k: int) -> Nodes:
        drop = air - s["t_case"]
        flow = free * np.abs(drop) ** 0.25 * drop
        # Room air leaks in: ice grows on a case below the frost point, and melts at 0 degC with its latent heat.
        freezing = np.where((s["t_case"] < -5.0) & (air > s["t_case"]), 2e-3, 0.0)
        melting = np.where((s["t_case"] > 0.0) & (s["ice"] > 0.0), np.minimum(s["ice"], 6e-3), 0.0)
        latent = 334.0 * (freezing - melting)
        into, spool = metal * (s["t_case"] - s["t_spool"]), seat * (s["t_spool"] - s["t_core"])
        board = inner * (s["t_case"] - s["t_board"])
        return {
            "t_case": (flow + latent - into - board) / 800.0,
            "t_spool": (into - spool) / 110.0,
            "t_core": spool / 85.0,
            "t_board": (board + power * (1.0 - np.exp(-k / 30.0))) / 55.0,
            "ice": freezing - melting,
        }

    def plant(air: Array) -> list[Truth]:
        s = _integrate(
            air, dict.fromkeys(("t_case", "t_spool", "t_core", "t_board", "ice"), np.zeros(1)), rates
        )
        core, board, spool = s["t_core"], s["t_board"], s["t_spool"]
        slip, gap = np.empty_like(core), v(1.5)
        held = core[0] - spool[0]
        for k in range(len(core)):  # a joint with play follows the strain only beyond its gap
            held = np.clip(held, core[k] - spool[k] - gap, core[k] - spool[k] + gap)
            slip[k] = held
        warm = (core - 25.0) / 40.0
        bias = scaled(
            [
                warm + 0.4 * warm**2,
                core - spool,
                slip,
                np.sin(2.0 * np.pi * board / v(11.0)),
                np.tanh((board - 20.0) / v(18.0)),
            ],
            [0.15, 0.18, 0.06, 0.02, 0.09],
        )
        factor = scaled(
            [np.tanh((board - 10.0) / v(30.0)), warm, slip, np.cos(2.0 * np.pi * board / v(11.0))],
            [210.0, 80.0, 18.0, 6.0],
        )
        return _truths(spool, s["t_case"], bias, factor)

    return plant


def polymer(seed: int = 0) -> Plant:
    """A potting whose stress relaxes in three arms, slower in the cold (Williams-Landel-Ferry); radiation."""
    v = _vary(seed, 2)
    surface, radiate, seat = v(1.3), v(4e-9), v(0.16)
    taus, cold = (v(200.0), v(1500.0), v(9000.0)), v(0.035)
    layers = 6

    def rates(s: Nodes, air: Array, k: int) -> Nodes:
        case = s["t_case"]
        flow = surface * (air - case)
        glow = radiate * ((case + 273.15) ** 4 - (s["t_0"] + 273.15) ** 4)
        bottom = seat * (case - s[f"t_{layers - 1}"])
        slopes: Nodes = {"t_case": (flow - glow - bottom) / 650.0}
        # Conductivity grows with temperature, so the coil is no linear chain.
        steps = [
            0.25 * (1.0 + 0.004 * (s[f"t_{j}"] + s[f"t_{j + 1}"]) / 2.0) * (s[f"t_{j + 1}"] - s[f"t_{j}"])
            for j in range(layers - 1)
        ]
        for j in range(layers):
            gained = (steps[j] if j < layers - 1 else bottom) - (steps[j - 1] if j else -glow)
            slopes[f"t_{j}"] = gained / 22.0
        mean = sum(s[f"t_{j}"] for j in range(layers)) / layers
        change = sum(slopes[f"t_{j}"] for j in range(layers)) / layers
        for j, tau in enumerate(taus):
            slower = np.exp(np.clip(cold * (25.0 - mean), -3.0, 4.0))
            slopes[f"arm_{j}"] = change - s[f"arm_{j}"] / (tau * slower)
        return slopes

    def plant(air: Array) -> list[Truth]:
        names = ("t_case", *(f"t_{j}" for j in range(layers)), "arm_0", "arm_1", "arm_2")
        s = _integrate(air, dict.fromkeys(names, np.zeros(1)), rates)
        coil = np.mean([s[f"t_{j}"] for j in range(layers)], axis=0)
        stress = s["arm_0"] + 0.8 * s["arm_1"] + 0.5 * s["arm_2"]
        skew = s["t_5"] - s["t_0"]
        bias = scaled([stress, stress * coil, skew, np.exp((coil - 25.0) / 60.0)], [0.18, 0.05, 0.16, 0.12])
        factor = scaled([coil, stress, np.exp((coil - 25.0) / 80.0)], [190.0, 90.0, 60.0])
        return _truths(s["t_3"], s["t_case"], bias, factor)

    return plant


def relays(seed: int = 0) -> Plant:
    """Magnetic and mechanical hysteresis as 80 relays (Preisach), EMF of a gradient, depolarised light."""
    v = _vary(seed, 3)
    rng = np.random.default_rng((seed, 33))
    surface, seat, core = v(1.1), v(0.3), v(0.14)

    def rates(s: Nodes, air: Array, k: int) -> Nodes:
        into, deep = seat * (s["t_case"] - s["t_body"]), core * (s["t_body"] - s["t_core"])
        fan = surface * (1.0 + 0.5 * np.tanh(np.abs(air - s["t_case"]) / 15.0))
        return {
            "t_case": (fan * (air - s["t_case"]) - into) / 900.0,
            "t_body": (into - deep + 1.5) / 180.0,
            "t_core": deep / 120.0,
        }

    def plant(air: Array) -> list[Truth]:
        s = _integrate(air, dict.fromkeys(("t_case", "t_body", "t_core"), np.zeros(1)), rates)
        core_c, case, body = s["t_core"], s["t_case"], s["t_body"]
        centre, width = rng.uniform(-50.0, 30.0, 80), rng.uniform(1.0, 9.0, 80)
        on = core_c[0][:, None] > centre
        count = np.empty_like(core_c)
        for k in range(len(core_c)):
            now = core_c[k][:, None]
            on = (on & (now > centre - width)) | (now > centre + width)
            count[k] = on.mean(axis=1)
        emf = (case - body) * np.abs(case - body)
        light = np.sin(0.05 * v(1.0) * (case - 25.0)) * (1.0 + 0.01 * (core_c - 25.0))
        bias = scaled([count, case - core_c, emf, light], [0.2, 0.14, 0.05, 0.08])
        factor = scaled([core_c + 0.003 * (core_c - 25.0) ** 2, count, case - core_c], [220.0, 50.0, 40.0])
        return _truths(body, case, bias, factor)

    return plant


def shell(seed: int = 0) -> Plant:
    """A vibrating shell in vacuum: radiation and a stem carry heat, damping has a peak, electrodes charge."""
    v = _vary(seed, 4)
    stem, glow, board, spread_k = v(0.02), v(1.6e-9), v(0.3), v(28.0)

    def rates(s: Nodes, air: Array, k: int) -> Nodes:
        case = s["t_case"]
        into = glow * ((case + 273.15) ** 4 - (s["t_shell"] + 273.15) ** 4) + stem * (case - s["t_shell"])
        to_board = board * (case - s["t_board"])
        tau = 1500.0 * np.exp(np.clip((25.0 - s["t_shell"]) / spread_k, -3.0, 3.0))
        return {
            "t_case": (1.6 * (air - case) - into - to_board) / 600.0,
            "t_shell": into / 30.0,
            "t_board": (to_board + 1.2) / 40.0,
            "charge": (np.tanh((s["t_shell"] - 25.0) / 40.0) - s["charge"]) / tau,
        }

    def plant(air: Array) -> list[Truth]:
        s = _integrate(air, dict.fromkeys(("t_case", "t_shell", "t_board", "charge"), np.zeros(1)), rates)
        quartz, electronics = s["t_shell"], s["t_board"]
        hot = np.exp((quartz - 10.0) / v(17.0))
        peak = hot / (1.0 + hot**2)  # Zener: loss against temperature at a fixed frequency
        phase = np.sqrt(np.clip(electronics + 80.0, 0.0, None))
        bias = scaled([peak, peak * phase, s["charge"], electronics - s["t_case"]], [0.16, 0.12, 0.08, 0.08])
        factor = scaled([quartz + 0.002 * quartz**2, phase, s["charge"]], [180.0, 90.0, 40.0])
        return _truths(electronics, s["t_case"], bias, factor)

    return plant


def regulated(seed: int = 0) -> Plant:
    """A source held at 30 degC by a heat pump that saturates; the inner sensor sits on a far wall."""
    v = _vary(seed, 5)
    wall, ring, pump, sensor_s = v(0.5), v(0.12), v(0.09), v(90.0)

    def rates(s: Nodes, air: Array, k: int) -> Nodes:
        wanted = np.clip(0.8 * (30.0 - s["t_source"]) + 0.004 * s["sum"], -4.0, 4.0)
        free = np.abs(wanted) < 4.0
        to_wall, to_ring = wall * (s["t_case"] - s["t_wall"]), ring * (s["t_wall"] - s["t_ring"])
        leak = pump * (s["t_wall"] - s["t_source"])
        return {
            "t_case": (1.2 * (air - s["t_case"]) - to_wall) / 750.0,
            "t_wall": (to_wall - to_ring - leak - wanted + 0.4 * np.abs(wanted)) / 160.0,
            "t_ring": to_ring / 95.0,
            "t_source": (wanted + leak) / 12.0,
            "sum": np.where(free, 30.0 - s["t_source"], 0.0),
            "t_seen": (s["t_wall"] - s["t_seen"]) / sensor_s,
        }

    def plant(air: Array) -> list[Truth]:
        names = ("t_case", "t_wall", "t_ring", "t_source", "sum", "t_seen")
        s = _integrate(air, dict.fromkeys(names, np.zeros(1)), rates)
        rate = np.gradient(s["t_ring"], axis=0)
        stiff = np.abs(np.minimum(s["t_ring"] + 15.0, 0.0)) ** 1.5
        bias = scaled(
            [s["t_ring"], s["t_wall"] - s["t_ring"], rate * (1.0 + 0.02 * stiff), stiff],
            [0.12, 0.16, 0.1, 0.07],
        )
        factor = scaled([s["t_source"] - 30.0, s["t_wall"], s["t_ring"]], [120.0, 120.0, 120.0])
        return _truths(s["t_seen"], s["t_case"], bias, factor)

    return plant


FAMILIES: dict[str, Callable[[int], Plant]] = {
    "convection, frost, play": convection,
    "relaxing polymer": polymer,
    "relays": relays,
    "vibrating shell": shell,
    "regulated source": regulated,
}
