"""The cold-shock campaign of the off-class exam: chamber profiles, the noise of a gyro, runs as a fit takes them.

The chamber is a ramp through two lags, the noise is white plus flicker shaped by an FFT: nothing here is the
emulated lab's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from bench.analysis.thermal import ThermalRun
from drivers.base.arrays import Array

EQUILIBRIUM_S = 5400
REFERENCE_S = 1800
RETURN_S = 5400
TRAINING = (-41, 11, 60, 25), (-45, 12, 90, 23), (-50, 13, 60, 25), (-42, 15, 45, 27)
VALIDATION = ((-46, 12, 75, 25),)
TESTS = {
    "nominal": (-45, 12, 75, 25),
    "deeper": (-55, 12, 75, 25),
    "faster": (-45, 18, 75, 25),
    "short soak": (-45, 12, 20, 25),
    "cool room": (-45, 12, 150, 18),
    "slow": (-45, 3, 75, 25),
    "double": (-45, 12, 75, 25),
}
"""Lowest temperature degC, ramp K/min, soak min, room degC: the held-out profiles of the design."""
SF_TESTS = ("nominal", "deeper", "faster", "cool room", "slow")
Profile = tuple[float, float, float, float]


@dataclass(frozen=True)
class Truth:
    """What a plant does on one chamber profile, arrays (n,) at 1 s."""

    t_in_c: Array
    t_out_c: Array
    bias_dph: Array
    sf_error_ppm: Array


Plant = Callable[[Array], list[Truth]]
"""A unit: chamber air of runs side by side, (n, runs) -> a truth for each."""


@dataclass(frozen=True)
class Campaign:
    """Runs to fit on, to choose by, and to judge on."""

    training: tuple[ThermalRun, ...]
    validation: tuple[ThermalRun, ...]
    tests: tuple[ThermalRun, ...]


def air_of(profile: Profile, shocks: int = 1) -> Array:
    """Return the chamber's air, (n,), at 1 s from power-on in a room at equilibrium."""
    cold, ramp, soak_min, room = profile
    ramp_s = round(abs(room - cold) / ramp * 60.0)
    down, up = np.linspace(room, cold, ramp_s), np.linspace(cold, room, ramp_s)
    shock = [down, np.full(round(soak_min * 60.0), cold), up]
    parts = [np.full(EQUILIBRIUM_S, room)]
    for number in range(shocks):
        parts += [*shock, np.full(RETURN_S if number + 1 == shocks else 1200, room)]
    return np.asarray(_lag(_lag(np.concatenate(parts).astype(np.float64), 30.0), 12.0))


def names() -> tuple[str, ...]:
    """Return the names of the campaign's profiles: four to fit on, one to choose by, seven to judge on."""
    return (*(f"train {number}" for number in range(len(TRAINING))), "validation", *TESTS)


def profiles() -> tuple[Profile, ...]:
    """Return the profiles in the order of `names`."""
    return (*TRAINING, *VALIDATION, *TESTS.values())


def truths_of(plant: Plant) -> dict[str, Truth]:
    """Return what a unit does on every profile."""
    airs = [
        air_of(profile, 2 if name == "double" else 1)
        for name, profile in zip(names(), profiles(), strict=True)
    ]
    length = max(map(len, airs))
    made = plant(np.column_stack([np.pad(air, (0, length - len(air)), mode="edge") for air in airs]))
    return {
        name: Truth(truth.t_in_c[: len(air)], truth.t_out_c[: len(air)],
                    truth.bias_dph[: len(air)], truth.sf_error_ppm[: len(air)])
        for name, truth, air in zip(names(), made, airs, strict=True)
    }  # fmt: skip


def campaign(truths: Mapping[str, Truth], seed: int) -> Campaign:
    """Return the campaign of a unit: four bias runs and three scale-factor groups, one of each to choose by,
    seven and five to judge on."""
    rng = np.random.default_rng(seed)
    bias, factor = (
        {name: measured(truth, name, kind, rng) for name, truth in truths.items()}
        for kind in ("bias", "scale")
    )
    training = names()[: len(TRAINING)]
    return Campaign(
        (*(bias[name] for name in training), *(factor[name] for name in training[:3])),
        (bias["validation"], factor["validation"]),
        (*(bias[name] for name in TESTS), *(factor[name] for name in SF_TESTS)),
    )


def measured(truth: Truth, name: str, kind: str, rng: np.random.Generator) -> ThermalRun:
    """Return a truth as it is measured: noise of a 0.004 deg/sqrt(h) gyro, sensors of 0.01 K."""
    white, count = 0.24, len(truth.bias_dph)  # deg/h of 1 s means
    reference = (float(EQUILIBRIUM_S - REFERENCE_S), float(EQUILIBRIUM_S))

    def sensor(temp_c: Array) -> Array:
        return np.round(temp_c + 0.01 * rng.standard_normal(count), 2)

    own, factor = truth.bias_dph, truth.sf_error_ppm
    # The slope over +20, -20 and 0 deg/s: two runs' noise over 40 deg/s.
    factor_noise = white * 2.0**0.5 / (40.0 * 3600.0) * 1e6 * rng.standard_normal(count)
    bias = (
        own + white * rng.standard_normal(count) + flicker(count, 0.006, rng) + 0.01 * rng.standard_normal()
    )
    is_bias = kind == "bias"
    level = factor[int(reference[0]) : int(reference[1])].mean()
    return ThermalRun(
        run_id=f"{name} {kind}",
        unit_id="unit",
        time_s=np.arange(1.0, count + 1.0),
        gyro_temp_c=sensor(truth.t_in_c),
        case_temp_c=sensor(truth.t_out_c),
        bias_dph=bias if is_bias else None,
        sf_error_ppm=None if is_bias else factor - level + factor_noise,
        reference=reference,
        true_bias_dph=own if is_bias else None,
        true_sf_error_ppm=None if is_bias else factor - level,
    )


def flicker(count: int, instability_dph: float, rng: np.random.Generator) -> Array:
    """Return noise of spectrum 1/f whose Allan deviation is flat at 0.664 of `instability_dph`, by an FFT."""
    frequency = np.fft.rfftfreq(count, 1.0)
    frequency[0] = np.inf
    density = instability_dph**2 / (2.0 * np.pi * frequency)
    phase = rng.standard_normal((2, len(frequency)))
    return np.asarray(np.fft.irfft((phase[0] + 1j * phase[1]) * np.sqrt(density * count / 4.0), count))


def scaled(effects: Sequence[Array], peaks: Sequence[float]) -> Array:
    """Return the sum of effects (n, runs), each scaled to its peak-to-peak on the first run."""
    return np.asarray(
        sum(peak / np.ptp(effect[:, 0]) * effect for effect, peak in zip(effects, peaks, strict=True))
    )


def _lag(values: Array, tau_s: float) -> Array:
    gain = 1.0 - np.exp(-1.0 / tau_s)
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], values, zi=[(1.0 - gain) * values[0]])[0])
