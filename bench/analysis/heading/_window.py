"""Misalignment and drift over a window of position errors.

Parameters [phi at the window's centre, eps x sidereal day], six in arcsec; rows [h, h (t - centre) / sidereal
day]. With 36 h and the seven periodic regressors, a drift that swings with the sidereal angle does not leak
into eps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.analysis.heading._frames import position_rows
from bench.analysis.heading._log import PlatformLog
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import ConfigurationError

DEFAULT_WINDOW_S = 1.5 * SIDEREAL_DAY_S
LEAST_COVERAGE = 0.75
MOST_CONDITION = 3.0


@dataclass(frozen=True, eq=False)
class WindowEstimate:
    """Misalignment, arcsec, at the window's end `time_s` and mean drift, deg/h, over it, shape (3,).

    `published`: at least 0.75 of the window holds samples and the condition of the design is within three times a
    full window's.
    """

    time_s: float
    phi_as: Array
    eps_dph: Array
    published: bool


def design(time_s: Array, angle_rad: Array, latitude_deg: float, centre_s: float, periodic: bool) -> Array:
    """Return the rows of a window, shape (n, 2, 6), or (n, 2, 13) with the periodic regressors."""
    north, east = position_rows(angle_rad, latitude_deg)
    rows = np.stack([north, east], axis=1)
    age = ((np.asarray(time_s) - centre_s) / SIDEREAL_DAY_S)[:, None, None]
    blocks = [rows, rows * age]
    if periodic:
        extra = np.zeros((len(rows), 2, 7))
        extra[:, 0, 0] = 1.0
        for channel, first in ((0, 1), (1, 3)):
            extra[:, channel, first] = np.cos(2.0 * angle_rad)
            extra[:, channel, first + 1] = np.sin(2.0 * angle_rad)
        extra[:, 1, 5], extra[:, 1, 6] = np.cos(angle_rad), np.sin(angle_rad)
        blocks.append(extra)
    return np.concatenate(blocks, axis=2)


def extract(
    log: PlatformLog,
    *,
    window_s: float = DEFAULT_WINDOW_S,
    sample_s: float | None = None,
    periodic: bool = False,
) -> WindowEstimate | None:
    """Return the estimate over the last `window_s` of `log`, by one least-squares fit; None without rank."""
    check_window(window_s, periodic)
    shown_s = log.time_s - log.delay_s
    inside = (shown_s > shown_s[-1] - window_s) & np.isfinite(log.north_as) & np.isfinite(log.east_as)
    if np.count_nonzero(inside) < (13 if periodic else 6):
        return None
    shown_s = shown_s[inside]
    angle = log.sidereal_rad[inside] - log.delay_s * (2.0 * np.pi / SIDEREAL_DAY_S)
    centre_s = 0.5 * (shown_s[0] + shown_s[-1])
    rows = design(shown_s, angle, log.latitude_deg, centre_s, periodic)
    rows = rows.reshape(-1, rows.shape[2])
    values = np.stack([log.north_as[inside], log.east_as[inside]], axis=1).ravel()
    normal, right = rows.T @ rows, rows.T @ values
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0).all():
        return None
    condition = float(np.sqrt(np.linalg.cond(normal)))
    if not condition < 1e7:
        return None
    scaled = normal / np.outer(scale, scale)
    solution = np.linalg.solve(scaled, right / scale) / scale
    end_s = float(log.time_s[-1] - log.delay_s)
    to_end = np.zeros((6, len(scale)))
    to_end[:3, :3] = np.eye(3)
    to_end[:3, 3:6] = np.eye(3) * (end_s - centre_s) / SIDEREAL_DAY_S
    to_end[3:, 3:6] = np.eye(3) / SIDEREAL_DAY_S
    final = to_end @ solution
    step_s = float(np.median(np.diff(log.time_s))) if sample_s is None else sample_s
    most = MOST_CONDITION * full_condition(log.latitude_deg, window_s, periodic)
    return WindowEstimate(
        time_s=end_s + log.delay_s,
        phi_as=final[:3] + final[3:] * log.delay_s,
        eps_dph=final[3:],
        published=len(shown_s) * step_s / window_s >= LEAST_COVERAGE and condition <= most,
    )


@lru_cache(maxsize=64)
def full_condition(latitude_deg: float, window_s: float, periodic: bool) -> float:
    """Return the largest condition of a window without gaps, over where in the sidereal day it begins."""
    time_s = np.linspace(0.0, window_s, 241)
    worst = 0.0
    for start in np.arange(4) * 0.25 * np.pi:
        angle = start + time_s * (2.0 * np.pi / SIDEREAL_DAY_S)
        rows = design(time_s, angle, latitude_deg, 0.5 * window_s, periodic)
        worst = max(worst, float(np.linalg.cond(rows.reshape(-1, rows.shape[2]))))
    return worst


def check_window(window_s: float, periodic: bool) -> None:
    """Raise ConfigurationError for a window in which misalignment and drift cannot be told apart."""
    least_s = DEFAULT_WINDOW_S if periodic else SIDEREAL_DAY_S
    # Printed values are rounded: 23.93447 h is the sidereal day.
    if window_s < least_s * (1.0 - 1e-6):
        raise ConfigurationError(
            "the extraction window is too short",
            found=f"{window_s / 3600.0:.2f} h",
            expected=f"at least {least_s / 3600.0:.2f} h, "
            + ("1.5 sidereal days with periodic regressors" if periodic else "a sidereal day"),
            remedy="take a longer window: half a day makes the drift four times as uncertain, and a drift "
            "that swings with the day is then taken for a constant one",
        )
