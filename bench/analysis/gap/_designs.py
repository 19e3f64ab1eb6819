"""Runs that a bench could make: its procedures with parameters, and what acts on the gyro in each.

The stimulus is foretold, not recorded: a chamber that keeps its demanded ramp and a unit of two thermal lags.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise, product
from typing import Literal

import numpy as np

from bench.analysis.gap._data import GapRun
from bench.control.procedure import Demands, Procedure, beyond_limits, find_procedure
from bench.record.benchfile import BenchFile
from drivers.base.arrays import Array
from simulators.effects import REFERENCE_C, Stimulus

_CASE_S, _BOARD_S, _COIL_S = 60.0, 300.0, 900.0
_SELF_HEATING_K, _SELF_HEATING_S = 6.0, 1500.0
_STEP_DPS = 0.1
"""Change of the rate from one second to the next that is a step, no ripple of the table."""
_SHOCK_K_PER_MIN = 12.0
_SHOCK_C = -45.0
_COLD_C, _HOT_C, _FASTEST_DPS = -40.0, 60.0, 100.0
"""How far ramps and rates go where the bench's limits allow it."""
_USUAL_DPS = 20.0
"""Shocks and rates over temperature are made at no higher rate: on the emulated bench 100 deg/s, where the polled
angle is coarsest for what the gyro resolves, showed as a gap of some ppm in a unit without one."""
_SOAKS = ((20.0, 10.0), (75.0, 30.0))
"""Minutes of soak and of reference of a shock: short and usual."""
_CYCLED = ((1.0, 10.0, 1), (3.0, 10.0, 1), (3.0, 30.0, 3), (10.0, 30.0, 1))
"""Ramp in K/min, minutes at each end and rates of each sign, of rates in turn over temperature."""
_RATE_DWELL_S, _NEXT_RATE_S = 60, 5
_SHORT_WARM_UP_MIN = 10.0
_SHORT_TEST = {
    "temperatures": False,
    "noise_h": 0.5,
    "bias_min": 10.0,
    "power_cycles": 0,
    "warm_up_min": _SHORT_WARM_UP_MIN,
    "step_dwell_s": 60.0,
    "east_dwell_s": 60.0,
    "rate_dwell_s": 60.0,
    "sequences": 2,
    "misalignment": "as_mounted",
}
"""A standard test as short as its procedure allows but for the rates, which a diagnosis takes from it."""

Leg = tuple[float, float]
"""Minutes, and the air temperature at their end."""


@dataclass(frozen=True)
class Design:
    """A procedure with settings (those not at their defaults), and the stretches that a diagnosis would take."""

    procedure: str
    settings: Mapping[str, object]
    text: str
    stimuli: Mapping[str, Stimulus]
    """Stretches by condition, as `bench.analysis.gap` reads them from a run folder."""

    @cached_property
    def key(self) -> str:
        """Procedure and settings: what makes it another run."""
        return key_of(self.procedure, self.settings)

    @cached_property
    def test(self) -> Procedure:
        """The procedure itself."""
        return find_procedure(self.procedure)

    @cached_property
    def hours(self) -> float:
        """Bench time that the procedure expects."""
        return self.test.expected_duration_s(self.test.parse(dict(self.settings))) / 3600.0

    def runs(self) -> list[GapRun]:
        """Return its stretches with an output of 0, missing where telemetry does not follow the table's rate."""
        return [
            GapRun(f"{self.text} {n}", "", self.text, condition, s, _output(s), np.full(len(s), "run"))
            for n, (condition, s) in enumerate(self.stimuli.items())
        ]


def key_of(procedure: str, settings: Mapping[str, object]) -> str:
    """Return the key of a design by its procedure and those settings that are not at their defaults."""
    return json.dumps([procedure, dict(settings)], sort_keys=True)


