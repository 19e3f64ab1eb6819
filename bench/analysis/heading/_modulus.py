"""The accelerometers by the modulus of specific force, which neither a tilt nor a turn of the platform changes.

At rest |f| = g whatever the attitude. In a space-stable platform gravity turns through the axes once a sidereal
day, so that a bias b shows as u . b, u the direction of gravity, and what is quadratic in f twice a day. The
course at the reference heading holds what the accelerometers have everywhere. A change of it with heading
(mean, cosine and sine over the sidereal angle) is an error of the accelerometers that goes with heading, by
their temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.heading._checks import Finding
from bench.analysis.heading._log import PlatformLog, stays
from bench.analysis.heading._restricted import FORMS, Restricted, hourly, markov_after_lag
from bench.analysis.heading._temperature import harmonics
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_PER_RAD, EARTH_RATE_RAD_S, SIDEREAL_DAY_S, UG_MPS2
from drivers.base.errors import RecordError

_ALPHA = 0.01
_REFERENCE = 5
_ARCSEC_PER_UG = 1e-6 * ARCSEC_PER_RAD


@dataclass(frozen=True, eq=False)
class ModulusTest:
    """Change of |f| from the reference heading, ug, stay by stay: `change_ug` and `sigma_ug` (k, 3): mean, cos,
    sin.

    `p_value` (k,): of all three being nothing. `skipped`: stays shorter than a sidereal day.
    """

    headings_deg: tuple[float, ...]
    change_ug: Array
    sigma_ug: Array
    p_value: Array
    skipped: int

    @property
    def limit(self) -> float:
        """The p value below which a stay differs: 1 % for all stays together."""
        return _ALPHA / len(self.p_value)

    @property
    def changed(self) -> bool:
        """Whether any stay differs."""
        return float(self.p_value.min()) < self.limit

    def findings(self) -> list[Finding]:
        """Return a finding where the modulus goes with heading."""
        if not self.changed:
            return []
        worst = int(np.argmin(self.p_value))
        mean, cosine, sine = self.change_ug[worst]
        swing_ug = float(np.hypot(cosine, sine))
        return [
            Finding(
                f"the modulus of specific force goes with heading: at {self.headings_deg[worst]:.0f} deg "
                f"it is {mean:+.1f} ug off and swings by {swing_ug:.1f} ug more over the sidereal day "
                f"(p = {self.p_value[worst]:.1g})",
                "no tilt can do that, it is the accelerometers' own error; the position error that it makes, "
                f"about {_ARCSEC_PER_UG * float(np.hypot(mean, swing_ug)):.1f} arcsec, does not grow, and is "
                "not compensated",
                False,
            )
        ]


def modulus_test(log: PlatformLog) -> ModulusTest | None:
    """Compare the modulus of specific force between headings; None for a log without accelerometers.

    One regression on hourly means: five columns for the course at all headings, three for each later stay of a
    sidereal day or more. RecordError for a modulus that is not gravity's, or no such stay.
    """
    if log.force_mps2 is None:
        return None
    modulus = np.linalg.norm(log.force_mps2, axis=1)
    usual = float(np.nanmedian(modulus)) if np.isfinite(modulus).any() else float("nan")
    if not 9.7 < usual < 9.9:
        raise RecordError(
            "the modulus of specific force is not gravity's",
            found=f"{usual:.4f} m/s^2 in the median",
            expected="9.78 to 9.83 m/s^2, three accelerometers in m/s^2",
            remedy="check the columns and their unit, or leave the accelerometers out",
        )
    every = stays(log)
    longer = [stay for stay in every[1:] if stay.duration_s >= SIDEREAL_DAY_S * 0.98]
    kept = [stay for stay in every[:1] if stay.duration_s >= SIDEREAL_DAY_S * 0.98]
    if not kept or not longer:
        raise RecordError(
            "the modulus of specific force cannot be compared between headings",
            found=f"{len(kept)} stays of a sidereal day at the reference heading, {len(longer)} at others",
            expected="one or more of each",
            remedy="stay longer, or leave the accelerometers out",
        )
    blocks = []
    for number, stay in enumerate([every[0], *longer]):
        part = slice(stay.start, stay.stop)
        terms = harmonics(log.sidereal_rad[part], 2)
        block = hourly(log.time_s[part], np.column_stack([terms, modulus[part]]))
        block[:, 0] += log.time_s[stay.start]
        own = np.zeros((len(block), 3 * len(longer)))
        if number:
            own[:, 3 * number - 3 : 3 * number] = block[:, 1:4]
        blocks.append(np.column_stack([block[:, :-1], own, block[:, -1]]))
    table = np.concatenate(blocks)
    rows, ug = table[:, 1:-1], (table[:, -1] - usual) / UG_MPS2
    fits = [Restricted.fit(rows, ug, _covariance(table[:, 0], log.latitude_deg, *form)) for form in FORMS]
    return _tested(fits, [stay.heading_deg for stay in longer], len(every) - 1)


def _covariance(time_s: Array, latitude_deg: float, wander_s: float, white: float) -> Array:
    """Return the covariance (n, n) of biases that wander alike on three axes, seen along gravity, and of white
    noise.

    u(t) . b(t) has the wander's covariance times u(t) . u(t'), which turns once a sidereal day.
    """
    angle = EARTH_RATE_RAD_S * (time_s[:, None] - time_s[None, :])
    level = float(np.cos(np.radians(latitude_deg))) ** 2
    along = level * np.cos(angle) + 1.0 - level
    return np.asarray(markov_after_lag(time_s, wander_s, 0.0) * along + white * np.eye(len(time_s)))


def _tested(fits: Sequence[Restricted], headings_deg: list[float], stayed: int) -> ModulusTest:
    """Average over the forms of the noise, each by its likelihood: days of record do not fix how long it
    remembers.
    """
    from scipy.stats import f as ratio  # slow to import

    costs = np.array([fit.cost for fit in fits])
    weights = np.exp(-0.5 * (costs - costs.min()))
    weights /= weights.sum()
    changes = np.array([fit.solution[_REFERENCE:] for fit in fits])
    covariances = np.array([fit.covariance[_REFERENCE:, _REFERENCE:] for fit in fits])
    change = weights @ changes
    variance = weights @ (np.diagonal(covariances, axis1=1, axis2=2) + (changes - change) ** 2)
    p_value = []
    for start in range(0, len(change), 3):
        part = slice(start, start + 3)
        squares = [
            row[part] @ np.linalg.solve(c[part, part], row[part])
            for row, c in zip(changes, covariances, strict=True)
        ]
        p_value.append(float(weights @ ratio.sf(np.array(squares) / 3.0, 3, fits[0].freedom)))
    return ModulusTest(
        headings_deg=tuple(headings_deg),
        change_ug=change.reshape(-1, 3),
        sigma_ug=np.sqrt(variance).reshape(-1, 3),
        p_value=np.array(p_value),
        skipped=stayed - len(headings_deg),
    )
