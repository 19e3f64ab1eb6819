"""The residual rate of the horizontal gyros, equation (11), and its increments in body axes by blocks.

wbar = (wx, wy) - Earth rate. Drift, and Earth rate, which is constant in body axes, may stay
in: the fits estimate them together with the whirl. The gyros' mean is never taken for drift: in rotation one
way a constant tilt of the unit against the spin axis gives the same (3 arcsec at 6 deg/s: 0.31 deg/h).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.whirl._types import ARCSEC_PER_DEG, Complex, TurnRecord
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_up_dph

TRAVEL_DEG = 0.5
"""Table angle over which the play is taken up, unless a run says more."""
LONGEST_DEG = 30.0
"""Table angle over which a bearing remembers from which side it came, at most."""
_BLOCK_S = 1.0
_FINE = 5
"""Into so many parts blocks are cut within `LONGEST_DEG` of a reversal, where the memory shows."""


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

    `turning_s`: integral of exp(j psi) dt, the column of a drift. `first_rad`, `last_rad`, `first_s`, `last_s`:
    table angle and time since the record's start at the ends of the blocks, (k,). `reverses`: the record turns
    in both senses, by more than `LONGEST_DEG` each; `path_rad` (n + 1,): its angle at every sample, and `first`,
    `last` (k,) where in it the blocks' ends lie.
    """

    increment_arcsec: Complex
    turning_s: Complex
    first_rad: Array
    last_rad: Array
    first_s: Array
    last_s: Array
    earth_up_dph: float
    reverses: bool
    path_rad: Array
    first: NDArray[np.int64]
    last: NDArray[np.int64]

    @property
    def duration_s(self) -> Array:
        """Length of the blocks, (k,)."""
        return self.last_s - self.first_s

    def column(self, line: float) -> Complex:
        """Return the increments of exp(j m psi); Earth's vertical rate on the tilted gyros is part of it."""
        first, last = np.exp(1j * line * self.first_rad), np.exp(1j * line * self.last_rad)
        seen_up = np.radians(self.earth_up_dph / ARCSEC_PER_DEG) * self.duration_s
        return np.asarray(last - first + 0.5j * seen_up * (first + last))

    def play(self, travel_deg: float) -> Array:
        """Return the increments of `slack` with a travel, (k,)."""
        value = slack(self.path_rad, np.radians(travel_deg))
        return np.asarray(value[self.last] - value[self.first])


def make_blocks(record: TurnRecord) -> Blocks:
    """Sum increments over blocks of 1 s, shorter ones after reversals.

    Blocks with a sample that is not usable are left out; in a record that reverses also those at its start, where
    nobody knows from which side the bearing came.
    """
    size = max(1, round(_BLOCK_S / record.period_s))
    fine = max(1, size // _FINE)
    longest = np.radians(LONGEST_DEG)
    unknown, after = (slack(record.angle_rad, longest, start) for start in (1.0, 0.0))
    sure = unknown == after
    reverses = bool(sure.any()) and float(np.ptp(after[sure])) == 1.0
    edges = np.arange(0, len(record.usable) // size * size + 1, fine)
    moving = np.diff(after[edges]) != 0.0
    whole = edges % size == 0
    edges = edges[whole | np.append(moving, False) | np.append(False, moving)] if reverses else edges[whole]
    first, last = edges[:-1], edges[1:]
    turn = np.exp(1j * record.middle_rad)
    total = np.asarray(np.add.reduceat((residual_increments(record) * turn)[: edges[-1]], first))
    turning = np.asarray(np.add.reduceat(turn[: edges[-1]], first) * record.period_s)
    keep = ~np.isnan(total) & (sure[first] | (not reverses))
    since = record.time_s - record.time_s[0]
    return Blocks(
        total[keep],
        turning[keep],
        record.angle_rad[first[keep]],
        record.angle_rad[last[keep]],
        since[first[keep]],
        since[last[keep]],
        earth_rate_up_dph(record.latitude_deg),
        reverses,
        record.angle_rad,
        first[keep],
        last[keep],
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