def usual_designs(latitude_deg: float, axis: str = "x", fastest_dps: float = _FASTEST_DPS) -> list[Design]:
    """Return the bench's procedures with their usual parameters; `axis`: the one under test."""
    return [
        _zero_bias(latitude_deg, soak_min=75.0, hold_min=30.0),
        _scale_factor(latitude_deg, rate_dps=20.0, soak_min=75.0, hold_min=30.0),
        _ramp(latitude_deg, -40.0, 60.0, 1.0 / 3.0, dwell_min=30.0),
        _rotation(latitude_deg, 20.0, hours=2.0, reversals=0, axis=axis),
        _rates(latitude_deg, fastest_dps, per_sign=11),
    ]


def designs_for(file: BenchFile, axis: Literal["x", "y", "z"] | None = None) -> list[Design]:
    """Return what a bench can do within its limits, over a grid of each procedure's parameters.

    `axis`: the gyro's axis under test (default: the first gyro's). Depths, ramps, soaks, rates and lengths vary.
    """
    latitude, axis, limits = file.bench.latitude_deg, axis or file.gyro[0].axis, file.limits
    fastest = min(_FASTEST_DPS, limits.max_rate_dps)
    rates = sorted({min(_USUAL_DPS, fastest), fastest})
    low_c, high_c = max(_COLD_C, limits.min_temp_c), min(_HOT_C, limits.max_temp_c)
    grid = (
        *usual_designs(latitude, str(axis), fastest),
        *(_zero_bias(latitude, soak, hold) for soak, hold in _SOAKS),
        *(_scale_factor(latitude, rates[0], soak, hold) for soak, hold in _SOAKS),
        *(_ramp(latitude, low_c, high_c, rate, dwell_min=10.0, short=True) for rate in (1.0 / 3.0, 1.0, 3.0)),
        *(
            _rotation(latitude, rate, hours, reversals, str(axis))
            for rate, hours, reversals in product((2.0, _USUAL_DPS), (0.5, 2.0), (0, 3))
        ),
        *(_rates(latitude, most, per_sign=6) for most in rates),
        _rates(latitude, fastest, per_sign=3, sequences=1),
        *(_cycled(latitude, rates[0], low_c, high_c, *profile) for profile in _CYCLED),
        *(_cycled(latitude, rates[0], per_sign=each) for each in (3, 6)),
    )
    own = {each.key: each for each in grid}
    return [each for each in own.values() if not any(beyond_limits(_demands(each), file))]


def other_equipment(latitude_deg: float) -> list[tuple[str, Design]]:
    """Return what another bench could do: the equipment in words, and a run on it."""
    elevations = np.repeat(np.array([90.0, 0.0, -90.0]), 1200)
    turned = _stimulus(latitude_deg, [(60.0, REFERENCE_C)], elevation_deg=elevations)
    fast = _turning(latitude_deg, [0.0, 200.0, -200.0, 400.0, -400.0], 300)
    return [
        ("a table of two axes, which turns the unit over", _made("turned over", turned)),
        ("a rate table of 400 deg/s", _made("fast", fast)),
    ]


def _output(s: Stimulus) -> Array:
    """Return zeros, (n,), with NaN in the two seconds at each step of the rate along the axis."""
    output = np.zeros(len(s))
    steps = np.flatnonzero(np.abs(np.diff(s.axis_rate_dps)) > _STEP_DPS)
    output[steps] = output[steps + 1] = np.nan
    return output


def _demands(design: Design) -> Demands:
    return design.test.demands(design.test.parse(dict(design.settings)))


def _made(text: str, stimulus: Stimulus) -> Design:
    return Design("", {}, text, {text: stimulus})


def _zero_bias(latitude_deg: float, soak_min: float, hold_min: float) -> Design:
    legs = [(hold_min, REFERENCE_C), *_shock_legs(soak_min)]
    stimulus = _stimulus(latitude_deg, legs, elevation_deg=0.0, angle_deg=90.0)
    settings = {"soak_min": soak_min, "hold_min": hold_min}
    text = f"axis east, soak {soak_min:g} min"
    return Design("zero-bias-cold-shock", settings, text, {"90 deg": stimulus})


