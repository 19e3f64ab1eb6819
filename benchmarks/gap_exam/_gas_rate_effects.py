"""Effects of gas rate gyros: jet, wires, bridge, pump, supply, gravity on heated gas.

The jet's deflection is the Coriolis acceleration times the square of the transit time, over two; the wires feel
it as a difference of heat losses. Nothing here is a power series: forms are those of the device.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._gas_rate_bench import FULL_SCALE_DPS, LATITUDE_DEG, heat
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, play, smooth_step
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import encoder, latency, misalignment
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, ZERO_CELSIUS_K

SUTHERLAND_K = 111.0
"""Of nitrogen (White, Viscous Fluid Flow, table 1-2)."""
ROOM_K = 298.15
WIRE_K = 450.0
"""Temperature at which the bridge holds its wires."""
KING_EXPONENT = 0.45
"""King's law, Collis and Williams, J. Fluid Mech. 6 (1959): heat loss A + B v^0.45."""
STILL_SHARE = 0.4
"""Of a wire's heat loss in the jet's flank, what goes without flow."""
COPPER_PER_K = 0.0039
LEAK_SHARE = 0.35
"""Of the pump's stroke at room temperature, what flows back past its valves."""
PLAYS_K = (3.0, 9.0, 22.0)
PLAY_WEIGHTS = (0.5, 0.3, 0.2)
_FLANK = 1.0
"""A wire's distance from the jet's middle, in widths of the jet."""
_BEND_AT_FULL = 0.22
"""The jet's deflection at full scale, in widths of the jet."""
_RAIL_SKEW = 0.4
_EARS_DPS = 7.0
_ALIAS_HZ = (0.06, 0.42)
_LONG_ON_S = np.array([1e7])


def viscosity(kelvin: Array) -> Array:
    """Return the viscosity of nitrogen over that at room temperature, by Sutherland's formula."""
    return np.asarray((kelvin / ROOM_K) ** 1.5 * (ROOM_K + SUTHERLAND_K) / (kelvin + SUTHERLAND_K))


def jet_speed(kelvin: Array) -> Array:
    """Return the jet's speed over that at room temperature: a stroke of fixed volume less what leaks back.

    The nozzle's pressure goes with density, which a sealed cell keeps; the leak is laminar, 1 over viscosity.
    """
    return np.asarray((1.0 - LEAK_SHARE / viscosity(kelvin)) / (1.0 - LEAK_SHARE))


def overheat(kelvin: Array) -> Array:
    """Return a wire's heat loss at fixed temperature over that at room: overheat times conductivity."""
    return np.asarray((WIRE_K - kelvin) / (WIRE_K - ROOM_K) * viscosity(kelvin))


def slope(kelvin: Array) -> Array:
    """Return the slope of a module without compensation over that at room temperature.

    The deflection goes with 1 over the jet's speed, the wires' share with King's power of it and with overheat.
    """
    return np.asarray(overheat(kelvin) * jet_speed(kelvin) ** (KING_EXPONENT - 1.0))


def bridge(bend: Array) -> Array:
    """Return the bridge's output for a jet bent by widths of itself, slope 1 at 0: King's law on both flanks.

    The laminar jet of Bickley has the profile sech^2; each wire's voltage is the root of its heat loss.
    """

    def voltage(at: Array) -> Array:
        return np.asarray(np.sqrt(STILL_SHARE + np.cosh(at) ** (-2.0 * KING_EXPONENT)))

    tiny = np.array(1e-5)
    steep = (voltage(_FLANK - tiny) - voltage(_FLANK + tiny)) / tiny
    return np.asarray((voltage(_FLANK - bend) - voltage(_FLANK + bend)) / steep)


def _kelvin(stage: Stage, node: str) -> Array:
    return stage.body(node) + ZERO_CELSIUS_K


def _rate_dph(stage: Stage) -> Array:
    return DPH_PER_DPS * stage.axis_dps


def _thin_gas(unit: Unit, stage: Stage, size: float) -> Array:
    """Compensation leaves a share `size` of the slope's change with the temperature of the gas."""
    return np.asarray(size * (slope(_kelvin(stage, "gas")) - 1.0) * _rate_dph(stage))


def _bent_far(unit: Unit, stage: Stage, size: float) -> Array:
    """What the electronics' linearisation leaves of the bridge's curve."""
    bend = _BEND_AT_FULL * stage.axis_dps / FULL_SCALE_DPS
    return np.asarray(size * (bridge(bend) / _BEND_AT_FULL * FULL_SCALE_DPS - stage.axis_dps) * DPH_PER_DPS)


