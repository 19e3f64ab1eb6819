"""Shupe effect of a wound fibre coil: winding maps, Mohr's integral per layer, and its weight on temperatures.

Shupe, Appl. Opt. 19 (1980) 654; Mohr, J. Lightwave Technol. 14 (1996) 27: a temperature rate Tdot(z) along the
fibre (0 <= z <= L) is read as a rotation W_e = n/(L D) (dn/dT + n a) Int Tdot(z) (2z - L) dz. With radial heat
flow Tdot is one value a layer, so the integral is a weight vector (m2) times the layer rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.base.arrays import Array

Winding = Literal["cylinder", "dipole", "quadrupole"]
_PATTERN: dict[Winding, str] = {"dipole": "AB", "quadrupole": "ABBA"}


@dataclass(frozen=True)
class Fibre:
    """A coil's fibre: length and mean coil diameter in m, silica's index, thermo-optic and expansion terms."""

    length_m: float
    diameter_m: float
    index: float = 1.45
    thermo_optic_per_k: float = 1.05e-5
    expansion_per_k: float = 0.8e-6


def layer_weights_m2(layer_lengths_m: Array, winding: Winding, mid_point_offset_m: float = 0.0) -> Array:
    """Return Int over each layer of (2z - L) dz, innermost layer first.

    `layer_lengths_m` and the result: float64 (layers,). Half A runs from the fibre's mid-point towards z = 0,
    half B towards z = L; the pattern says which half lies in which layer from inside to outside. The offset
    moves the wound part along the fibre: distances from the mid-point grow by it in A and shrink by it in B.
    """
    if winding == "cylinder":
        edges = np.concatenate(([0.0], np.cumsum(layer_lengths_m))) - layer_lengths_m.sum() / 2
        edges = edges - mid_point_offset_m
        return np.asarray(edges[1:] ** 2 - edges[:-1] ** 2)
    pattern = _PATTERN[winding]
    weights = np.empty(len(layer_lengths_m))
    inner = {"A": mid_point_offset_m, "B": -mid_point_offset_m}
    for layer, length in enumerate(layer_lengths_m):
        half = pattern[layer % len(pattern)]
        outer = inner[half] + float(length)
        area = outer**2 - inner[half] ** 2
        weights[layer] = -area if half == "A" else area
        inner[half] = outer
    return weights


def pigtail_weight_m2(weights_m2: Array) -> float:
    """Return the weight of the fibre outside the coil; with it a uniform Tdot gives exactly zero."""
    return -float(weights_m2.sum())


def rotation_per_integral_dph(fibre: Fibre) -> float:
    """Return the apparent rotation in deg/h of 1 m2 K/s of Mohr's integral."""
    strain = fibre.thermo_optic_per_k + fibre.index * fibre.expansion_per_k
    rad_per_s = fibre.index / (fibre.length_m * fibre.diameter_m) * strain
    return math.degrees(rad_per_s) * 3600.0


def layer_lengths_m(fibre: Fibre, layers: int, turn_error_m: float, rng: np.random.Generator) -> Array:
    """Return the fibre length in each layer, float64 (layers,): equal but for a random turn error (rms)."""
    error = rng.standard_normal(layers) * turn_error_m
    return np.asarray(fibre.length_m / layers + error)
