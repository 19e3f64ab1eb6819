"""Effects of geometry, table and clocks: a mounting, an encoder and a counter are alike in every lab."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.gap_exam._family import Effect, Signal, Truth, Unit
from benchmarks.gap_exam._geometry import lean_of, sensed_dph
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

_TINY_RAD = 1e-4
_LEVEL = ("axis_misalignment", "azimuth_error", "table_tilt")
"""What Earth rate on a level axis cannot always keep apart."""


def _per_degree(stage: Stage, latitude_deg: float, **turn: tuple[float, float] | float) -> Array:
    """Return the change of the sensed rate for small angles, per degree of them."""
    changed = sensed_dph(stage, latitude_deg, **turn)  # type: ignore[arg-type]
    return np.asarray((changed - sensed_dph(stage, latitude_deg)) * math.radians(1.0) / _TINY_RAD)


def misalignment(latitude_deg: float) -> Effect:
    """The input axis leans in its case by `size` degrees."""

    def towards(unit: Unit) -> float:
        return 2.0 * math.pi * unit.draw["lean"]

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        lean = lean_of(_TINY_RAD, towards(unit))
        return size * _per_degree(stage, latitude_deg, lean_rad=lean)

    def truth(unit: Unit, size: float) -> dict[str, float]:
        return {
            "lean_deg_cos": size * math.cos(towards(unit)),
            "lean_deg_sin": -size * math.sin(towards(unit)),
        }

    return Effect(signal, ("axis_misalignment",), _LEVEL, truth)


def azimuth(latitude_deg: float) -> Effect:
    """The case is turned on the table by `size` degrees."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        return size * _per_degree(stage, latitude_deg, azimuth_rad=_TINY_RAD)

    return Effect(signal, ("azimuth_error",), _LEVEL, lambda unit, size: {"azimuth_deg": size})


def tilt(latitude_deg: float) -> Effect:
    """The table's axis is off the plumb line by `size` degrees."""

    def towards(unit: Unit) -> float:
        return 2.0 * math.pi * unit.draw["tilt"]

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        return size * _per_degree(stage, latitude_deg, tilt_rad=lean_of(_TINY_RAD, towards(unit)))

    def truth(unit: Unit, size: float) -> dict[str, float]:
        north, east = lean_of(size, towards(unit))
        return {"about_north_deg": north, "about_east_deg": east}

    return Effect(signal, ("table_tilt",), _LEVEL, truth)


def encoder(orders: Sequence[int], overtone: float) -> Effect:
    """The table's encoder errs by waves of some order and its double: `size` in degrees of angle."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        order = orders[int(unit.draw["order"] * len(orders)) % len(orders)]
        angle, phase = np.radians(stage.angle_deg), 2.0 * math.pi * unit.draw["phase"]
        error = np.sin(order * angle + phase) + overtone * np.sin(2.0 * order * angle + 2.7 * phase)
        return np.asarray(
            -3600.0 * size * np.diff(error) / stage.step_s * np.sin(np.radians(stage.elevation_deg))
        )

    return Effect(signal, ("table_wobble_once", "table_wobble_twice", "table_rate_ripple"))


def _late(stage: Stage, latitude_deg: float, delay_s: Array | float) -> Array:
    """Return the change of the sensed rate where samples are late by a small time, deg/h."""
    edges = np.arange(stage.steps + 1) * stage.step_s
    sensed = sensed_dph(stage, latitude_deg)
    turned = np.concatenate(([0.0], np.cumsum(sensed) * stage.step_s))
    then = edges - delay_s
    moved = np.interp(then, edges, turned)
    # before the first edge the rate was what it is behind it
    moved = np.where(then < 0.0, sensed[0] * then, moved)
    return np.asarray(np.diff(moved) / stage.step_s - sensed)


def latency(latitude_deg: float) -> Effect:
    """The gyro's samples are late by `size` ms."""
    return Effect(
        lambda unit, stage, size: size * _late(stage, latitude_deg, 1e-3),
        ("time_offset",),
        ("clock_skew",),
        lambda unit, size: {"offset_ms": -size},
    )


def skew(latitude_deg: float) -> Effect:
    """The gyro's clock runs slow by `size` ppm from a run's start on."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        edges = np.arange(stage.steps + 1.0) * stage.step_s
        return size * _late(stage, latitude_deg, np.asarray(1e-6 * edges))

    return Effect(signal, ("clock_skew",), ("time_offset",), lambda unit, size: {"skew_ppm": -size})


def heading(field: Callable[[Array, Array, Unit], Array]) -> Effect:
    """Bias in a magnetic field given as a function of table angle and elevation, both rad.

    Its vertical part is in upright positions what gravity would do.
    """

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        turn = np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]))
        return size * field(turn, np.radians(stage.elevation_deg), unit)

    return Effect(signal, ("heading_sensitivity", "acceleration_sensitivity"))


def impulses(mean_gap_s: float) -> Effect:
    """Impulses of random size, at random times, in single samples: `size` in arcsec."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        rng = drawn(unit.seed, "impulses", stage.key)
        count = int(rng.poisson(stage.seconds / mean_gap_s))
        values = np.zeros(stage.steps)
        sizes = rng.choice((-1.0, 1.0), count) * (0.5 + rng.exponential(0.5, count))
        np.add.at(values, rng.integers(0, stage.steps, count), sizes / stage.step_s)
        return size * values

    return Effect(signal, ("impulses",), changing=True)


def telegraph(mean_s: float) -> Effect:
    """A bias that switches between two values at random times."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        rng = drawn(unit.seed, "telegraph", stage.key)
        gaps = 20.0 + rng.exponential(mean_s, 4 + int(6 * stage.seconds / mean_s))
        switches = np.searchsorted(np.cumsum(gaps), stage.time_s)
        return size * np.where((switches + int(rng.integers(2))) % 2 == 0, 0.5, -0.5)

    return Effect(signal, changing=True)


def known(signal: Signal, *names: str, beside: tuple[str, ...] = (), truth: Truth | None = None) -> Effect:
    """Return an effect that the catalogue knows under one of some names."""
    return Effect(signal, names, beside, truth)