def _rail(unit: Unit, stage: Stage, size: float) -> Array:
    """The amplifier meets its rails at 1 - `size` of full scale; an offset puts one of them nearer."""
    limit = FULL_SCALE_DPS * (1.0 - size)
    skew = FULL_SCALE_DPS * size * _RAIL_SKEW * (unit.draw["a"] - 0.5)
    return np.asarray((np.clip(stage.axis_dps, -limit + skew, limit + skew) - stage.axis_dps) * DPH_PER_DPS)


def _unequal_wires(unit: Unit, stage: Stage, size: float) -> Array:
    """One wire is hotter: its side has the larger slope, with a bend where both share the jet."""
    even = np.hypot(stage.axis_dps, _EARS_DPS) - _EARS_DPS
    return np.asarray(size * even * DPH_PER_DPS)


def _across_the_case(unit: Unit, stage: Stage, size: float) -> Array:
    """The wall on the plate is warmer than the lid: the jet bends towards the thinner gas."""
    across = stage.body("plate") - stage.body("case")
    return np.asarray(size * across * ROOM_K / _kelvin(stage, "gas"))


def _gas_before_bead(unit: Unit, stage: Stage, size: float) -> Array:
    """The module compensates by the bead, the wires feel the gas: what is left while both differ, deg/h a K."""
    _, case, gas, _ = heat().warmed(_LONG_ON_S)
    return np.asarray(size * (stage.body("gas") - stage.t_in_c - (gas - case)))


def _pump_warms(unit: Unit, stage: Stage, size: float) -> Array:
    """The pump's winding warms itself: bias by what is missing of its rise, larger where copper is cold."""
    network = heat()
    _, case, _, pump = network.warmed(stage.time_s + stage.power_on_s)
    _, full_case, _, full_pump = network.warmed(_LONG_ON_S)
    missing = 1.0 - (pump - case) / (full_pump - full_case)
    return np.asarray(-size * missing / (1.0 + COPPER_PER_K * (stage.body("plate") - 25.0)))


def _wires_apart(unit: Unit, stage: Stage, size: float) -> Array:
    """Unequal temperature coefficients of the wires: what a trim at two temperatures leaves of their offset."""
    gas = _kelvin(stage, "gas")

    def offset(kelvin: Array) -> Array:
        return np.asarray(np.sqrt(overheat(kelvin)) * (kelvin - ROOM_K) / (WIRE_K - kelvin))

    cold, hot = np.array(263.15), np.array(333.15)
    trim = offset(cold) + (gas - cold) / (hot - cold) * (offset(hot) - offset(cold))
    return np.asarray(100.0 * size * (offset(gas) - trim))


def _plume(unit: Unit, stage: Stage, size: float) -> Array:
    """Hot gas rises: buoyancy pulls the jet along and across; it goes with the Grashof number of thinner gas."""
    gas = _kelvin(stage, "gas")
    grashof = (WIRE_K - gas) / (WIRE_K - ROOM_K) * ROOM_K / gas / viscosity(gas) ** 2
    elevation, roll = np.radians(stage.elevation_deg), 2.0 * math.pi * unit.draw["form"]
    return np.asarray(
        size * grashof * (math.cos(roll) * np.sin(elevation) + math.sin(roll) * np.cos(elevation))
    )


def _sagging_wires(unit: Unit, stage: Stage, size: float) -> Array:
    """Both wires sag out of the jet's middle plane, whichever way is up along the axis: bias by g squared."""
    return np.asarray(size * np.sin(np.radians(stage.elevation_deg)) ** 2)


def _potting(unit: Unit, stage: Stage, size: float) -> Array:
    """The potting gives way in shares: plays of several widths behind the case's temperature."""
    every = max(1, round(5.0 / stage.step_s))
    coarse = stage.body("case")[::every]
    parts = [w * (play(coarse, width) - coarse) for w, width in zip(PLAY_WEIGHTS, PLAYS_K, strict=True)]
    return np.asarray(size * np.interp(np.arange(stage.steps), np.arange(len(coarse)) * every, sum(parts)))


def _stroke_jumps(unit: Unit, stage: Stage, size: float) -> Array:
    """The membrane changes its mode as the pump gets warm, and back a few K below."""
    up = 38.0 + 10.0 * unit.draw["b"]
    state = play(stage.body("pump"), 2.5)
    return np.asarray(size * (state > up))


def _pump_beats(unit: Unit, stage: Stage, size: float) -> Array:
    """The pump's tone folded by the module's own samples: a slow line, not quite the same a run."""
    rng = drawn(unit.seed, "beat", stage.key)
    low, high = _ALIAS_HZ
    hz = low * (high / low) ** unit.draw["c"] + 1e-4 * rng.standard_normal()
    phase = 2.0 * math.pi * rng.uniform()
    return np.asarray(size * np.sin(2.0 * math.pi * hz * stage.time_s + phase))


