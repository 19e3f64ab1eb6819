"""Misalignment and drift over a moving window of position errors, at constant cost a sample.

Parameters [phi at the window's centre, eps x sidereal day], six in arcsec; rows [h, h (t - centre) / sidereal
day]. With 36 h and the seven periodic regressors, a drift that swings with the sidereal angle does not leak
into eps.
"""

from __future__ import annotations

from collections import deque
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
_PERIODIC_WINDOW_S = 1.5 * SIDEREAL_DAY_S


@dataclass(frozen=True, eq=False)
class WindowEstimate:
    """Misalignment, arcsec, at the window's end `time_s` and mean drift, deg/h, over it, shape (3,).

    `covariance`, (6, 6), is of (phi, eps) per unit variance of the position error, in arcsec and deg/h;
    `residual_as` the rms residual of a channel. `condition` is that of the design, `coverage` the share of
    the window that holds samples. `published` says whether coverage and condition allow use (coverage at
    least 0.75, condition within three times a full window's).
    """

    time_s: float
    phi_as: Array
    eps_dph: Array
    covariance: Array
    residual_as: float
    condition: float
    coverage: float
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


class MovingWindow:
    """(phi, eps) over the last `window_s`, sliding: each sample is added once and taken away once.

    Sums are counted from an anchor and made anew once a window, which keeps rounding below 1e-9 of eps.
    Samples without a position leave the window as they are.
    """

    def __init__(
        self,
        latitude_deg: float,
        *,
        window_s: float = DEFAULT_WINDOW_S,
        sample_s: float = 60.0,
        periodic: bool = False,
        delay_s: float = 0.0,
    ) -> None:
        """Raises ConfigurationError for a window shorter than a sidereal day, or than 36 h with
        `periodic`."""
        check_window(window_s, periodic)
        self.window_s, self.sample_s, self.periodic = window_s, sample_s, periodic
        self._latitude_deg, self._delay_s = latitude_deg, delay_s
        self._rows: deque[tuple[float, Array, Array]] = deque()
        self._size = 13 if periodic else 6
        self._anchor_s = self._end_s = float("nan")
        self._clear()

    def feed(self, time_s: Array, sidereal_rad: Array, north_as: Array, east_as: Array) -> None:
        """Take samples, arrays of shape (n,), later than all before."""
        shown_s = np.asarray(time_s, dtype=np.float64) - self._delay_s
        if not len(shown_s):
            return
        if self._anchor_s != self._anchor_s:
            self._anchor_s = float(shown_s[0])
        angle = sidereal_rad - self._delay_s * (2.0 * np.pi / SIDEREAL_DAY_S)
        rows = design(shown_s, angle, self._latitude_deg, 0.0, self.periodic)
        values = np.stack([north_as, east_as], axis=1)
        good = np.asarray(np.isfinite(values).all(axis=1))
        base = rows[:, :, :3].copy()
        for at in range(len(shown_s)):
            moment = float(shown_s[at])
            self._end_s = moment
            if good[at]:
                row = rows[at]
                row[:, 3:6] = base[at] * ((moment - self._anchor_s) / SIDEREAL_DAY_S)
                self._rows.append((moment, row, values[at]))
                self._add(row, values[at], 1.0)
            self._drop()

    def estimate(self) -> WindowEstimate | None:
        """Return the estimate at the last sample; None while too few samples or no full rank."""
        if len(self._rows) < self._size:
            return None
        centre_s = 0.5 * (self._rows[0][0] + self._rows[-1][0])
        # x_anchor = S x_centre: the misalignment at the anchor is that at the centre less the drift between.
        shift = np.eye(self._size)
        shift[:3, 3:6] = -np.eye(3) * (centre_s - self._anchor_s) / SIDEREAL_DAY_S
        normal = shift.T @ self._normal @ shift
        right = shift.T @ self._right
        return _solve(
            normal,
            right,
            self._square,
            len(self._rows),
            end_s=self._end_s,
            centre_s=centre_s,
            delay_s=self._delay_s,
            coverage=len(self._rows) * self.sample_s / self.window_s,
            full_condition=full_condition(self._latitude_deg, self.window_s, self.periodic),
        )

    def state(self) -> dict[str, object]:
        """Return what `restore` needs to go on as if nothing had happened."""
        return {
            "anchor_s": self._anchor_s,
            "end_s": self._end_s,
            "time_s": np.array([moment for moment, _, _ in self._rows]),
            "rows": np.array([row for _, row, _ in self._rows]).reshape(-1, 2, self._size),
            "values": np.array([value for _, _, value in self._rows]).reshape(-1, 2),
            "normal": self._normal.copy(),
            "right": self._right.copy(),
            "square": self._square,
            "since": self._since,
        }

    def restore(self, state: dict[str, object]) -> None:
        """Go on from a saved state."""
        times, rows, values = (np.asarray(state[name]) for name in ("time_s", "rows", "values"))
        self._rows = deque(zip(times.tolist(), rows, values, strict=True))
        self._anchor_s, self._end_s, self._square, self._since = (
            float(np.asarray(state[name])) for name in ("anchor_s", "end_s", "square", "since")
        )
        self._normal, self._right = np.array(state["normal"]), np.array(state["right"])

    def _add(self, row: Array, value: Array, sign: float) -> None:
        self._normal += sign * (row.T @ row)
        self._right += sign * (value @ row)
        self._square += sign * float(value @ value)

    def _drop(self) -> None:
        oldest = self._end_s - self.window_s
        while self._rows and self._rows[0][0] <= oldest:
            _, row, value = self._rows.popleft()
            self._add(row, value, -1.0)
        if self._end_s - self._since >= self.window_s and self._rows:
            self._sum_again()

    def _sum_again(self) -> None:
        again = self._rows
        self._anchor_s = 0.5 * (again[0][0] + again[-1][0])
        self._rows = deque()
        self._clear()
        for moment, row, value in again:
            row[:, 3:6] = row[:, :3] * ((moment - self._anchor_s) / SIDEREAL_DAY_S)
            self._rows.append((moment, row, value))
            self._add(row, value, 1.0)
        self._since = self._end_s

    def _clear(self) -> None:
        self._normal = np.zeros((self._size, self._size))
        self._right = np.zeros(self._size)
        self._square = 0.0
        self._since = self._anchor_s if self._anchor_s == self._anchor_s else float("-inf")


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
    step_s = float(np.median(np.diff(log.time_s))) if sample_s is None else sample_s
    return _solve(
        rows.T @ rows,
        rows.T @ values,
        float(values @ values),
        len(shown_s),
        end_s=float(log.time_s[-1] - log.delay_s),
        centre_s=centre_s,
        delay_s=log.delay_s,
        coverage=len(shown_s) * step_s / window_s,
        full_condition=full_condition(log.latitude_deg, window_s, periodic),
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
    least_s = _PERIODIC_WINDOW_S if periodic else SIDEREAL_DAY_S
    if window_s < least_s * (1.0 - 1e-9):
        raise ConfigurationError(
            "the extraction window is too short",
            found=f"{window_s / 3600.0:.2f} h",
            expected=f"at least {least_s / 3600.0:.2f} h, "
            + ("1.5 sidereal days with periodic regressors" if periodic else "a sidereal day"),
            remedy="take a longer window: half a day makes the drift four times as uncertain, and a "
            "drift that "
            "swings with the day is then taken for a constant one",
        )


def _solve(
    normal: Array,
    right: Array,
    square: float,
    samples: int,
    *,
    end_s: float,
    centre_s: float,
    delay_s: float,
    coverage: float,
    full_condition: float,
) -> WindowEstimate | None:
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0).all():
        return None
    scaled = normal / np.outer(scale, scale)
    condition = float(np.sqrt(np.linalg.cond(normal)))
    if not condition < 1e7:
        return None
    solution = np.linalg.solve(scaled, right / scale) / scale
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    to_end = np.zeros((6, len(scale)))
    to_end[:3, :3] = np.eye(3)
    to_end[:3, 3:6] = np.eye(3) * (end_s - centre_s) / SIDEREAL_DAY_S
    to_end[3:, 3:6] = np.eye(3) / SIDEREAL_DAY_S
    final = to_end @ solution
    freedom = max(1, 2 * samples - len(scale))
    return WindowEstimate(
        time_s=end_s + delay_s,
        phi_as=final[:3] + final[3:] * delay_s,
        eps_dph=final[3:],
        covariance=to_end @ inverse @ to_end.T,
        residual_as=float(np.sqrt(max(0.0, square - float(right @ solution)) / freedom)),
        condition=condition,
        coverage=coverage,
        published=coverage >= LEAST_COVERAGE and condition <= MOST_CONDITION * full_condition,
    )
