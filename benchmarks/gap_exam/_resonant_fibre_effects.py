"""What may be wrong with a resonant fibre gyro and its bench, as far as the catalogue has a name for it.

Forms: moments of temperature over the ring's shells (Mohr, J. Lightwave Technol. 14, 27, 1996, has the delay
integral); a Maxwell element whose time grows in the cold; Preisach relays (Mayergoyz, 1991); a discriminator
of a Lorentzian line in a loop of finite gain; Adler's beat (Proc. IRE 34, 351, 1946) under phase noise.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._resonant_fibre_bench import RADII_M, SHELLS
from benchmarks.gap_exam._resonant_fibre_foreign import FOREIGN, LATITUDE_DEG, ROOM_C, ring_c
from benchmarks.gap_exam._signals import drawn, follow, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import known, skew, tilt
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph

_FASTEST_DPS = 120.0
_LENGTH_SHARE = RADII_M / RADII_M.sum()
"""The fibre's length in each shell: it is wound outwards layer by layer."""
_HERTZ_PER_DPS = 926.0
"""Split of the resonances: diameter / (wavelength index), 0.12 m / (1.55 um 1.46)."""
_MEMORY_S = 5.0
"""Step of what depends on the past."""
_TURNS = 400


def _input_dps(stage: Stage) -> Array:
    """Return the true rate that the ring feels, of the table and of the Earth."""
    return sensed_dph(stage, LATITUDE_DEG) / 3600.0


def _shells(stage: Stage) -> Array:
    return np.stack([stage.body(str(k)) for k in range(SHELLS)])


def _delay(unit: Unit, stage: Stage, size: float) -> Array:
    """Both ways pass a warming piece of fibre at different times: the more, the farther from the middle.

    The splice is not the middle: a part of the mean rate of change is left.
    """
    passed = np.cumsum(_LENGTH_SHARE) - 0.5 * _LENGTH_SHARE
    lever = _LENGTH_SHARE * (1.0 - 2.0 * (passed - 0.15 - 0.2 * unit.draw["a"]))
    return size * slope_per_min(lever @ _shells(stage), stage.step_s)


def _stiff_resin(unit: Unit, stage: Stage, size: float) -> Array:
    """The resin is stiff below its glass transition: stress builds up with shrinking and flows off.

    It flows off the slower the colder.
    """
    often = np.arange(0.0, stage.steps * stage.step_s + _MEMORY_S, _MEMORY_S)
    warm = np.interp(often, stage.time_s, ring_c(stage))
    glass_c = -20.0 + 14.0 * unit.draw["c"]
    fed = 60.0 * np.gradient(warm, _MEMORY_S) * smooth_step((glass_c - warm) / 4.5)
    keeps_s = np.clip((100.0 + 90.0 * unit.draw["b"]) * np.exp((glass_c - warm) / 25.0), 40.0, 600.0)
    stress, result = float(fed[0]), np.empty(len(often))
    for k, (gain, decay) in enumerate(zip(fed.tolist(), np.exp(-_MEMORY_S / keeps_s).tolist(), strict=True)):
        stress = decay * stress + (1.0 - decay) * gain
        result[k] = stress
    return size * np.asarray(np.interp(stage.time_s, often, result))


