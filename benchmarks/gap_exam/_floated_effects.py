"""What goes wrong in a floated rate-integrating gyro, at its pulse-rebalance loop, on its table and in its log.

Each function returns what an effect of some size adds to the rate, deg/h, (m,). The forms are those of the parts:
flow through a gap, flotation by hyperbolas, friction, a magnet with a knee, random bearings.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._floated_bench import FASTEST_DPS, LATITUDE_DEG
from benchmarks.gap_exam._geometry import lean_of, sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, markov, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

TURN_RAD = 2.0 * math.pi
REFERENCE_C = 30.0
"""The fluid's temperature on a bench at room temperature: the unit was trimmed there."""
FULL_DPH = 3600.0 * FASTEST_DPS
NO_LIMIT_DPS = 25.7
"""A limit there is out of the table's reach, overshoot and all."""
WORST_ARCSEC = (1.0, 7200.0)
"""No lab puts an axis 2 degrees off without a look at it."""


def thinned(fluid_c: Array) -> Array:
    """Return the fluid's viscosity over that at REFERENCE_C: Andrade's law, a factor of 10 in some 40 K."""
    return np.asarray(np.exp(4700.0 * (1.0 / (fluid_c + 273.15) - 1.0 / (REFERENCE_C + 273.15))))


def bellows_flow(unit: Unit, stage: Stage) -> Array:
    """Return the pressure over the gap as fluid is pumped by its expansion, 1 at about 1 K/min.

    Friction in the gap goes with the flow, the loss at its entrance with the flow's square.
    """
    flow = slope_per_min(stage.body("fluid"), stage.step_s)
    return np.asarray(flow * (1.0 + (0.2 + 0.5 * unit.draw["a"]) * np.abs(flow)))


def pumped_fluid(unit: Unit, stage: Stage, size: float) -> Array:
    """Fluid on its way to the bellows drags the float; size in deg/h at about 1 K/min."""
    return size * bellows_flow(unit, stage)


def thick_fluid(unit: Unit, stage: Stage, size: float) -> Array:
    """The drag of pumped fluid where it is thicker than on the bench; trimmed away where it is as thick."""
    return size * bellows_flow(unit, stage) * np.minimum(thinned(stage.body("fluid")) - 1.0, 8.0)


def bell_convection(unit: Unit, stage: Stage, size: float) -> Array:
    """Convection between end bells: the flow starts slowly and goes with the power 5/4 of what drives it."""
    apart = stage.body("case") - stage.body("fluid") + 2.0 * (stage.body("bell_a") - stage.body("bell_b"))
    driven = apart - (-2.5 + unit.draw["a"])
    return np.asarray(size * np.sign(driven) * np.abs(driven) ** 1.25 / 5.0)


def flotation(unit: Unit, stage: Stage, size: float) -> Array:
    """Buoyancy of a fluid that thins by a hyperbola, without what a straight line takes up; deg/h 50 K away."""
    x = (stage.body("fluid") - REFERENCE_C) / 50.0
    bend = 0.35 + 0.25 * unit.draw["b"]
    return np.asarray(size * (1.0 / (1.0 + bend * x) - 1.0 + bend * x) / (1.0 / (1.0 + bend) - 1.0 + bend))


def lead_friction(unit: Unit, stage: Stage, size: float) -> Array:
    """Flex leads that stick: four sliders with thresholds from 1.5 to 20 K, two of them soft."""
    case = stage.body("case")
    thresholds = np.array([1.5, 4.0, 9.0, 20.0]) * (0.8 + 0.4 * unit.draw["c"])
    shares = np.array([0.15, 0.35, 0.30, 0.20])
    total = np.zeros(stage.steps)
    for number, (width, share) in enumerate(zip(thresholds, shares, strict=True)):
        held = stretched(case, width) / width
        total += share * (np.tanh(1.6 * held) / math.tanh(1.6) if number % 2 else held)
    return size * total


