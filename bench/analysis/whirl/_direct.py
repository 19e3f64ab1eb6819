"""The direct fit: body lines of the whirl from increments of the body tilt, by complex least squares.

    z_k = r dt + eps sum exp(j psi) dt + sum_m a_m (exp(j m psi_k+1) - exp(j m psi_k)) + J (s_k+1 - s_k) + noise

z_k is the residual rate, turned into body axes and summed over a block. Its noise is white when the gyros'
is, so least squares is the best there is: the sd of a_m is N / (|m| w sqrt T). Everything is in the measured
angle, so that ripple, reversals and stops do no harm. r, a constant rate in body axes, is Earth rate and what
is wrong with it; eps is drift in gyro axes; J a jump of tilt with the sense of rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from bench.analysis.whirl._residual import TRAVEL_DEG, Blocks, make_blocks
from bench.analysis.whirl._types import Complex, NotObservable, TurnRecord
from drivers.base.arrays import Array

DEFAULT_LINES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
SEPARABLE = 10.0
"""Drift and constant tilt are told apart if their columns' condition number is below this (reversals: 1.07)."""
_SINGULAR = 1e6
TRAVELS_DEG = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 17.0, 22.0, 30.0)
"""Travels of play that are tried; what is taken up within a block of 1 s looks alike."""
_TRAVEL_SEEN = 8.0
"""Gain of logarithmic likelihood from which a travel other than the usual one is believed."""
DRIFT_IN_TILT = (
    "drift and the constant tilt of the unit against the spin axis (line +1) are one and the same in "
    "rotation one way: both are in line +1, which also holds what is wrong with the installation angles; a "
    "reversal separates them"
)
INSTALLATION_IN_TILT = (
    "line +1 also holds what is wrong with the installation angles of the x and y gyros towards z: no "
    "rotation about z tells the two apart, and the attitude needs their sum only"
)


@dataclass(frozen=True)
class Estimate:
    """A complex estimate; `sd` is the standard deviation of its real and of its imaginary part."""

    value: complex
    sd: float


@dataclass(frozen=True, eq=False)
class DirectFit:
    """What a direct fit gives. `lines` (l,) and `amplitudes_arcsec`, complex (l,), with `sd_arcsec` per axis.

    `body_rate_dph`, `drift_dph`: one a record; `drift_dph` is empty where it is not separable. `play_arcsec`:
    jump of tilt with reverse rotation, None without reversals. `noise_arcsec_per_sqrt_s`: angle random walk N
    an axis, from the residuals. `separation`: condition number of the drift and constant-tilt columns.
    `declared`: what the rotation does not show, in words. `residual_arcsec`: complex (k,), what is left of
    the blocks' increments.
    """

    lines: tuple[float, ...]
    amplitudes_arcsec: Complex
    sd_arcsec: Array
    body_rate_dph: tuple[Estimate, ...]
    drift_dph: tuple[Estimate, ...]
    play_arcsec: Estimate | None
    noise_arcsec_per_sqrt_s: float
    separation: float
    declared: tuple[str, ...]
    blocks: tuple[Blocks, ...]
    residual_arcsec: Complex
    travel_deg: float = TRAVEL_DEG

    def amplitude(self, line: float) -> Estimate:
        """Return a line's estimate; KeyError for one that was not fitted."""
        if line not in self.lines:
            raise KeyError(line)
        at = self.lines.index(line)
        return Estimate(complex(self.amplitudes_arcsec[at]), float(self.sd_arcsec[at]))

    @property
    def statistic(self) -> Array:
        """|a|^2 / (2 sd^2) of every line, (l,): distributed as Exp(1) where there is no line."""
        return np.asarray(np.abs(self.amplitudes_arcsec) ** 2 / (2.0 * self.sd_arcsec**2))


def fit_direct(
    records: Sequence[TurnRecord],
    lines: Sequence[float] = DEFAULT_LINES,
    *,
    play: bool | None = None,
    travel_deg: float = TRAVEL_DEG,
) -> DirectFit:
    """Fit lines common to all records and a body rate for each; line 0 is the gauge's.

    A drift of each record is fitted where rotation separates it from the constant tilt, else declared. `play`
    None: where a record reverses; `travel_deg`: the table angle over which it is taken up. NotObservable if
    the columns are dependent (too little rotation for the lines).
    """
    blocks = [make_blocks(record, travel_deg) for record in records]
    separation = drift_separation(blocks)
    with_drift = separation < SEPARABLE
    slack_moves = [float(np.ptp(np.append(part.first_slack, part.last_slack))) > 0.5 for part in blocks]
    with_play = any(slack_moves) if play is None else play
    design = _design(blocks, lines, with_drift, with_play)
    observed = np.concatenate([part.increment_arcsec for part in blocks])
    values, sd, residual, sigma = _solve(design, observed)
    declared = (INSTALLATION_IN_TILT,) if with_drift else (DRIFT_IN_TILT,)
    count, first = len(lines), len(lines) + int(with_play)
    estimates = [Estimate(complex(value), float(error)) for value, error in zip(values, sd, strict=True)]
    return DirectFit(
        lines=tuple(float(line) for line in lines),
        amplitudes_arcsec=values[:count],
        sd_arcsec=sd[:count],
        body_rate_dph=tuple(estimates[first : first + len(blocks)]),
        drift_dph=tuple(estimates[first + len(blocks) :]),
        play_arcsec=estimates[count] if with_play else None,
        noise_arcsec_per_sqrt_s=sigma / np.sqrt(blocks[0].duration_s),
        separation=separation,
        declared=declared if 1 in lines or not with_drift else (),
        blocks=tuple(blocks),
        residual_arcsec=residual,
        travel_deg=travel_deg,
    )


