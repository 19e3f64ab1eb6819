"""Five ring lasers whose bias over temperature is no sum of the eleven candidates, with a spread from run to run.

Heat flows through linear nodes on a grid of 10 s. Every power-on draws the size of each effect, `spread`
(1 sigma) about the unit's own; the offset of a run is drawn too, since a regression judges spreads only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from bench.analysis.rlg import RampRun
from bench.analysis.rlg._rows import ramp_run
from drivers.base.arrays import Array

_STEP_S = 10.0
_DWELL_S = 3600.0
Effects = Callable[[Array, np.random.Generator], tuple[Array, Array, list[Array]]]
PROFILES: dict[str, tuple[float, float, float]] = {
    "train": (-40.0, 65.0, 1.0 / 3.0),
    "repeat": (-40.0, 65.0, 1.0 / 3.0),
    "reverse": (65.0, -40.0, 1.0 / 3.0),
    "faster": (-40.0, 65.0, 1.0),
    "partial": (-20.0, 50.0, 1.0 / 3.0),
}
"""Where a run begins, where it turns back (degC), and its ramp in K/min."""


def air_of(profile: tuple[float, float, float]) -> Array:
    """Return the chamber's air at 10 s: dwell, ramp, dwell, ramp back, dwell."""
    begin, end, ramp = profile
    dwell = np.ones(round(_DWELL_S / _STEP_S))
    there = np.linspace(begin, end, round(abs(end - begin) / ramp * 60.0 / _STEP_S))
    return np.concatenate([begin * dwell, there, end * dwell, there[::-1], begin * dwell])


def lag(values: Array, tau_s: float) -> Array:
    """Return values after a first-order lag, settled on the first."""
    gain = 1.0 - np.exp(-_STEP_S / tau_s)
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], values, zi=[(1.0 - gain) * values[0]])[0])


def per_minute(values: Array) -> Array:
    """Return the rate of change per minute."""
    return np.asarray(np.gradient(values) * 60.0 / _STEP_S)


def mode_hops(air: Array, unit: np.random.Generator) -> tuple[Array, Array, list[Array]]:
    """The cavity hops from mode to mode and the path-length control resets it: steps and saw teeth."""
    case = lag(air, unit.uniform(600.0, 900.0))
    block = lag(case, unit.uniform(1200.0, 1800.0)) + 3.0
    period = unit.uniform(15.0, 22.0)
    saw = ((block + unit.uniform(0.0, period)) / period) % 1.0
    return case, block, [block, saw, np.exp((case - 65.0) / 40.0), case - block]


def slow_mounts(air: Array, unit: np.random.Generator) -> tuple[Array, Array, list[Array]]:
    """Mirror mounts creep for two hours after a ramp; the drag of the gas grows with its viscosity."""
    case = lag(air, unit.uniform(600.0, 900.0))
    block = lag(case, unit.uniform(1200.0, 1800.0)) + 3.0
    mount = lag(block, unit.uniform(5000.0, 9000.0))
    viscosity = ((block + 273.15) / 298.15) ** 0.7
    return case, block, [mount - block, viscosity * (case - block), viscosity, per_minute(mount)]


def lock_in(air: Array, unit: np.random.Generator) -> tuple[Array, Array, list[Array]]:
    """Scatter that interferes: backscatter adds as phasors whose phase runs with the body's expansion."""
    case = lag(air, unit.uniform(600.0, 900.0))
    block = lag(lag(case, 800.0), unit.uniform(600.0, 1000.0)) + 2.0
    phase = (block - 25.0) / unit.uniform(7.0, 11.0)
    beat = np.hypot(1.0 + 0.4 * np.cos(phase), 0.3 * np.sin(0.7 * phase))
    return (
        case,
        block,
        [beat, np.tanh((block - 10.0) / 30.0), per_minute(block) * np.abs(per_minute(block)), block],
    )


def third_node(air: Array, unit: np.random.Generator) -> tuple[Array, Array, list[Array]]:
    """The discharge's arms sit at two ends of the block, one of them nearer to a third, unmeasured body."""
    case = lag(air, unit.uniform(600.0, 900.0))
    block = lag(case, unit.uniform(1200.0, 1800.0)) + 3.0
    frame = lag(air, unit.uniform(3000.0, 5000.0))
    arms = lag(frame, 1500.0) - block
    return case, block, [arms, arms * np.abs(arms), block - 0.003 * (block - 20.0) ** 2, per_minute(case)]