def stretched(values: Array, width: float) -> Array:
    """Return how far an elastic slider that slips at `width` is stretched, (m,); relaxed at the first value.

    Turning points alone decide, so that the loop is short.
    """
    stretch, last, out = 0.0, float(values[0]), np.empty(len(values))
    for k, value in enumerate(values.tolist()):
        stretch = min(max(stretch + value - last, -width), width)
        last = value
        out[k] = stretch
    return out


def cement_creep(unit: Unit, stage: Stage, size: float) -> Array:
    """Cement under the gimbal creeps: a spectrum of lags from 4 min to 2 h behind the case; deg/h a 30 K."""
    times = 240.0 * 30.0 ** (np.arange(7) / 6.0)
    weights = np.exp(-(((np.arange(7) / 6.0 - unit.draw["c1"]) / 0.35) ** 2))
    case = stage.body("case")
    return size * (case - spectrum_of_lags(case, times.tolist(), weights.tolist(), stage.step_s)) / 30.0


def grease_after_start(unit: Unit, stage: Stage, size: float) -> Array:
    """Grease finds its place in the wheel's bearings: a hyperbola of the time since switching on."""
    since_s = stage.power_on_s + stage.time_s
    settles_s = (300.0 + 600.0 * unit.draw["a"]) * thinned(stage.body("float")[:1])[0] ** 0.3
    return np.asarray(size * (1.0 + since_s / settles_s) ** -1.4)


def magnet_knee(unit: Unit, stage: Stage, size: float) -> Array:
    """A shunt around the torquer's magnet that stops to compensate above its Curie knee; ppm at 25 K above."""
    magnet = 0.6 * stage.body("bell_b") + 0.4 * stage.body("case")
    knee, wide = 26.0 + 8.0 * unit.draw["b"], 7.0
    ppm = size * (wide * np.log1p(np.exp((magnet - knee) / wide)) - 0.25 * (magnet - REFERENCE_C)) / 20.0
    return np.asarray(1e-6 * ppm * sensed_dph(stage, LATITUDE_DEG))


def pulse_mismatch(unit: Unit, stage: Stage, size: float) -> Array:
    """Positive pulses heavier than negative ones, mixed within the limit cycle about zero; ppm."""
    rate = sensed_dph(stage, LATITUDE_DEG)
    mixed = 40.0 + 200.0 * unit.draw["a"]
    return np.asarray(0.5e-6 * size * (np.sqrt(rate**2 + mixed**2) - mixed))


def torquer_iron(unit: Unit, stage: Stage, size: float) -> Array:
    """Iron that the torquer's own current drives along its curve; ppm at high rates, none at low ones."""
    share = sensed_dph(stage, LATITUDE_DEG) / (FULL_DPH * (0.25 + 0.4 * unit.draw["c2"]))
    return np.asarray(1e-6 * size * sensed_dph(stage, LATITUDE_DEG) * share**2 / (1.0 + share**2))


def current_limit(unit: Unit, stage: Stage, size: float) -> Array:
    """The pulse source runs out of current `size` deg/s below NO_LIMIT_DPS; a soft corner."""
    rate = sensed_dph(stage, LATITUDE_DEG) / 3600.0
    soft = 0.02
    over = np.clip((np.abs(rate) - (NO_LIMIT_DPS - size)) / soft, -60.0, 1e6)
    return np.asarray(-3600.0 * np.sign(rate) * soft * np.logaddexp(0.0, over))


def pivot_friction(unit: Unit, stage: Stage, size: float) -> Array:
    """Pivots that stick: below `size` deg/h the float stays where it is, above it slips ever more freely."""
    rate = sensed_dph(stage, LATITUDE_DEG)
    return np.asarray(-rate / (1.0 + (rate / size) ** 2) ** 0.75)


def flange_lean(unit: Unit, stage: Stage, size: float) -> Array:
    """A flange off square by `size` arcsec; it opens by a tenth over 50 K."""
    lean = lean_of(math.radians(size / 3600.0), TURN_RAD * unit.draw["lean"])
    off = sensed_dph(stage, LATITUDE_DEG, lean_rad=lean) - sensed_dph(stage, LATITUDE_DEG)
    return np.asarray(off * (1.0 + 0.1 * (stage.body("case") - REFERENCE_C) / 50.0))