def _scale_factor(latitude_deg: float, rate_dps: float, soak_min: float, hold_min: float) -> Design:
    legs = [(hold_min, REFERENCE_C), *_shock_legs(soak_min)]
    rates = (rate_dps, -rate_dps, 0.0)
    stimuli = {f"{rate:+g}": _stimulus(latitude_deg, legs, rate_dps=rate) for rate in rates}
    settings = {"rate_dps": rate_dps, "soak_min": soak_min, "hold_min": hold_min}
    text = f"rates {rate_dps:+g}, {-rate_dps:g}, 0 deg/s, soak {soak_min:g} min"
    return Design("scale-factor-cold-shock", settings, text, stimuli)


def _ramp(
    latitude_deg: float,
    low_c: float,
    high_c: float,
    k_per_min: float,
    dwell_min: float,
    *,
    short: bool = False,
) -> Design:
    """Return a ramp; a short one begins soon after power-on and does not look for east.

    A wrong azimuth lets in a constant part of the Earth's rate, which no diagnosis takes for an effect.
    """
    down, up = (REFERENCE_C - low_c) / 3.0, (high_c - low_c) / k_per_min
    legs = [
        (_SHORT_WARM_UP_MIN if short else 60.0, REFERENCE_C),
        (down, low_c),
        (dwell_min, low_c),
        (up, high_c),
        (dwell_min, high_c),
    ]
    stimulus = _stimulus(latitude_deg, legs, elevation_deg=0.0, angle_deg=90.0)
    settings: dict[str, object] = {
        "low_c": low_c,
        "high_c": high_c,
        "ramp_k_per_min": k_per_min,
        "dwell_min": dwell_min,
        "both_directions": False,
    }
    if short:
        settings |= {"warm_up_min": _SHORT_WARM_UP_MIN, "search_east": False}
    text = f"{low_c:g} to {high_c:g} degC at {k_per_min:.2g} K/min{', at once' if short else ''}"
    return Design("thermal-ramp", settings, text, {"90 deg": stimulus})


def _rotation(latitude_deg: float, rate_dps: float, hours: float, reversals: int, axis: str) -> Design:
    turns = max(round(hours * 3600.0 * rate_dps / 360.0), reversals + 1)
    signs = [rate_dps * (-1.0) ** number for number in range(reversals + 1)]
    dwell_s = round(360.0 * turns / rate_dps / len(signs))
    stimulus = _turning(latitude_deg, signs, dwell_s, elevation_deg=90.0 if axis == "z" else 0.0)
    settings = {"rate_dps": rate_dps, "turns": float(turns), "reversals": reversals}
    text = f"{rate_dps:g} deg/s at room temperature, {turns} turns, {reversals} reversals"
    return Design("constant-rotation", settings, text, {f"{rate_dps:+g}": stimulus})


def _rates(latitude_deg: float, most_dps: float, per_sign: int, sequences: int = 2) -> Design:
    sizes = [most_dps * share for share in np.linspace(1.0 / per_sign, 1.0, per_sign).tolist()]
    side = [*sizes, *sizes[-2::-1], 0.0]
    rates = [0.0, *side, *(-size for size in side)] * sequences
    stimulus = _turning(latitude_deg, rates, 60)
    settings = _SHORT_TEST | {
        "max_rate_dps": most_dps,
        "rates_per_sign": per_sign,
        "sequences": sequences,
    }
    text = f"{per_sign} rates of each sign up to {most_dps:g} deg/s, room temperature only"
    return Design("standard-test", settings, text, {"rates": stimulus})