def sticking_joints(air: Array, unit: np.random.Generator) -> tuple[Array, Array, list[Array]]:
    """Joints that stick, each at a load of its own; a heater that regulates in the cold; a narrow resonance."""
    case = lag(air, unit.uniform(600.0, 900.0))
    heater = lag(np.clip((unit.uniform(5.0, 15.0) - case) / 20.0, 0.0, 1.0), 400.0)
    block = lag(case, unit.uniform(1200.0, 1800.0)) + 2.0 + 4.0 * heater
    loads = unit.uniform(1.0, 12.0, 5)
    stuck = np.zeros((5, len(block)))
    held = np.full(5, block[0])
    for row, value in enumerate(block):
        held += np.maximum(value - held - loads, 0.0) - np.maximum(held - value - loads, 0.0)
        stuck[:, row] = held
    resonance = 1.0 / (1.0 + ((case - unit.uniform(0.0, 40.0)) / 4.0) ** 2)
    friction = per_minute(case) * np.exp(-case / 40.0)
    return case, block, [stuck.mean(axis=0) - block, heater * (case - block), resonance, friction]


# the last was written when the method stood, and never looked at while it was made
FAMILIES: dict[str, Effects] = {
    "mode hops": mode_hops,
    "slow mounts": slow_mounts,
    "backscatter": lock_in,
    "third body": third_node,
    "sticking joints": sticking_joints,
}
NOISE_DEG_PER_SQRT_H = 2.0e-4
_PEAKS_DPH = (0.02, 0.008, 0.012, 0.015)


@dataclass(frozen=True, eq=False)
class _PowerOn:
    """One run of a unit: temperatures and effects (4, n) on the grid, each effect's size, where noise goes on."""

    kind: str
    case: Array
    block: Array
    effects: Array
    sizes: Array
    rng: np.random.Generator


def unit_runs(effects: Effects, unit: int, spread: float, kinds: Sequence[str]) -> list[RampRun]:
    """Return one run of a unit for each profile named, every one after a power-on of its own."""
    made = []
    for number, drawn in enumerate(_power_ons(effects, unit, spread, kinds)):
        truth = drawn.sizes @ drawn.effects + 8e-4 * drawn.rng.standard_normal()
        name = f"{drawn.kind} {number}"
        made.append(_rows(name, f"RLG-{unit}", drawn.kind, drawn.case, drawn.block, truth, drawn.rng))
    return made


def limits_pct(effects: Effects, unit: int, spread: float, kinds: Sequence[str], fitted: int) -> list[float]:
    """Return what runs after the first `fitted` would improve by, %, were all effects known but for their sizes.

    Each size is then the mean of the fitted runs', which no static compensation can better but by luck.
    """
    drawn = _power_ons(effects, unit, spread, kinds)
    sizes = np.mean([one.sizes for one in drawn[:fitted]], axis=0)
    noise = 6.0 * NOISE_DEG_PER_SQRT_H
    each = []
    for one in drawn[fitted:]:
        left, drift = (float(np.var(part @ one.effects)) for part in (one.sizes - sizes, one.sizes))
        each.append(100.0 * (1.0 - float(np.sqrt((left + noise**2) / (drift + noise**2)))))
    return each


def _power_ons(effects: Effects, unit: int, spread: float, kinds: Sequence[str]) -> list[_PowerOn]:
    nominal = effects(air_of(PROFILES["train"]), np.random.default_rng((unit, 5)))[2]
    own = np.random.default_rng((unit, 6))
    sizes = np.array([peak * own.uniform(0.7, 1.3) * own.choice([-1.0, 1.0]) / np.ptp(effect)
                      for peak, effect in zip(_PEAKS_DPH, nominal, strict=True)])  # fmt: skip
    keep, made = round(_DWELL_S / _STEP_S), []
    for number, kind in enumerate(kinds):
        rng = np.random.default_rng((unit, 7, number))
        case, block, found = effects(air_of(PROFILES[kind]), np.random.default_rng((unit, 5)))
        drawn = sizes * (1.0 + spread * rng.standard_normal(len(sizes)))
        made.append(_PowerOn(kind, case[keep:], block[keep:], np.array(found)[:, keep:], drawn, rng))
    return made


def _rows(
    run_id: str, unit_id: str, kind: str, case: Array, block: Array, truth: Array, rng: np.random.Generator
) -> RampRun:
    """Return rows of 100 s of a run at 10 s, with noise of a 2e-4 deg/sqrt(h) gyro and sensors of 0.01 K."""
    repeat = round(_STEP_S)
    count = len(case) * repeat
    time_s = np.arange(1.0, count + 1.0)
    grid = _STEP_S * np.arange(len(case))

    def fine(values: Array) -> Array:
        return np.asarray(np.interp(time_s, grid, values))

    noise = 60.0 * NOISE_DEG_PER_SQRT_H * rng.standard_normal(count)
    own = fine(truth)
    return ramp_run(
        run_id,
        unit_id,
        time_s,
        fine(case) + 0.01 * rng.standard_normal(count),
        fine(block) + 0.01 * rng.standard_normal(count),
        own + noise,
        true_bias_dph=own,
        kind=kind,
    )
