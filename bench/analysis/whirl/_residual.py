"""The residual rate of the horizontal gyros, equation (11), and its increments in body axes by blocks.

wbar = (wx, wy) - Earth rate. Drift, and Earth rate, which is constant in body axes, may stay
in: the fits estimate them together with the whirl. The gyros' mean is never taken for drift: in rotation one
way a constant tilt of the unit against the spin axis gives the same (3 arcsec at 6 deg/s: 0.31 deg/h).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from bench.analysis.whirl._types import ARCSEC_PER_DEG, Complex, TurnRecord
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_up_dph

TRAVEL_DEG = 0.5
"""Table angle over which the play is taken up, unless a run says more."""
_BLOCK_S = 1.0


def heading_from_body_rate(body_rate_dph: complex) -> float:
    """Return the azimuth of the body's y axis in [0, 360) deg, clockwise from north, that Earth rate shows."""
    return float(np.degrees(np.angle(body_rate_dph / 1j)) % 360.0)


def residual_increments(record: TurnRecord, body_rate_dph: complex = 0j) -> Complex:
    """Return what the residual rate turns through in each interval, arcsec, complex (n,), in rotating axes.

    `body_rate_dph`: rate of the body in its own axes to take out (Earth rate). Intervals that are not usable are
    NaN.
    """
    rate = record.rate_dps * ARCSEC_PER_DEG
    residual = rate[:, 0] + 1j * rate[:, 1]
    if body_rate_dph:
        residual = residual - body_rate_dph * np.exp(-1j * record.middle_rad)
    return np.asarray(np.where(record.usable, residual * record.period_s, np.nan))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Increments of the body tilt over k blocks: `increment_arcsec` complex (k,), `turning_s` complex (k,).

    `turning_s`: integral of exp(j psi) dt, the column of a drift. `first_rad`, `last_rad`, `middle_rad`,
    `duration_s`: angle at the ends of the blocks and their length, (k,). `first_slack`, `last_slack`: see
    `slack`.
    """

    increment_arcsec: Complex
    turning_s: Complex
    first_rad: Array
    last_rad: Array
    first_slack: Array
    last_slack: Array
    duration_s: float
    earth_up_dph: float

    def column(self, line: float) -> Complex:
        """Return the increments of exp(j m psi); Earth's vertical rate on the tilted gyros is part of it."""
        first, last = np.exp(1j * line * self.first_rad), np.exp(1j * line * self.last_rad)
        seen_up = np.radians(self.earth_up_dph / ARCSEC_PER_DEG) * self.duration_s
        return np.asarray(last - first + 0.5j * seen_up * (first + last))


def make_blocks(record: TurnRecord, travel_deg: float = TRAVEL_DEG) -> Blocks:
    """Sum increments over blocks of 1 s; blocks with a sample that is not usable are left out."""
    size = max(1, round(_BLOCK_S / record.period_s))
    count = len(record.usable) // size
    turn = np.exp(1j * record.middle_rad[: count * size]).reshape(count, size)
    increments = residual_increments(record)[: count * size]
    total = (increments.reshape(count, size) * turn).sum(axis=1)
    keep = ~np.isnan(total)
    edges = record.angle_rad[: count * size + 1 : size]
    slack_at = slack(record.angle_rad, np.radians(travel_deg))[: count * size + 1 : size]
    return Blocks(
        total[keep],
        turn.sum(axis=1)[keep] * record.period_s,
        edges[:-1][keep],
        edges[1:][keep],
        slack_at[:-1][keep],
        slack_at[1:][keep],
        size * record.period_s,
        earth_rate_up_dph(record.latitude_deg),
    )


def slack(angle_rad: Array, travel_rad: float, start: float = 0.0) -> Array:
    """Return the smoothed indicator of reverse rotation, 0 .. 1, float64 (n,).

    It falls to 0 while the angle grows by `travel_rad` and rises to 1 while it comes back by as much, which
    is the play operator of a bearing's clearance; it is stepped from turning point to turning point.
    """
    sense = np.sign(np.diff(angle_rad))
    moving = np.flatnonzero(sense)
    if not len(moving):
        return np.full(len(angle_rad), start)
    turning = moving[1:][np.diff(sense[moving]) != 0]
    value, parts = start, []
    for first, last in itertools.pairwise([0, *turning.tolist(), len(angle_rad)]):
        # one angle more than is kept: the next stretch begins there
        part = np.clip(value - (angle_rad[first : last + 1] - angle_rad[first]) / travel_rad, 0.0, 1.0)
        value = float(part[-1])
        parts.append(part[: last - first])
    return np.concatenate(parts)