def _bent_flange(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring's section bends with the first moment of temperature across it: K from hub to can."""
    lever = RADII_M - RADII_M.mean()
    across = (RADII_M[-1] - RADII_M[0]) / float(lever @ lever)
    return np.asarray(size * across * (lever @ _shells(stage)))


def _coupler(unit: Unit, stage: Stage, size: float) -> Array:
    """The coupler's block, behind a thin post, sets the split of power; the sensor sits on the hub."""
    return size * (stage.body("coupler") - ROOM_C)


def _creeping_glue(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring's glue takes up its shrinking for an hour and more, by a spectrum of times."""
    hub = stage.body("hub")
    return size * (hub - spectrum_of_lags(hub, (700.0, 2200.0, 6000.0), (0.25, 0.45, 0.3), stage.step_s))


def _pump(unit: Unit, stage: Stage, size: float) -> Array:
    """Heat of the laser's pump spreads through its slab from power-on: what its far face still lacks."""
    on = (stage.time_s + stage.power_on_s) / (700.0 + 1500.0 * unit.draw["c1"])
    odd = 2.0 * np.arange(6)[:, None] + 1.0
    series = (-1.0) ** np.arange(6)[:, None] / odd * np.exp(-(odd**2) * math.pi**2 / 4.0 * on)
    return size * np.asarray(4.0 / math.pi * series.sum(axis=0))


def _laser_mode(unit: Unit, stage: Stage, size: float) -> Array:
    """The laser jumps by one of its modes where its board passes a temperature, back a little lower."""
    at, half = -8.0 + 26.0 * unit.draw["form"], 0.5 + 0.5 * unit.draw["b"]
    board = stage.body("board")
    state = np.where(board > at + half, 1, np.where(board < at - half, -1, 0))
    last = np.maximum.accumulate(np.where(state != 0, np.arange(len(board)), 0))
    upper = np.where(state[last] == 0, board[0] > at, state[last] > 0).astype(float)
    # the lock takes some seconds to find the line again
    return size * follow(upper, 3.0, stage.step_s)


def _kerr(unit: Unit, stage: Stage, size: float) -> Array:
    """Intensities of both ways differ as the splitter's power does, a sine of warmth less its tangent."""
    width_k, at = 75.0 + 40.0 * unit.draw["a"], 0.5 + 0.8 * unit.draw["c"]
    turn = (stage.body("hub") - ROOM_C) / width_k
    return size * (np.sin(at + turn) - math.sin(at) - math.cos(at) * turn)


def _relays(unit: Unit, stage: Stage, size: float) -> Array:
    """Turns of the winding slip one by one on their neighbours: each warming here, cooling there."""
    rng = drawn(unit.seed, "turns")
    often = np.arange(0.0, stage.steps * stage.step_s + _MEMORY_S, _MEMORY_S)
    warm, index = np.interp(often, stage.time_s, ring_c(stage)), np.arange(len(often))
    centres = np.linspace(-62.0, 92.0, _TURNS) + rng.normal(0.0, 0.5, _TURNS)
    halves = np.exp(rng.normal(math.log(4.0 + 6.0 * unit.draw["c2"]), 0.45, _TURNS))
    total = np.zeros(len(often))
    for centre, half in zip(centres.tolist(), halves.tolist(), strict=True):
        state = np.where(warm > centre + half, 1, np.where(warm < centre - half, -1, 0))
        last = np.maximum.accumulate(np.where(state != 0, index, 0))
        total += np.where(state[last] == 0, 1.0 if warm[0] > centre else -1.0, state[last])
    held = follow(total / _TURNS, 40.0, _MEMORY_S)
    return size * np.asarray(np.interp(stage.time_s, often, held))


def _expansion(unit: Unit, stage: Stage, size: float) -> Array:
    """Diameter over wavelength: the ring grows with its own warmth, the laser's line moves with its board."""
    bend = (0.15 + 0.15 * unit.draw["b"]) / 50.0
    ring, board = ring_c(stage) - ROOM_C, stage.body("board") - ROOM_C
    grown = 1.0 + 1e-6 * (0.75 * ring * (1.0 + bend * ring))
    line = 1.0 - 1e-6 * 0.25 * board
    return np.asarray(size * sensed_dph(stage, LATITUDE_DEG) * (grown / line - 1.0))


def _slack_loop(unit: Unit, stage: Stage, size: float) -> Array:
    """The loop's gain is 1 / `size`: it rests beside the line, where the discriminator is less steep.

    What a small rate loses is calibrated.
    """
    half_width_hz = 25e3 + 20e3 * unit.draw["c"]
    asked = np.linspace(0.0, 1.2 * _FASTEST_DPS * _HERTZ_PER_DPS / half_width_hz, 2000)
    beside = asked * size / (1.0 + size)
    for _ in range(40):
        beside = size * (asked - beside) * (1.0 + beside**2) ** 2
    lost = asked - (asked - beside) * (1.0 + size)
    rate = _input_dps(stage)
    change = np.interp(np.abs(rate) * _HERTZ_PER_DPS / half_width_hz, asked, lost)
    return np.asarray(-3600.0 * np.sign(rate) * change * half_width_hz / _HERTZ_PER_DPS)


def _two_shifters(unit: Unit, stage: Stage, size: float) -> Array:
    """Each direction has a frequency shifter of its own, `size` ppm apart; they take over about zero rate."""
    rate, blur = _input_dps(stage), 0.1 + 0.3 * unit.draw["a"]
    return np.asarray(0.5e-6 * size * 3600.0 * rate * np.tanh(rate / blur))


def _drive_limit(unit: Unit, stage: Stage, size: float) -> Array:
    """The oscillator's drive runs out at 120 deg/s over `size`: a limiter with a rounded knee."""
    limit = _FASTEST_DPS / size
    knee, rate = 0.03 * limit, _input_dps(stage)
    fast = (
        0.5
        * knee
        * (
            np.logaddexp(0.0, -2.0 * (np.abs(rate) + limit) / knee)
            - np.logaddexp(0.0, 2.0 * (np.abs(rate) - limit) / knee)
        )
    )
    return np.asarray(3600.0 * np.sign(rate) * fast)


def _backscatter(unit: Unit, stage: Stage, size: float) -> Array:
    """Scattered light ties both ways below `size` deg/h: Adler's beat, averaged over phase noise."""
    blur = 0.15 + 0.35 * unit.draw["c"]
    at, weight = np.polynomial.hermite_e.hermegauss(61)
    grid = np.linspace(0.0, 60.0, 6001)
    seen = grid[:, None] + blur * at
    beat = np.sign(seen) * np.sqrt(np.maximum(seen**2 - 1.0, 0.0))
    lost = grid - beat @ (weight / weight.sum())
    ratio = sensed_dph(stage, LATITUDE_DEG) / size
    far = 0.5 / np.maximum(np.abs(ratio), 1.0)
    missing = np.where(np.abs(ratio) < 60.0, np.interp(np.abs(ratio), grid, lost), far)
    return np.asarray(-size * np.sign(ratio) * missing)


def _faraday(unit: Unit, stage: Stage, size: float) -> Array:
    """A twisted fibre in the hall's field, mostly across its axis, through a shield that tires a little."""
    turn = np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]))
    up, phase = np.radians(stage.elevation_deg), 2.0 * math.pi * unit.draw["phase"]
    declined = math.radians(20.0 * unit.draw["tilt"] - 10.0)
    level = 0.42 * np.cos(turn - declined)
    along = level * np.cos(up) - 0.75 * np.sin(up)
    third = -level * np.sin(up) - 0.75 * np.cos(up)
    across = -0.42 * np.sin(turn - declined)
    through = 0.3 * along + math.cos(phase) * across + math.sin(phase) * third
    return np.asarray(size * through * (1.0 + 0.1 * through**2))