def _leaking_cell(unit: Unit, stage: Stage, size: float) -> Array:
    """Gas leaks out between runs: density, and with it deflection, falls from run to run to a remainder."""
    return np.asarray(size * 1e-2 * (np.exp(-stage.number / 18.0) - 1.0) * sensed_dph(stage, LATITUDE_DEG))


def _worn_brushes(unit: Unit, stage: Stage, size: float) -> Array:
    """The pump's brushes wear with every start: bursts of bias, more of them with the start's number."""
    rng = drawn(unit.seed, "brushes", stage.key)
    count = int(rng.poisson(stage.seconds / 3600.0 * 0.6 * (1.0 + stage.number)))
    bursts = np.zeros(stage.steps)
    for begin, length in zip(
        rng.uniform(0.0, stage.seconds, count), rng.uniform(20.0, 90.0, count), strict=True
    ):
        bursts += (stage.time_s >= begin) & (stage.time_s < begin + length)
    return np.asarray(size * bursts)


def _turbulent_side(unit: Unit, stage: Stage, size: float) -> Array:
    """Beyond a Reynolds number the jet's flank breaks up, on the side where a burr trips it: it feels less."""
    gas = _kelvin(stage, "gas")
    critical_dps = (38.0 + 12.0 * unit.draw["c1"]) * viscosity(gas) / jet_speed(gas)
    rng = drawn(unit.seed, "eddies", stage.key)
    eddies = follow(rng.standard_normal(stage.steps), 0.5, stage.step_s)
    eddies *= 0.25 / max(float(eddies.std()), 1e-12)
    return np.asarray(-size * smooth_step((stage.axis_dps - critical_dps) / 1.5) * (1.0 + eddies))


def _compressor_hums(unit: Unit, stage: Stage, size: float) -> Array:
    """The jet rectifies the hum of the chamber's compressor while it runs: a share of each cycle, in the cold."""
    return np.asarray(size * follow(stage.body("compressor"), 3.0, stage.step_s))


def _sagging_supply(unit: Unit, stage: Stage, size: float) -> Array:
    """The table's motor pulls the bench supply down as it speeds up; the regulator drops out, the pump slows."""
    dps2 = np.gradient(stage.rate_dps, stage.step_s)
    drop = np.maximum(np.abs(dps2) - 30.0, 0.0) / 100.0
    return np.asarray(size * follow(drop, 8.0, stage.step_s))


def _clinging_jet(unit: Unit, stage: Stage, size: float) -> Array:
    """Bent far to one side, the jet clings to the wall's warm layer and lets go within minutes (Coanda)."""
    pushed = smooth_step((-stage.axis_dps - 55.0) / 3.0)
    charge = follow(pushed, 6.0, stage.step_s)
    return np.asarray(size * follow(charge, 100.0, stage.step_s))


EFFECTS = {
    "thin_gas": Effect(
        _thin_gas, ("scale_factor_temperature", "scale_factor_quadratic"), ("scale_factor_lag",)
    ),
    "bent_far": Effect(_bent_far, ("scale_factor_nonlinearity",)),
    "rail": Effect(_rail, ("saturation",), curved=True, sizes=(1e-6, 0.6), signed=False),
    "unequal_wires": Effect(_unequal_wires, ("scale_factor_asymmetry",)),
    "across_the_case": Effect(_across_the_case, ("gradient",), ("shupe", "thermal_lag", "relaxation")),
    "gas_before_bead": Effect(_gas_before_bead, ("thermal_lag", "relaxation"), ("shupe", "warm_up")),
    "pump_warms": Effect(_pump_warms, ("warm_up",)),
    "wires_apart": Effect(_wires_apart, ("bias_quadratic", "bias_cubic")),
    "plume": Effect(_plume, ("acceleration_sensitivity",), ("heading_sensitivity",)),
    "sagging_wires": Effect(_sagging_wires, ("acceleration_squared",)),
    "potting": Effect(_potting, ("hysteresis",)),
    "stroke_jumps": Effect(_stroke_jumps, ("mode_hop",)),
    "pump_beats": Effect(_pump_beats, ("vibration_or_mains_line",), changing=True),
    "mounting": misalignment(LATITUDE_DEG),
    "encoder": encoder((1, 2), 0.3),
    "filter_delay": latency(LATITUDE_DEG),
    "leaking_cell": Effect(_leaking_cell, changing=True),
    "worn_brushes": Effect(_worn_brushes, changing=True),
    "turbulent_side": Effect(_turbulent_side),
    "compressor_hums": Effect(_compressor_hums),
    "sagging_supply": Effect(_sagging_supply),
    "clinging_jet": Effect(_clinging_jet),
}
