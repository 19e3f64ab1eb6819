"""The direct fit: body lines of the whirl from increments of the body tilt, by complex least squares.

    z_k = r dt + eps sum exp(j psi) dt + sum_m a_m (exp(j m psi_k+1) - exp(j m psi_k))
          + sum_i J_i (s_i,k+1 - s_i,k) + noise

z_k is the residual rate, turned into body axes and summed over a block. Its noise is white when the gyros'
is, so least squares is the best there is: the sd of a_m is N / (|m| w sqrt T). Everything is in the measured
angle, so that ripple, reversals and stops do no harm. r, a constant rate in body axes, is Earth rate and what
is wrong with it; eps is drift in gyro axes; J_i are jumps of tilt with the sense of rotation, each taken up over
a travel of its own. Play has one travel; several make up any loop that depends on the last reversal only, such as
friction that winds a shaft up (Prandtl and Ishlinskii's superposition of plays).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from bench.analysis.whirl._residual import LONGEST_DEG, TRAVEL_DEG, Blocks, make_blocks
from bench.analysis.whirl._types import Complex, NotObservable, TurnRecord
from drivers.base.arrays import Array

DEFAULT_LINES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
SEPARABLE = 10.0
"""Drift and constant tilt are told apart if their columns' condition number is below this (reversals: 1.07)."""
_SINGULAR = 1e6
TRAVELS_DEG = (0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 17.0, 22.0, LONGEST_DEG)
"""Travels of play that are tried; what is taken up within a block looks alike."""
_TRAVEL_SEEN = 8.0
"""Gain of logarithmic likelihood from which another travel is believed: 1 % over these travels needs 7.2."""
_MOST_TRAVELS = 6
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
    jump of tilt with reverse rotation in all, None without reversals; `plays_arcsec`, complex (p,), are its
    parts, taken up over `travels_deg` (p,). `noise_arcsec_per_sqrt_s`: angle random walk N an axis, from the
    residuals. `separation`: condition number of the drift and constant-tilt columns. `declared`: what the
    rotation does not show, in words. `residual_arcsec`: complex (k,), what is left of the blocks' increments.
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
    travels_deg: tuple[float, ...]
    plays_arcsec: Complex

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
    travels_deg: Sequence[float] = (TRAVEL_DEG,),
) -> DirectFit:
    """Fit lines common to all records and a body rate for each; line 0 is the gauge's.

    A drift of each record is fitted where rotation separates it from the constant tilt, else declared. `play`
    None: where a record reverses; `travels_deg`: the table angles over which it is taken up. NotObservable if
    the columns are dependent (too little rotation for the lines).
    """
    return _fit([make_blocks(record) for record in records], lines, play, tuple(travels_deg))


def _fit(
    blocks: Sequence[Blocks], lines: Sequence[float], play: bool | None, travels_deg: tuple[float, ...]
) -> DirectFit:
    separation = drift_separation(blocks)
    with_drift = separation < SEPARABLE
    if not (any(part.reverses for part in blocks) if play is None else play):
        travels_deg = ()
    columns = _columns(blocks, lines, with_drift, travels_deg)
    observed = np.concatenate([part.increment_arcsec for part in blocks])
    root = root_s(blocks)
    values, sd, residual, noise = solve(columns / root[:, None], np.asarray(observed / root))
    declared = (INSTALLATION_IN_TILT,) if with_drift else (DRIFT_IN_TILT,)
    count, first = len(lines), len(lines) + len(travels_deg)
    estimates = [Estimate(complex(value), float(error)) for value, error in zip(values, sd, strict=True)]
    plays = values[count:first].copy()
    plays[:1] -= plays[1:].sum()
    return DirectFit(
        lines=tuple(float(line) for line in lines),
        amplitudes_arcsec=values[:count],
        sd_arcsec=sd[:count],
        body_rate_dph=tuple(estimates[first : first + len(blocks)]),
        drift_dph=tuple(estimates[first + len(blocks) :]),
        play_arcsec=estimates[count] if travels_deg else None,
        noise_arcsec_per_sqrt_s=noise,
        separation=separation,
        declared=declared if 1 in lines or not with_drift else (),
        blocks=tuple(blocks),
        residual_arcsec=residual * root,
        travels_deg=travels_deg,
        plays_arcsec=plays,
    )