def _sag(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring hangs on its flange, clamped obliquely."""
    up, towards = np.radians(stage.elevation_deg), _hangs(unit)
    return np.asarray(size * (math.cos(towards) * np.sin(up) + math.sin(towards) * np.cos(up)))


def _hangs(unit: Unit) -> float:
    return 2.4 * unit.draw["lean"] - 1.2


def _pulls(unit: Unit, size: float) -> dict[str, float]:
    return {
        "bias_dph_per_g_axial": size * math.cos(_hangs(unit)),
        "bias_dph_per_g_cross": size * math.sin(_hangs(unit)),
    }


def _lean(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring's axis leans in its case by `size` degrees, aside and up; the trunnion carries it along.

    A small angle: what it adds is in proportion.
    """
    small, towards = math.radians(size), 2.0 * math.pi * unit.draw["lean"]
    aside, above = small * math.sin(towards), small * math.cos(towards)
    up, turn = np.radians(stage.elevation_deg), np.radians(stage.angle_deg)
    # means over a step of the cosine and sine of an angle that grows evenly
    half = np.sinc(np.diff(turn) / (2.0 * math.pi))
    cosine, sine = half * np.cos(0.5 * (turn[1:] + turn[:-1])), half * np.sin(0.5 * (turn[1:] + turn[:-1]))
    north = -above * np.sin(up) * cosine - aside * sine
    vertical = earth_rate_up_dph(LATITUDE_DEG) + 3600.0 * stage.rate_dps
    return np.asarray(earth_rate_north_dph(LATITUDE_DEG) * north + vertical * above * np.cos(up))


def _loop_lag(unit: Unit, stage: Stage, size: float) -> Array:
    """Two equal poles of the loop, late by `size` ms together: their weight over the turned angle."""
    edges = np.arange(stage.steps + 1) * stage.step_s
    sensed = sensed_dph(stage, LATITUDE_DEG)
    turned = np.concatenate(([0.0], np.cumsum(sensed) * stage.step_s))
    # Gauss and Laguerre's nodes; the weight of two poles is t exp(-t)
    nodes, weights = np.polynomial.laguerre.laggauss(8)
    weights = weights * nodes / float(weights @ nodes)
    behind = np.zeros(stage.steps + 1)
    for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True):
        then = edges - 0.5e-3 * size * node
        behind += weight * np.where(then < 0.0, sensed[0] * then, np.interp(then, edges, turned))
    return np.asarray(np.diff(behind) / stage.step_s - sensed)