def mirror_azimuth(unit: Unit, stage: Stage, size: float) -> Array:
    """The case stands `size` arcsec off the mirror that gave north."""
    azimuth = math.radians(size / 3600.0)
    return sensed_dph(stage, LATITUDE_DEG, azimuth_rad=azimuth) - sensed_dph(stage, LATITUDE_DEG)


def pier_tilt(unit: Unit, stage: Stage, size: float) -> Array:
    """The pier leans by `size` arcsec towards a fixed direction."""
    tilt = lean_of(math.radians(size / 3600.0), TURN_RAD * unit.draw["tilt"])
    return sensed_dph(stage, LATITUDE_DEG, tilt_rad=tilt) - sensed_dph(stage, LATITUDE_DEG)


def encoder_arcsec(unit: Unit, angle_deg: Array) -> Array:
    """Return what an eccentric, oval encoder disc adds to an angle, arcsec for a size of 1."""
    turn = np.radians(angle_deg)
    first, second = TURN_RAD * unit.draw["phase"], TURN_RAD * unit.draw["order"]
    share = 0.2 + 0.5 * unit.draw["form"]
    return np.asarray(
        np.sin(turn + first) + share * np.sin(2.0 * turn + second) + 0.08 * np.sin(5.0 * turn + first)
    )


def eccentric_encoder(unit: Unit, stage: Stage, size: float) -> Array:
    """The disc's error is taken for a motion of the table, hence the gyro seems to miss it; arcsec."""
    read = encoder_arcsec(unit, stage.angle_deg)
    return np.asarray(-size * np.diff(read) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


def late_rate(stage: Stage, delay_s: Array | float) -> Array:
    """Return what a delay of the table's motion along the axis adds, deg/h; the table stood before the run."""
    edges = np.arange(stage.steps + 1) * stage.step_s
    late = np.interp(edges - delay_s, edges, stage.angle_deg) - stage.angle_deg
    return np.asarray(3600.0 * np.diff(late) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


def latch_delay(unit: Unit, stage: Stage, size: float) -> Array:
    """The counter is latched `size` ms after the encoder."""
    return late_rate(stage, 1e-3 * size)


def counter_clock(unit: Unit, stage: Stage, size: float) -> Array:
    """The counter's quartz is off by `size` ppm against the table's, and by a little more as the lab warms."""
    edges = np.arange(stage.steps + 1) * stage.step_s
    return late_rate(stage, 1e-6 * size * edges * (1.0 + 0.05 * edges / 3600.0))


def mass_shift(unit: Unit, stage: Stage, size: float) -> Array:
    """The float's mass is off its axis, and its frame yields: deg/h/g, and a part with the square of g."""
    angle = TURN_RAD * unit.draw["g1"]
    up, level = np.sin(np.radians(stage.elevation_deg)), np.cos(np.radians(stage.elevation_deg))
    return np.asarray(size * (math.cos(angle) * up + math.sin(angle) * level + 0.2 * up * level))


def pier_steel(unit: Unit, stage: Stage, size: float) -> Array:
    """Steel in the pier pulls at the torquer's magnet: more near one heading, and thrice a turn a little."""
    middle = np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1])) - TURN_RAD * unit.draw["phase"]
    return np.asarray(size * (np.tanh(1.5 * np.cos(middle)) + 0.2 * np.cos(3.0 * middle)))


def wheel_beat(unit: Unit, stage: Stage, size: float) -> Array:
    """The wheel's supply beats with the pulse clock: a line whose phase wanders, with a weaker second one."""
    rng = drawn(unit.seed, "beat", stage.key)
    steps = math.sqrt(stage.step_s / 400.0) * rng.standard_normal(stage.steps)
    phase = TURN_RAD * (rng.uniform() + (0.06 + 0.14 * unit.draw["c1"]) * stage.time_s) + np.cumsum(steps)
    return np.asarray(size * (np.sin(phase) + 0.25 * np.sin(2.0 * phase)))