def fit_memory(
    records: Sequence[TurnRecord], lines: Sequence[float], *, travels_deg: Sequence[float] = TRAVELS_DEG
) -> DirectFit:
    """Return the direct fit with the travels of the play that the data ask for, one after the other.

    Each is the one that leaves least, refined between its neighbours. Without play beyond its noise, or without
    reversals, there is one, the usual one.
    """
    blocks = [make_blocks(record) for record in records]
    best = _fit(blocks, lines, None, (TRAVEL_DEG,))
    if best.play_arcsec is None:
        return best
    logs = np.log(travels_deg)
    taken: tuple[float, ...] = ()
    worthless = 10.0 * best.noise_arcsec_per_sqrt_s
    while len(taken) < _MOST_TRAVELS:

        def with_one(log_travel: float, taken: tuple[float, ...] = taken) -> DirectFit:
            return _fit(blocks, lines, None, (*taken, float(np.exp(log_travel))))

        def noise(log_travel: float, with_one: Callable[[float], DirectFit] = with_one) -> float:
            try:
                return with_one(log_travel).noise_arcsec_per_sqrt_s
            except NotObservable:  # within the blocks it is one with a travel that is taken: no gain
                return worthless

        tried = [noise(float(at)) for at in logs]
        at = int(np.argmin(tried))
        if tried[at] >= worthless:
            break
        bounds = (logs[max(0, at - 1)], logs[min(len(logs) - 1, at + 1)])
        found = minimize_scalar(noise, bounds=bounds, method="bounded", options={"xatol": 0.01})
        fit = with_one(float(found.x if found.fun < tried[at] else logs[at]))
        # N^2 is the sum of squares over its degrees of freedom.
        less = best.noise_arcsec_per_sqrt_s / fit.noise_arcsec_per_sqrt_s
        if 2.0 * len(fit.residual_arcsec) * np.log(less) < _TRAVEL_SEEN:
            break
        best, taken = fit, fit.travels_deg
    return best


def installation_known(declared: Sequence[str], installation_arcsec: tuple[float, float]) -> tuple[str, ...]:
    """Return what a fit declares when the angles of the x and y gyros towards z were taken out of its rates."""
    x, y = installation_arcsec
    told = (
        f"the x and y gyros lie {x:g} and {y:g} arcsec towards z, as told: their rates were corrected by that "
        "before the fit. Navigation has to correct them likewise"
    )
    return (*(text for text in declared if text != INSTALLATION_IN_TILT), told)


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


def root_s(blocks: Sequence[Blocks]) -> Array:
    """Return the root of the blocks' length, (k,): divided by it, all increments have the same noise."""
    return np.asarray(np.sqrt(np.concatenate([part.duration_s for part in blocks])))


def design_of(fit: DirectFit) -> tuple[Complex, Complex, Array]:
    """Return columns (k, u) and increments (k,) of a fit, of even noise, and the root they were divided by."""
    root = root_s(fit.blocks)
    columns = _columns(fit.blocks, fit.lines, bool(fit.drift_dph), fit.travels_deg)
    observed = np.concatenate([part.increment_arcsec for part in fit.blocks])
    return columns / root[:, None], np.asarray(observed / root), root


def _columns(
    blocks: Sequence[Blocks], lines: Sequence[float], drift: bool, travels_deg: Sequence[float]
) -> Complex:
    """Return the columns: lines, play, a body rate for each record, a drift for each record.

    The first column of play is that of the whole jump, the others move parts of it to their own travels.
    """
    columns = [np.concatenate([part.column(line) for part in blocks]) for line in lines]
    plays = [np.concatenate([part.play(travel) for part in blocks]) + 0j for travel in travels_deg]
    columns += [*plays[:1], *(play - plays[0] for play in plays[1:])]
    columns += [*block_diag(*(part.duration_s[:, None] for part in blocks)).T]
    if drift:
        columns += [*block_diag(*(part.turning_s[:, None] for part in blocks)).T]
    return np.stack(columns, axis=1)


def solve(design: Complex, observed: Complex) -> tuple[Complex, Array, Complex, float]:
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