def _bearing(unit: Unit, stage: Stage, size: float) -> Array:
    """The table's rollers shake the ring, whose mount resonates; its asymmetry makes a bias of the power."""
    waves = np.arange(1.0, 41.0)
    speeds = np.linspace(0.0, 1.1 * _FASTEST_DPS, 400)
    ratio = 9.0 * waves * speeds[:, None] / 360.0 / (130.0 + 60.0 * unit.draw["g1"])
    passed = 1.0 / ((1.0 - ratio**2) ** 2 + (ratio / 5.0) ** 2)
    power = (speeds[:, None] / 100.0) ** 2 * waves**-1.4 * passed
    shaken = power.sum(axis=1) / float((waves**-1.4).sum())
    return size * np.asarray(np.interp(np.abs(stage.rate_dps), speeds, shaken))


def _encoder_disc(unit: Unit, stage: Stage, size: float) -> Array:
    """The encoder's disc sits off centre and is a little oval: `size` arcsec of reading."""
    turn, phase = np.radians(stage.angle_deg), 2.0 * math.pi * unit.draw["phase"]
    reading = np.sin(turn + phase) + (0.15 + 0.3 * unit.draw["c1"]) * np.sin(2.0 * turn + 2.3 * phase)
    return np.asarray(-size * np.diff(reading) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


def _motor_poles(unit: Unit, stage: Stage, size: float) -> Array:
    """Cogging twists the shaft above the encoder, at an order and its double; speed smooths it by inertia."""
    order = (12, 16, 22)[int(2.999 * unit.draw["order"])]
    turn, phase = np.radians(stage.angle_deg), 2.0 * math.pi * unit.draw["phase"]
    speed = np.abs(np.interp(np.arange(stage.steps + 1) - 0.5, np.arange(stage.steps), stage.rate_dps))
    hertz = order * speed / 360.0
    twisted = np.sin(order * turn + phase) / (1.0 + (hertz / 4.0) ** 2)
    twisted += 0.35 * np.sin(2.0 * order * turn + 0.7 * phase) / (1.0 + (hertz / 2.0) ** 2)
    return np.asarray(size * np.diff(twisted) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


EFFECTS: dict[str, Effect] = {
    "delay": known(_delay, "shupe"),
    "stiff_resin": known(_stiff_resin, "cold_stress", beside=("shupe_cross",)),
    "bent_flange": known(_bent_flange, "gradient"),
    "coupler": known(_coupler, "thermal_lag", "relaxation"),
    "creeping_glue": known(_creeping_glue, "relaxation", "thermal_lag"),
    "pump": known(_pump, "warm_up"),
    "laser_mode": known(_laser_mode, "mode_hop", truth=lambda unit, size: {"bias_step_dph": size}),
    "kerr": known(_kerr, "bias_quadratic", "bias_cubic"),
    "relays": known(_relays, "hysteresis"),
    "expansion": known(_expansion, "scale_factor_temperature", "scale_factor_quadratic"),
    "slack_loop": Effect(
        _slack_loop, ("scale_factor_nonlinearity",), curved=True, sizes=(1e-4, 0.05), signed=False
    ),
    "two_shifters": known(
        _two_shifters, "scale_factor_asymmetry", truth=lambda unit, size: {"asymmetry_ppm": size}
    ),
    "drive_limit": Effect(
        _drive_limit, ("saturation",), ("scale_factor_nonlinearity",), None, True, (0.5, 1.2), signed=False
    ),
    "backscatter": Effect(
        _backscatter, ("lock_in", "dead_zone"), curved=True, sizes=(1e-3, 1e3), signed=False
    ),
    "faraday": known(_faraday, "heading_sensitivity", beside=("acceleration_sensitivity",)),
    "sag": known(_sag, "acceleration_sensitivity", truth=_pulls),
    "lean": known(_lean, "axis_misalignment", beside=("azimuth_error", "table_tilt")),
    "tilted_table": tilt(LATITUDE_DEG),
    "loop_lag": Effect(
        _loop_lag,
        ("time_offset",),
        (),
        lambda unit, size: {"offset_ms": -size},
        True,
        (1e-4, 50.0),
        signed=False,
    ),
    "skewed_clock": skew(LATITUDE_DEG),
    "bearing": known(_bearing, "vibration_rectification"),
    "encoder_disc": known(_encoder_disc, "table_wobble_once", "table_wobble_twice"),
    "motor_poles": known(_motor_poles, "table_rate_ripple"),
    **FOREIGN,
}
"""Of those with a name: stress that builds up in the cold only is a rate of change that acts more
towards the cold; the vertical field on an axis is what gravity would do; a rounded knee is a power of rate.
"""
