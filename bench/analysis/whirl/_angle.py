"""The rotation angle at every gyro sample, from a table polled far more slowly, by the unit's own z gyro.

Between two polls a real table ripples; the z gyro sees that. Its integral, scaled and shifted onto the encoder,
is the angle: encoder at the polls, gyro in between. The fit that lays one on the other also finds scale factor,
z drift, how much later the table's answers were stamped than they were true (latency), and whether the two
clocks run apart. The last two show only if the rate changes, so a run should begin and end at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.whirl._types import UnfitRotation
from drivers.base.arrays import Array

_SCALE_TOLERANCE = 0.02
_STEADY = 0.05
_AROUND_S = 1.5
_INDEPENDENT = 1e-3
_LEAST_POLLS = 10


@dataclass(frozen=True)
class Alignment:
    """How the z gyro lies on the encoder. Quantities that the rotation does not show are None.

    `scale_error_ppm` of the z gyro; `drift_dph` on z with the Earth's vertical rate in it; `latency_s`: how
    much later than true the table's angles are stamped; `clock_error_ppm` of the table's stamps against the
    gyro's; `residual_arcsec` rms of the encoder about the gyro.
    """

    scale_error_ppm: float | None
    drift_dph: float
    latency_s: float | None
    clock_error_ppm: float | None
    residual_arcsec: float
    polls: int


def align_angle(edges_s: Array, rate_z_dps: Array, poll_s: Array, poll_deg: Array) -> tuple[Array, Alignment]:
    """Return the angle in rad at the edges of the gyro's samples, (n + 1,), turns counted, and how it was
    found.

    `rate_z_dps`: (n,), without holes. `poll_s`, `poll_deg`: (k,), the encoder, any whole turns. UnfitRotation
    names a wrong sign or a scale that is not the encoder's.
    """
    turned = np.concatenate(([0.0], np.cumsum(np.diff(edges_s) * rate_z_dps)))
    inside = (poll_s >= edges_s[0]) & (poll_s <= edges_s[-1])
    poll_s, poll_deg = poll_s[inside], poll_deg[inside]
    if len(poll_s) < _LEAST_POLLS:
        raise UnfitRotation(
            "too few table angles over the gyro's record",
            where="angle",
            found=f"{len(poll_s)}",
            expected=f"at least {_LEAST_POLLS}",
            remedy="check that table and gyro were recorded at the same time",
        )
    at_polls = np.interp(poll_s, edges_s, turned)
    _check_sign(poll_deg, at_polls)
    # The encoder's turns are counted by the gyro, which is right to half a turn between polls.
    expected = np.diff(at_polls)
    step = expected + (np.diff(poll_deg) - expected + 180.0) % 360.0 - 180.0
    encoder = poll_deg[0] + np.concatenate(([0.0], np.cumsum(step)))
    rate = np.interp(poll_s, 0.5 * (edges_s[1:] + edges_s[:-1]), rate_z_dps)
    steady = _steady(edges_s, turned, poll_s)
    if int(steady.sum()) < _LEAST_POLLS:
        steady[:] = True
    columns = _columns(poll_s, at_polls, rate, steady)
    names = list(columns)
    design = np.stack([columns[name] for name in names], axis=1)
    solution, *_ = np.linalg.lstsq(design[steady], (encoder - at_polls)[steady], rcond=None)
    found = dict(zip(names, solution.tolist(), strict=True))
    scale = found.get("scale", 0.0)
    if abs(scale) > _SCALE_TOLERANCE:
        raise UnfitRotation(
            "the z gyro does not follow the table",
            where="angle",
            found=f"scale factor off by {-100.0 * scale:+.2f} %",
            expected=f"within {100.0 * _SCALE_TOLERANCE:g} %",
            remedy="check for a saturated gyro, or for clocks that differ by as much",
        )
    residual = encoder - at_polls - design @ solution
    late = -found.get("latency", 0.0) - found.get("clock", 0.0) * (edges_s - poll_s[0])
    angle = turned * (1.0 + scale) + found["start"] + found["drift"] * (edges_s - poll_s[0])
    # what a stamp is late by was taken out with the columns above; the remainder is the encoder's own word
    angle = angle + np.interp(edges_s + late, poll_s[steady], residual[steady])
    return np.radians(angle), Alignment(
        scale_error_ppm=-1e6 * found["scale"] if "scale" in found else None,
        drift_dph=-3600.0 * found["drift"],
        latency_s=-found["latency"] if "latency" in found else None,
        clock_error_ppm=-1e6 * found["clock"] if "clock" in found else None,
        residual_arcsec=float(residual[steady].std() * 3600.0),
        polls=len(poll_s),
    )


def _columns(poll_s: Array, turned: Array, rate: Array, steady: NDArray[np.bool_]) -> dict[str, Array]:
    """Return the columns that the rotation tells apart: start and z drift, scale, latency, clock."""
    since = poll_s - poll_s[0]
    columns = {"start": np.ones(len(poll_s)), "drift": since}
    for name, column in (("scale", turned), ("latency", rate), ("clock", rate * since)):
        others = np.stack([other[steady] for other in columns.values()], axis=1)
        own = column[steady]
        size = float(np.linalg.norm(own))
        if not size:
            continue
        rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        if np.linalg.norm(rest) > (0.1 if name == "latency" else _INDEPENDENT) * size:
            columns[name] = column
        elif name == "latency":
            break
    return columns


def _steady(edges_s: Array, turned: Array, poll_s: Array) -> NDArray[np.bool_]:
    """Return which polls have the same rate before and after them."""
    before, at, after = (np.interp(poll_s + shift, edges_s, turned) for shift in (-_AROUND_S, 0.0, _AROUND_S))
    change = np.abs((after - at) - (at - before)) / _AROUND_S
    largest = float(np.abs(after - before).max()) / (2.0 * _AROUND_S)
    return np.asarray(change <= _STEADY * largest)


def _check_sign(poll_deg: Array, turned: Array) -> None:
    """Raise if the gyro turns against the encoder; told by short steps, whose wraps are sure."""
    step = (np.diff(poll_deg) + 180.0) % 360.0 - 180.0
    own = np.diff(turned)
    sure = np.abs(own) < 150.0
    scale = float((own[sure] ** 2).sum())
    slope = float((own[sure] * step[sure]).sum()) / scale if scale else 0.0
    if scale and slope < -0.5:
        raise UnfitRotation(
            "gyro and table turn in opposite senses",
            where="angle",
            found=f"table angle {slope:+.3f} x the z gyro's angle",
            expected="+1: both counter-clockwise positive about the same z",
            remedy="turn the sign of the axis in the table's set-up or mount the unit z up; compensated "
            "with a wrong sign the whirl doubles",
        )
    if scale and abs(slope - 1.0) > 0.2:
        raise UnfitRotation(
            "the z gyro does not follow the table",
            where="angle",
            found=f"table angle {slope:+.3f} x the z gyro's angle",
            expected="+1",
            remedy="check for a saturated gyro, for the axis that is called z and for the encoder; "
            "whirl lines would be fitted at the wrong angle",
        )