def fit_travel(
    records: Sequence[TurnRecord], lines: Sequence[float], *, travels_deg: Sequence[float] = TRAVELS_DEG
) -> DirectFit:
    """Return the direct fit with the travel of the play that leaves least, refined between its neighbours.

    Without play beyond its noise, or without reversals, the travel is the usual one.
    """
    usual = fit_direct(records, lines)
    if usual.play_arcsec is None:
        return usual

    def left(log_travel: float) -> float:
        residual = fit_direct(records, lines, travel_deg=float(np.exp(log_travel))).residual_arcsec
        return float((np.abs(residual) ** 2).sum())

    logs = np.log(travels_deg)
    costs = [left(float(at)) for at in logs]
    best = int(np.argmin(costs))
    low, high = logs[max(0, best - 1)], logs[min(len(logs) - 1, best + 1)]
    found = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 0.01})
    fit = fit_direct(records, lines, travel_deg=float(np.exp(found.x)))
    least = float((np.abs(usual.residual_arcsec) ** 2).sum())
    variance = float(found.fun) / (2.0 * len(usual.residual_arcsec))
    return fit if least - float(found.fun) > 2.0 * _TRAVEL_SEEN * variance else usual


def drift_separation(blocks: Sequence[Blocks]) -> float:
    """Return the condition number of the columns of drift and constant tilt at length 1; inf if alike.

    Every record has a drift of its own, so that two runs in opposite senses do not separate it, a reversal does.
    """
    seen, whole = 0.0, 0.0
    for part in blocks:
        tilt = part.column(1.0)
        drift_size = float(np.linalg.norm(part.turning_s))
        seen += float(abs(np.vdot(part.turning_s, tilt)) / drift_size) ** 2 if drift_size else 0.0
        whole += float(np.vdot(tilt, tilt).real)
    likeness = float(np.sqrt(min(seen / whole, 1.0))) if whole else 1.0
    return float(np.sqrt((1.0 + likeness) / (1.0 - likeness))) if likeness < 1.0 else float("inf")


def _design(blocks: Sequence[Blocks], lines: Sequence[float], drift: bool, play: bool) -> Complex:
    """Return the columns: lines, play, a body rate for each record, a drift for each record."""
    columns = [np.concatenate([part.column(line) for part in blocks]) for line in lines]
    if play:
        columns.append(np.concatenate([part.last_slack - part.first_slack for part in blocks]) + 0j)
    columns += [*block_diag(*(np.full((len(part.turning_s), 1), part.duration_s) for part in blocks)).T]
    if drift:
        columns += [*block_diag(*(part.turning_s[:, None] for part in blocks)).T]
    return np.stack(columns, axis=1)


def _solve(design: Complex, observed: Complex) -> tuple[Complex, Array, Complex, float]:
    """Return estimates, their sd an axis, residuals, and the residuals' sd an axis."""
    count, unknowns = design.shape
    scale = np.linalg.norm(design, axis=0)
    if count <= unknowns or not scale.all():
        raise _too_little(f"{count} blocks for {unknowns} unknowns")
    orthogonal, triangle = np.linalg.qr(design / scale)
    singular = np.linalg.svd(triangle, compute_uv=False)
    if singular[-1] * _SINGULAR < singular[0]:
        raise _too_little(f"columns with a condition number of {singular[0] / singular[-1]:.1e}")
    inverse = np.linalg.inv(triangle)
    values = inverse @ (orthogonal.conj().T @ observed) / scale
    residual = observed - design @ values
    sigma = float(np.sqrt((np.abs(residual) ** 2).sum() / (2.0 * (count - unknowns))))
    sd = sigma * np.linalg.norm(inverse, axis=1) / scale
    return values, sd, residual, sigma


def _too_little(found: str) -> NotObservable:
    return NotObservable(
        "the rotation does not show what was asked for",
        where="whirl fit",
        found=found,
        expected="several full turns, so that lines differ from each other and from a constant rate",
        remedy="record more turns, or fit fewer lines",
    )
