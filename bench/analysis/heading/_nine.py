"""The paper's model: the mean drift of a steady heading as nine coefficients of the temperature's Fourier
terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.heading._frames import wrap_deg
from bench.analysis.heading._log import PlatformLog, Stay, stays
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference, fourier_terms
from bench.analysis.heading._window import DEFAULT_WINDOW_S, WindowEstimate, extract
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import RecordError

_SAME_HEADING_DEG = 2.0
_WORST_CONDITION = 1e3


@dataclass(frozen=True, eq=False)
class HeadingPoint:
    """The end of one steady stay: drift (3,) in deg/h, (b0, ac, as) in K."""

    heading_deg: float
    drift_dph: Array
    terms_k: Array


@dataclass(frozen=True, eq=False)
class NineCoefficients:
    """eps_i = k_i0 b0 + k_ic ac + k_is as: `gain_dph_per_k`, (3, 3), rows x y z, columns b0 ac as.

    `sigma` and `p_value` of the same shape are None with exactly three headings, where nothing is left over to
    judge by; `condition` is that of the headings' temperatures.
    """

    gain_dph_per_k: Array
    sigma_dph_per_k: Array | None
    p_value: Array | None
    condition: float
    headings: int
    reference: ReferenceTemperature


def fit_nine(log: PlatformLog, *, window_s: float = DEFAULT_WINDOW_S) -> NineCoefficients:
    """Fit the nine coefficients to a log that begins at the reference heading.

    The end of every stay longer than window and a sidereal day gives three equations, except at the reference
    heading, whose temperature change is zero. Three other headings give nine equations, more a least-squares
    fit. Raises RecordError with fewer than three steady headings beside the reference, or temperatures that
    do not differ between them.
    """
    every = stays(log)
    if not every:
        raise too_few_headings(0, window_s)
    first = every[0]
    reference = fit_reference(log.sidereal_rad[: first.stop], log.temp_c[: first.stop])
    base = _estimate(log, first, window_s)
    terms = fourier_terms(log.sidereal_rad, log.temp_c - reference.at(log.sidereal_rad))
    points = []
    for stay in every[1:]:
        away = abs(float(wrap_deg(stay.heading_deg - first.heading_deg))) > _SAME_HEADING_DEG
        if not away or stay.duration_s < max(window_s, SIDEREAL_DAY_S) * 0.98:
            continue
        found = _estimate(log, stay, window_s)
        at_end = terms[stay.stop - 1]
        if found is None or not np.isfinite(at_end).all():
            continue
        points.append(HeadingPoint(stay.heading_deg, found.eps_dph, at_end))
    if base is None or len({round(point.heading_deg / _SAME_HEADING_DEG) for point in points}) < 3:
        raise too_few_headings(len(points), window_s)
    return solve_nine(points, base.eps_dph, reference)


def solve_nine(
    points: list[HeadingPoint], reference_drift_dph: Array, reference: ReferenceTemperature
) -> NineCoefficients:
    """Solve for the coefficients from steady headings other than the reference, whose drift is taken off.

    Raises RecordError when the terms (b0, ac, as) of the headings do not span three dimensions.
    """
    terms = np.array([point.terms_k for point in points]).reshape(-1, 3)
    drift = np.array([point.drift_dph for point in points]).reshape(-1, 3) - reference_drift_dph
    condition = float(np.linalg.cond(terms)) if len(points) >= 3 else float("inf")
    if not condition < _WORST_CONDITION:
        raise RecordError(
            "the headings' temperatures do not determine nine coefficients",
            found=f"{len(points)} headings beside the reference, condition {condition:.3g}, largest change "
            f"{np.abs(terms).max(initial=0.0):.4f} K",
            expected=f"three with independent temperature changes, condition below {_WORST_CONDITION:g} "
            "(the reference heading itself has none and gives no equation)",
            remedy="choose headings farther apart, 90, 180 and 270 deg from the reference",
        )
    gain = np.linalg.lstsq(terms, drift, rcond=None)[0].T
    left = drift - terms @ gain.T
    freedom = len(points) - 3
    sigma = p_value = None
    if freedom > 0:
        from scipy import stats  # slow to import

        variance = np.sum(left**2, axis=0) / freedom
        sigma = np.sqrt(np.outer(variance, np.diag(np.linalg.inv(terms.T @ terms))))
        p_value = 2.0 * stats.t.sf(np.abs(gain) / np.maximum(sigma, 1e-300), freedom)
    return NineCoefficients(
        gain_dph_per_k=gain,
        sigma_dph_per_k=sigma,
        p_value=p_value,
        condition=condition,
        headings=len(points),
        reference=reference,
    )


def compensate_nine(model: NineCoefficients, log: PlatformLog) -> Array:
    """Return the misalignment that the model's drift makes, arcsec, (n, 3), causally over uniform samples.

    The Fourier terms come from the last sidereal day; before the first full day the drift is taken as zero.
    """
    change = log.temp_c - model.reference.at(log.sidereal_rad)
    drift = np.nan_to_num(fourier_terms(log.sidereal_rad, change)) @ model.gain_dph_per_k.T
    return integrate(log.time_s, drift)


def integrate(time_s: Array, rate: Array) -> Array:
    """Return the running integral (trapezoids) over time of columns (n, k), zero at the first sample."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s)[:, None]
    return np.asarray(np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(steps, axis=0)]))


def too_few_headings(found: int, stay_s: float) -> RecordError:
    """Return the refusal of a log with fewer than three steady headings beside the reference."""
    return RecordError(
        "too few steady headings for nine coefficients",
        found=f"{found} beside the reference heading",
        expected=f"at least three, each held for {stay_s / 3600.0:.0f} h or more",
        remedy="the reference heading gives no equation: turn to more headings, or stay longer at each",
    )


def _estimate(log: PlatformLog, stay: Stay, window_s: float) -> WindowEstimate | None:
    found = extract(log.part(stay.start, stay.stop), window_s=window_s)
    return found if found is not None and found.published else None
