"""Frames, units and states of the calibration: 30 states, their priors, targets and printed units.

n is local east, north, up, fixed to the table's base; b is right, forward, up of the IMU; C turns b into n.

    gyro           w~ = (I + K_g) w + eps + noise                K_g full: scale factors and installation
    accelerometer  f~ = (I + K_a) f + nabla + K_2 (f * f) + noise  K_a lower triangular, K_2 diagonal

The gauge: turning b by a small theta changes no velocity (phi(0) += C_home theta, K_g += [theta x],
K_a += [theta x]), so three of the 18 matrix elements are conventions. Here K_a is lower triangular: x of b lies
along accelerometer x, y of b in the plane of accelerometers x and y. `to_gauge` converts a truth given otherwise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from bench.analysis.common.attitude import cross_matrix
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, EARTH_RATE_RAD_S, EQUATOR_GRAVITY_MPS2, UG_MPS2, gravity_mps2

UG_PER_G2 = 1e-6 / EQUATOR_GRAVITY_MPS2
"""s^2/m that one ug/g^2 is."""
DPH_RAD_S = ARCSEC_RAD
PPM = 1e-6

AXES = "xyz"
STATES = 30
PHI, DV = slice(0, 3), slice(3, 6)
EPS, NABLA, KG, KA, K2 = slice(6, 9), slice(9, 12), slice(12, 21), slice(21, 27), slice(27, 30)
PARAMETERS = slice(6, 30)
KA_ELEMENTS = ((0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2))
"""(row, column) of the lower triangle, column by column."""

PARAMETER_NAMES = (
    *(f"eps_{axis}" for axis in AXES),
    *(f"nabla_{axis}" for axis in AXES),
    *(f"Kg_{row}{column}" for column in AXES for row in AXES),
    *(f"Ka_{AXES[row]}{AXES[column]}" for row, column in KA_ELEMENTS),
    *(f"K2_{axis}" for axis in AXES),
)
STATE_NAMES = ("phi_E", "phi_N", "phi_U", "dv_E", "dv_N", "dv_U", *PARAMETER_NAMES)


def _unit(name: str) -> tuple[str, float]:
    kind, element = name.split("_")
    if kind in ("Kg", "Ka"):
        return ("ppm", PPM) if element[0] == element[1] else ("arcsec", ARCSEC_RAD)
    return {
        "phi": ("arcsec", ARCSEC_RAD),
        "dv": ("m/s", 1.0),
        "eps": ("deg/h", DPH_RAD_S),
        "nabla": ("ug", UG_MPS2),
        "K2": ("ug/g^2", UG_PER_G2),
    }[kind]


STATE_UNITS = tuple(_unit(name)[0] for name in STATE_NAMES)
UNIT_SIZE = np.array([_unit(name)[1] for name in STATE_NAMES])
"""SI value of one printed unit, shape (30,)."""


@dataclass(frozen=True)
class Site:
    """Where the table stands; `gravity` in m/s^2, None means normal gravity at the latitude."""

    latitude_deg: float = 45.7796
    height_m: float = 0.0
    gravity: float | None = None

    @property
    def gravity_mps2(self) -> float:
        """Gravity in m/s^2."""
        return gravity_mps2(self.latitude_deg, self.height_m) if self.gravity is None else self.gravity

    @property
    def earth_rate_rad_s(self) -> Array:
        """Earth rate in n, rad/s, shape (3,)."""
        latitude = math.radians(self.latitude_deg)
        return EARTH_RATE_RAD_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])


def _by_kind(phi: tuple[float, ...], dv: float, rest: tuple[float, float, float, float, float]) -> Array:
    eps, nabla, scale, angle, square = rest
    sizes = {"eps": eps, "nabla": nabla, "K2": square}
    parameters = [
        sizes.get(name.split("_")[0], scale if name[-1] == name[-2] else angle) for name in PARAMETER_NAMES
    ]
    return np.asarray(np.array([*phi, dv, dv, dv, *parameters]) * UNIT_SIZE)


@dataclass(frozen=True, eq=False)
class Noise:
    """What is assumed of the sensors and of the velocity at rest."""

    arw_deg_per_sqrt_h: float = 0.001
    vrw_ug_per_sqrt_hz: float = 10.0
    velocity_mps: float = 1e-3

    @property
    def arw(self) -> float:
        """Angle random walk, rad per sqrt(s)."""
        return math.radians(self.arw_deg_per_sqrt_h) / 60.0

    @property
    def vrw(self) -> float:
        """Velocity random walk, m/s per sqrt(s)."""
        return self.vrw_ug_per_sqrt_hz * UG_MPS2


@dataclass(frozen=True, eq=False)
class Task:
    """What a calibration starts from and must reach: site, noise, prior sigma and targets, SI, shape (30,)/(24,).

    Defaults are the reference set: a navigation-grade unit after its factory calibration. `known`: what earlier
    runs tell of the parameters beside the prior sigma, an information matrix (24, 24) in units of it, or None.
    """

    site: Site = field(default_factory=Site)
    noise: Noise = field(default_factory=Noise)
    prior_sigma: Array = field(
        default_factory=lambda: _by_kind((360.0, 360.0, 3600.0), 0.1, (0.1, 1000.0, 100.0, 100.0, 100.0))
    )
    target_sigma: Array = field(
        default_factory=lambda: _by_kind((0.0, 0.0, 0.0), 0.0, (0.003, 10.0, 5.0, 5.0, 5.0))[PARAMETERS]
    )
    known: Array | None = None


def rotation(axis: Array, angle_rad: Array) -> Array:
    """Return the matrices, shape (n, 3, 3), of turns about unit vectors (3,) or (n, 3) by `angle_rad` (n,)."""
    skew = cross_matrix(axis)
    angle = np.asarray(angle_rad, dtype=np.float64)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew))


def signed_permutations() -> list[Array]:
    """Return the 48 matrices (3, 3) that exchange and reverse axes, the identity first."""
    matrices = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[order, range(3)] = signs
            matrices.append(matrix)
    return matrices


def pack(eps: Array, nabla: Array, kg: Array, ka: Array, k2: Array) -> Array:
    """Return the 24 parameters in state order, SI; `ka` must be lower triangular (see `to_gauge`)."""
    return np.concatenate([eps, nabla, kg.ravel(order="F"), [ka[at] for at in KA_ELEMENTS], k2])


def unpack(parameters: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return eps (3,), nabla (3,), K_g (3, 3), K_a (3, 3), K_2 (3,) of 24 parameters in state order."""
    ka = np.zeros((3, 3))
    for at, value in zip(KA_ELEMENTS, parameters[15:21], strict=True):
        ka[at] = value
    return parameters[:3], parameters[3:6], parameters[6:15].reshape(3, 3, order="F"), ka, parameters[21:24]