def _cycled(
    latitude_deg: float,
    most_dps: float,
    low_c: float = REFERENCE_C,
    high_c: float = REFERENCE_C,
    k_per_min: float = 0.0,
    dwell_min: float = 0.0,
    per_sign: int = 1,
) -> Design:
    """Return rates in turn: at room temperature twice, or, with a ramp, once and on over temperature."""
    sizes = [most_dps * share for share in np.linspace(1.0 / per_sign, 1.0, per_sign).tolist()]
    turn = [0.0, *sizes, 0.0, *(-size for size in sizes)]
    step_s, sequences = _RATE_DWELL_S + _NEXT_RATE_S, 1 if k_per_min else 2
    legs = [(_SHORT_WARM_UP_MIN + sequences * len(turn) * step_s / 60.0, REFERENCE_C)]
    settings: dict[str, object] = {
        "max_rate_dps": most_dps,
        "rates_per_sign": per_sign,
        "rate_dwell_s": float(_RATE_DWELL_S),
        "sequences": sequences,
        "warm_up_min": _SHORT_WARM_UP_MIN,
    }
    text = f"{per_sign} rates of each sign up to {most_dps:g} deg/s in turn"
    if k_per_min:
        way = [low_c, high_c, REFERENCE_C]
        for start_c, end_c in pairwise((REFERENCE_C, *way)):
            legs += [(abs(end_c - start_c) / k_per_min, end_c), (dwell_min, end_c)]
        legs.pop()
        settings |= {
            "low_c": low_c, "high_c": high_c, "ramp_k_per_min": k_per_min, "dwell_min": dwell_min
        }  # fmt: skip
        text += f", {low_c:g} to {high_c:g} degC at {k_per_min:.2g} K/min, {dwell_min:g} min at the ends"
    else:
        settings |= {"over_temperature": False}
        text += ", room temperature only"
    warming = np.zeros(round(60.0 * _SHORT_WARM_UP_MIN))
    turning_s = round(60.0 * sum(minutes for minutes, _ in legs)) - len(warming)
    rates = np.resize(np.repeat(np.array(turn), step_s), turning_s)
    stimulus = _stimulus(latitude_deg, legs, rates_dps=np.concatenate((warming, rates)))
    return Design("rates-over-temperature", settings, text, {"+0": stimulus})


def _shock_legs(soak_min: float) -> list[Leg]:
    way = (REFERENCE_C - _SHOCK_C) / _SHOCK_K_PER_MIN
    return [(way, _SHOCK_C), (soak_min, _SHOCK_C), (way, REFERENCE_C), (80.0, REFERENCE_C)]


def _turning(
    latitude_deg: float, rates_dps: Sequence[float], dwell_s: int, *, elevation_deg: float = 90.0
) -> Stimulus:
    rates = np.repeat(np.array(rates_dps), dwell_s)
    legs = [(len(rates) / 60.0, REFERENCE_C)]
    return _stimulus(latitude_deg, legs, rates_dps=rates, elevation_deg=elevation_deg)


def _stimulus(
    latitude_deg: float,
    legs: Sequence[Leg],
    *,
    rate_dps: float = 0.0,
    rates_dps: Array | None = None,
    elevation_deg: float | Array = 90.0,
    angle_deg: float = 0.0,
) -> Stimulus:
    """Return a stretch that begins at room temperature and follows the legs, at 1 s."""
    ends_s = [0.0, *accumulate(60.0 * minutes for minutes, _ in legs)]
    n = math.floor(ends_s[-1]) if rates_dps is None else len(rates_dps)
    time_s = np.arange(1.0, n + 1.0)
    air = np.interp(time_s, ends_s, [REFERENCE_C, *(temp_c for _, temp_c in legs)])
    rates = np.full(n, rate_dps) if rates_dps is None else rates_dps
    angle = angle_deg + np.concatenate(([0.0], np.cumsum(rates)))
    elevation = np.full(n, 1.0) * elevation_deg
    bare = Stimulus(time_s, air, air, angle, elevation, latitude_deg)
    case = bare.lagged(air, _CASE_S)
    heat = _SELF_HEATING_K * (1.0 - np.exp(-time_s / _SELF_HEATING_S))
    inside = bare.lagged(bare.lagged(case, _BOARD_S), _COIL_S) + heat
    return Stimulus(time_s, inside, case, angle, elevation, latitude_deg)