def retainer_place(unit: Unit, stage: Stage, size: float) -> Array:
    """The bearing's retainer has two places; it changes at one warmth going up and at another going down."""
    warm = 38.0 + 6.0 * unit.draw["b"]
    cold = warm - 3.0 - 6.0 * unit.draw["a"]
    body = stage.body("float")
    place, places = float(body[0] > 0.5 * (warm + cold)), np.empty(stage.steps)
    decided = np.where(body > warm, 1, np.where(body < cold, 0, -1))
    for k, value in enumerate(decided.tolist()):
        place = place if value < 0 else float(value)
        places[k] = place
    return size * follow(places, 8.0, stage.step_s)


def lead_slips(unit: Unit, stage: Stage, size: float) -> Array:
    """Flex leads slip some times an hour: kicks of either sign, over in seconds, some far larger."""
    rng = drawn(unit.seed, "slips", stage.key)
    hours = stage.steps * stage.step_s / 3600.0
    count = int(rng.poisson((4.0 + 10.0 * unit.draw["a"]) * hours)) + 1
    kicks = np.zeros(stage.steps)
    heights = rng.choice((-1.0, 1.0), count) * np.minimum(rng.pareto(2.0, count) + 0.5, 12.0)
    np.add.at(kicks, rng.integers(0, stage.steps, count), heights)
    decay = math.exp(-stage.step_s / 1.2)
    return size * np.asarray(lfilter([1.0], [1.0, -decay], kicks))


def gas_bubble(unit: Unit, stage: Stage, size: float) -> Array:
    """A bubble climbs to the upper end as fast as the fluid is thin, grows in warmth and dissolves when hot."""
    fluid = stage.body("fluid")
    upper = np.sin(np.radians(stage.elevation_deg + 20.0 * (unit.draw["a"] - 0.5)))
    climbs = stage.step_s / ((200.0 + 500.0 * unit.draw["b"]) * np.clip(thinned(fluid), 0.05, 20.0))
    volume = smooth_step((46.0 - fluid) / 2.5) * (fluid + 273.15) / 300.0
    # it was carried in with the other end up
    place, places = float(-0.5 * upper[0]), np.empty(stage.steps)
    for k, (end, share) in enumerate(zip(upper.tolist(), climbs.tolist(), strict=True)):
        place += share * (end - place)
        places[k] = place
    return np.asarray(size * places * volume)


def leaking_case(unit: Unit, stage: Stage, size: float) -> Array:
    """A case that is not tight feels the weather and the door of the lab, each behind a leak; deg/h a hPa."""
    rng = drawn(unit.seed, "weather", stage.key)
    gaps = np.full(stage.steps, stage.step_s)
    weather = markov(2.5, 9000.0, gaps, rng) + markov(0.25, 150.0, gaps, rng)
    return size * follow(weather, 60.0 + 500.0 * unit.draw["c"], stage.step_s)


def supply_dips(unit: Unit, stage: Stage, size: float) -> Array:
    """The compressor pulls the mains down, the wheel's supply sags with it: a torque while it runs."""
    load = stage.body("compressor")
    # it runs at 15 % at least; less is the smoothing's tail
    sag = 0.6 * (load > 0.075) + 0.4 * load
    return size * follow(sag, 6.0 + 20.0 * unit.draw["b"], stage.step_s)


def retainer_whirl(unit: Unit, stage: Stage, size: float) -> Array:
    """Bursts of a whirling retainer: on and off at random, more often and longer in a stiff, cold bearing."""
    rng = drawn(unit.seed, "whirl", stage.key)
    stiff = np.clip(thinned(stage.body("float")), 0.3, 6.0)
    begins = stage.step_s / (1500.0 / stiff)
    ends = stage.step_s / (220.0 * np.sqrt(stiff))
    chance = rng.uniform(size=stage.steps)
    on, state = False, np.empty(stage.steps)
    for k, (luck, begin, end) in enumerate(zip(chance.tolist(), begins.tolist(), ends.tolist(), strict=True)):
        on = luck >= end if on else luck < begin
        state[k] = on
    return size * follow(state, 3.0, stage.step_s)


