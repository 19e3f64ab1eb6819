"""Three accelerometers on a space-stable platform, in whose axes gravity turns once a sidereal day.

    f~_i = (1 + k_i) f_i + b_i + c_i (T - T_0) + m_i (cos psi - 1) + n_i sin psi + wander + white noise

T is the platform's temperature, psi the heading: what turns with the case may pull at them (a magnetic field).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import UG_MPS2
from simulators.config import Accelerometers


@dataclass(frozen=True, eq=False)
class AccelerometerErrors:
    """Errors of the three, (3,) each: bias, m/s2; scale factor, 1; bias over temperature, m/s2/K; (2, 3): bias
    with cosine and sine of the heading, m/s2.

    White noise is the root of its one-sided density, wander a Gauss-Markov bias of each by its sigma and
    correlation time.
    """

    bias_mps2: Array = field(default_factory=lambda: np.zeros(3))
    scale: Array = field(default_factory=lambda: np.zeros(3))
    per_k_mps2: Array = field(default_factory=lambda: np.zeros(3))
    heading_mps2: Array = field(default_factory=lambda: np.zeros((2, 3)))
    white_mps2_per_sqrt_hz: float = 0.0
    wander_mps2: float = 0.0
    wander_h: float = 20.0

    def measured(self, force_mps2: Array, warmer_k: Array, heading_rad: Array) -> Array:
        """Return what they make of specific force (n, 3), without noise; `warmer_k` (n,): above the set point."""
        turned = np.stack([np.cos(heading_rad) - 1.0, np.sin(heading_rad)], axis=1)
        bias = self.bias_mps2 + warmer_k[:, None] * self.per_k_mps2 + turned @ self.heading_mps2
        return np.asarray(force_mps2 + self.scale * force_mps2 + bias)


def draw_accelerometers(unit_seed: int, sizes: Accelerometers) -> AccelerometerErrors:
    """Draw a unit's accelerometers; errors are normal, of one standard deviation as `sizes` has them."""
    bias, scale, per_k, *heading = np.random.default_rng([unit_seed, 4712]).standard_normal((5, 3))
    return AccelerometerErrors(
        bias_mps2=bias * sizes.bias_ug * UG_MPS2,
        scale=scale * sizes.scale_ppm * 1e-6,
        per_k_mps2=per_k * sizes.per_k_ug * UG_MPS2,
        heading_mps2=np.array(heading) * sizes.heading_ug * UG_MPS2,
        white_mps2_per_sqrt_hz=sizes.white_ug_per_sqrt_hz * UG_MPS2,
        wander_mps2=sizes.wander_ug * UG_MPS2,
        wander_h=sizes.wander_h,
    )
