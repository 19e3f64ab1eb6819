"""A record of an IMU without holes: at rest a missing sample is as those about it, in a turn nobody knows it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import AXES
from bench.analysis.common.outliers import RARE, outliers
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_REST_DPS = 0.1
"""Mean rate over a second beside a gyro's usual one, which is that of its rests, from which on the unit turns."""
LONGEST_S = 5.0
_BESIDE_S = 1.0
"""How much of the record on either side says what is missing."""
_TURNED_MPS2 = 0.2
"""Change of the specific force over a hole, of gravity by 1.2 deg, from which on the unit turned in it."""


def whole(
    rates_dps: Array, forces_mps2: Array, period_s: float, where: str
) -> tuple[Array, Array, list[str]]:
    """Return rates and specific forces, (n, 3) each, with samples filled in at rest, and what was filled in.

    NaN are missing; single values at rest that stand far off those about them count as missing, too. Each is the
    mean of a second before and after. RecordError for samples that are missing in a turn, and for more than 5 s.
    A unit that does not lie after a hole as it lay before it has turned.
    """
    values = np.hstack((rates_dps, forces_mps2))
    rest = _rests(rates_dps, period_s)
    missing = np.asarray(np.isnan(values).any(axis=1))
    beside = max(round(_BESIDE_S / period_s), 1)
    for start, stop in stretches(missing).tolist():
        still = bool(rest[start:stop].all()) and _same_attitude(forces_mps2, start, stop, beside)
        if not still or (stop - start) * period_s > LONGEST_S:
            raise RecordError(
                "samples are missing or marked as faulty",
                where=f"{where}, {start * period_s:.2f} s",
                found=f"{stop - start} of them, {'at rest' if still else 'while the unit turns'}",
                expected=f"at rest at most {LONGEST_S:g} s, in a turn none: a lost increment cannot be made up",
                remedy="check cable, baud rate and load of the host, then run the scheme again",
            )
    found = []
    if missing.any():
        found.append(f"samples missing {int(missing.sum())}, first at {missing.argmax() * period_s:.2f} s")
    for column, name in enumerate(_names()):
        far, sizes = outliers(values[:, column], most=RARE)
        far, sizes = far[rest[far]], sizes[rest[far]]
        if len(far):
            values[far, column] = np.nan
            unit = "deg/s" if column < len(AXES) else "m/s2"
            most = f"{sizes[np.abs(sizes).argmax()]:+.3g} {unit}"
            found.append(f"{name} {len(far)}, up to {most} off, first at {far[0] * period_s:.2f} s")
    _fill(values, beside)
    remarks = [f"Filled at rest with means of a second on either side: {'; '.join(found)}."] if found else []
    return values[:, : len(AXES)], values[:, len(AXES) :], remarks


def _names() -> Iterator[str]:
    for kind in ("gyro", "accelerometer"):
        for axis in AXES:
            yield f"{kind} {axis}"


def _rests(rates_dps: Array, period_s: float) -> NDArray[np.bool_]:
    """Return which samples (n,) lie in a second at rest that has rests on both sides, or what is missing."""
    size = max(round(_BESIDE_S / period_s), 1)
    count = -(-len(rates_dps) // size)
    padded = np.full((count * size, rates_dps.shape[1]), np.nan)
    padded[: len(rates_dps)] = rates_dps
    blocks = padded.reshape(count, size, -1)
    seen = np.isfinite(blocks).any(axis=1).all(axis=1)
    middle = np.full((count, blocks.shape[2]), np.nan)
    middle[seen] = np.nanmedian(blocks[seen], axis=1)
    usual = np.median(middle[seen], axis=0) if seen.any() else np.zeros(blocks.shape[2])
    turning = seen & np.asarray(np.abs(middle - usual) > _REST_DPS).any(axis=1)
    still = ~turning
    still[1:] &= ~turning[:-1]
    still[:-1] &= ~turning[1:]
    return np.asarray(np.repeat(still, size)[: len(rates_dps)])


def _same_attitude(forces_mps2: Array, start: int, stop: int, beside: int) -> bool:
    """Return whether gravity is the same on both sides of a hole; so where one side has no samples."""
    sides = forces_mps2[max(start - beside, 0) : start], forces_mps2[stop : stop + beside]
    before, after = (side[np.isfinite(side).all(axis=1)] for side in sides)
    if not len(before) or not len(after):
        return True
    return float(np.linalg.norm(after.mean(axis=0) - before.mean(axis=0))) < _TURNED_MPS2


def _fill(values: Array, beside: int) -> None:
    """Fill what is missing of each column with the mean of `beside` samples before and after, in place."""
    for own in values.T:
        missing = np.isnan(own)
        for start, stop in stretches(missing).tolist():
            about = np.concatenate((own[max(start - beside, 0) : start], own[stop : stop + beside]))
            about = about[np.isfinite(about)]
            own[start:stop] = about.mean() if len(about) else np.nan