def coil_glow(unit: Unit, stage: Stage, size: float) -> Array:
    """The coil's own warmth, which no sensor sees, bends the leads for minutes after a fast leg."""
    heat = (stage.axis_dps / FASTEST_DPS) ** 2
    return size * follow(heat, 120.0 + 250.0 * unit.draw["c2"], stage.step_s)


def magnet_ageing(unit: Unit, stage: Stage, size: float) -> Array:
    """The magnet loses strength from run to run, quickly at first; ppm in the end."""
    lost = -math.expm1(-stage.number / (6.0 + 14.0 * unit.draw["a"]))
    return np.asarray(1e-6 * size * lost * sensed_dph(stage, LATITUDE_DEG))


_ORIENTED = ("axis_misalignment", "azimuth_error", "table_tilt")
EFFECTS = {
    # drag of pumped fluid, convection and a lag behind the case go together as long as the ramps are slow
    "pumped_fluid": Effect(pumped_fluid, ("shupe",), beside=("gradient", "thermal_lag")),
    "thick_fluid": Effect(thick_fluid, ("shupe_cross",), beside=("shupe",)),
    "bell_convection": Effect(bell_convection, ("gradient",), beside=("shupe", "thermal_lag")),
    "flotation": Effect(flotation, ("bias_quadratic", "bias_cubic")),
    "lead_friction": Effect(lead_friction, ("hysteresis",)),
    "cement_creep": Effect(cement_creep, ("thermal_lag", "relaxation")),
    "grease_after_start": Effect(grease_after_start, ("warm_up",)),
    "magnet_knee": Effect(magnet_knee, ("scale_factor_temperature", "scale_factor_quadratic")),
    "pulse_mismatch": Effect(pulse_mismatch, ("scale_factor_asymmetry",)),
    "torquer_iron": Effect(torquer_iron, ("scale_factor_nonlinearity",)),
    "current_limit": Effect(current_limit, ("saturation",), curved=True, sizes=(0.05, 8.0), signed=False),
    "pivot_friction": Effect(
        pivot_friction, ("dead_zone", "lock_in"), curved=True, sizes=(1e-4, 100.0), signed=False
    ),
    "flange_lean": Effect(
        flange_lean, ("axis_misalignment",), beside=_ORIENTED[1:], curved=True, sizes=WORST_ARCSEC
    ),
    "mirror_azimuth": Effect(
        mirror_azimuth,
        ("azimuth_error",),
        beside=(_ORIENTED[0], _ORIENTED[2]),
        curved=True,
        sizes=WORST_ARCSEC,
    ),
    "pier_tilt": Effect(pier_tilt, ("table_tilt",), beside=_ORIENTED[:2], curved=True, sizes=WORST_ARCSEC),
    "eccentric_encoder": Effect(
        eccentric_encoder, ("table_rate_ripple", "table_wobble_once", "table_wobble_twice")
    ),
    "latch_delay": Effect(latch_delay, ("time_offset",)),
    "counter_clock": Effect(counter_clock, ("clock_skew",), beside=("time_offset",)),
    "mass_shift": Effect(mass_shift, ("acceleration_sensitivity",)),
    # once a turn of a level axis is also what a wrong north does
    "pier_steel": Effect(pier_steel, ("heading_sensitivity",), beside=_ORIENTED),
    "wheel_beat": Effect(wheel_beat, ("vibration_or_mains_line",), changing=True),
    "retainer_place": Effect(retainer_place, ("mode_hop",)),
    "lead_slips": Effect(lead_slips, ("impulses",), changing=True),
    "gas_bubble": Effect(gas_bubble),
    "leaking_case": Effect(leaking_case, changing=True),
    "supply_dips": Effect(supply_dips),
    "retainer_whirl": Effect(retainer_whirl, changing=True),
    "coil_glow": Effect(coil_glow),
    "magnet_ageing": Effect(magnet_ageing, changing=True),
}
