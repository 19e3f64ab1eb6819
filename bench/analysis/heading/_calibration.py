"""The linear system behind the lagged model: position errors of a calibration run against all their causes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.heading._frames import position_rows
from bench.analysis.heading._log import PlatformLog, Stay, stays
from bench.analysis.heading._nine import integrate
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import RecordError

_DAY_S = 86400.0
_MOST_ROWS = 4_000_000


@dataclass(frozen=True)
class Priors:
    """1 sigma of what a calibration may find: arcsec for angles, deg/h for drifts.

    `noise_as` is that of a block mean whose noise is correlated over 1.5 h (2 arcsec x sqrt(2 x 1.5 h / 30
    min)). `reference_periodic` turns on the periodic drift at the reference heading; without it the gains are
    biased.
    """

    block_s: float = 1800.0
    noise_as: float = 2.0 * 6.0**0.5
    gain_dph_per_k: float = 0.1
    start_as: float = 60.0
    start_drift_dph: float = 5e-4
    offset_as: float = 4.0
    wander_dph: float = 1.5e-5
    knot_s: float = _DAY_S
    periodic_dph: float = 2e-3
    step_drift_dph: float = 2e-3
    reference_periodic: bool = True


class Calibration:
    """A run on a uniform grid, as normal equations.

    `grid` is the log resampled; columns of drift regressors are their running integrals, seen through the
    position rows at the time the platform shows them (`delay_s`), in means of `priors.block_s`. `values`
    (rows,) are the means times `scale` (rows,), by which the noise has a standard deviation of 1.
    """

    def __init__(self, log: PlatformLog, priors: Priors) -> None:
        self.grid = uniform(log)
        self.priors = priors
        self.stays = stays(self.grid)
        grid = self.grid
        self._step_s = float(grid.time_s[1] - grid.time_s[0])
        self._shown_s = grid.time_s - grid.delay_s
        angle = grid.sidereal_rad - grid.delay_s * EARTH_RATE_RAD_S
        north, east = position_rows(angle, grid.latitude_deg)
        good = np.isfinite(grid.north_as) & np.isfinite(grid.east_as) & (self._shown_s >= grid.time_s[0])
        self._block = max(1, round(priors.block_s / self._step_s))
        self._weight = good.astype(np.float64)
        self._count = self._sum(self._weight)
        self._channels = (north, east)
        values = [
            self._mean(np.where(good, channel, 0.0)[:, None])[:, 0]
            for channel in (grid.north_as, grid.east_as)
        ]
        # A block with gaps is a mean of fewer samples of correlated noise: it counts by its share.
        share = np.sqrt(np.clip(self._count / self._block, 0.0, 1.0)) / priors.noise_as
        self.scale = np.concatenate([share, share])
        self.values = np.concatenate(values) * self.scale

    def angles(self, drivers: Array) -> Array:
        """Return scaled columns, (rows, 3 k), of misalignments that run as `drivers` (n, k) on each axis.

        Columns in the order axis x driver 0, axis x driver 1, ..., axis z driver k - 1.
        """
        if self.grid.delay_s:
            drivers = np.stack(
                [np.interp(self._shown_s, self.grid.time_s, column) for column in drivers.T], axis=1
            )
        rows = []
        for channel in self._channels:
            product = channel[:, :, None] * drivers[:, None, :]
            rows.append(self._mean(product.reshape(len(product), -1)))
        return np.asarray(np.concatenate(rows) * self.scale[:, None])

    def drifts(self, drivers: Array) -> Array:
        """Return scaled columns, (rows, 3 k), of drifts that run as `drivers` (n, k) on each axis."""
        return self.angles(integrate(self.grid.time_s, drivers))

    def background(self) -> tuple[Array, Array]:
        """Return (columns, prior sigmas) of everything but the temperature's effect.

        Start misalignment and drift, a misalignment offset for each heading, slowly wandering drift (hat
        functions), and the periodic drift of the reference heading at one and two turns a sidereal day.
        """
        priors, time_s = self.priors, self.grid.time_s
        one = np.ones((len(time_s), 1))
        blocks = [(self.angles(one), priors.start_as), (self.drifts(one), priors.start_drift_dph)]
        offsets = self.headings()
        if offsets.shape[1]:
            blocks.append((self.angles(offsets), priors.offset_as))
        knots = np.arange(time_s[0], time_s[-1] + priors.knot_s, priors.knot_s)
        hats = np.clip(1.0 - np.abs(time_s[:, None] - knots) / priors.knot_s, 0.0, None)
        blocks.append((self.drifts(hats), priors.wander_dph))
        if priors.reference_periodic:
            blocks.append((self.drifts(swings(self.grid.sidereal_rad)), priors.periodic_dph))
        columns = np.concatenate([block for block, _ in blocks], axis=1)
        sigma = np.concatenate([np.full(block.shape[1], prior) for block, prior in blocks])
        return columns, sigma

    def headings(self) -> Array:
        """Return indicators, (n, k), of each heading other than the first; a heading that comes again is
        one."""
        first, *others = self.stays
        named: dict[int, list[Stay]] = {}
        for stay in others:
            if _key(stay) != _key(first):
                named.setdefault(_key(stay), []).append(stay)
        indicators = np.zeros((len(self.grid.time_s), len(named)))
        for column, group in enumerate(named.values()):
            for stay in group:
                indicators[stay.start : stay.stop, column] = 1.0
        return indicators

    def rows_of(self, stay: Stay) -> NDArray[np.bool_]:
        """Return which rows have samples of a stay, (rows,)."""
        inside = np.zeros(len(self.grid.time_s))
        inside[stay.start : stay.stop] = 1.0
        touched = self._sum(inside) > 0.0
        return np.concatenate([touched, touched])

    def _mean(self, columns: Array) -> Array:
        weighted = self._sum(columns * self._weight[:, None])
        return np.asarray(weighted / np.maximum(self._count, 1.0)[:, None])

    def _sum(self, columns: Array) -> Array:
        starts = np.arange(0, len(columns), self._block)
        return np.asarray(np.add.reduceat(columns, starts, axis=0))


def swings(angle_rad: Array) -> Array:
    """Return cos, cos 2, sin, sin 2 of angles (n,), as columns (n, 4)."""
    angle = np.asarray(angle_rad)[:, None] * np.array([1.0, 2.0])
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def uniform(log: PlatformLog) -> PlatformLog:
    """Return the log on a uniform grid of its median step: temperature interpolated, position never made up.

    A log that is uniform already comes back as it is, save for missing temperatures. Raises RecordError where
    the grid would be absurdly long.
    """
    step_s = float(np.median(np.diff(log.time_s)))
    count = round((log.time_s[-1] - log.time_s[0]) / step_s) + 1
    if count > _MOST_ROWS:
        raise RecordError(
            "the log's time column cannot be right",
            found=f"{count} steps of {step_s:g} s between the first and the last row",
            expected=f"at most {_MOST_ROWS}",
            remedy="check the time column and its unit, or average the log to one row a minute",
        )
    time_s = log.time_s[0] + step_s * np.arange(count)
    nearest = np.clip(np.searchsorted(log.time_s, time_s - 0.5 * step_s), 0, len(log.time_s) - 1)
    present = np.abs(log.time_s[nearest] - time_s) <= 0.5 * step_s * (1.0 + 1e-9)
    return PlatformLog(
        time_s=time_s,
        sidereal_rad=np.interp(time_s, log.time_s, log.sidereal_rad),
        north_as=np.where(present, log.north_as[nearest], np.nan),
        east_as=np.where(present, log.east_as[nearest], np.nan),
        temp_c=_bridged(time_s, log.time_s, log.temp_c),
        heading_deg=log.heading_deg[nearest],
        latitude_deg=log.latitude_deg,
        delay_s=log.delay_s,
        second_c=None if log.second_c is None else _bridged(time_s, log.time_s, log.second_c),
    )


def _bridged(time_s: Array, measured_s: Array, temp_c: Array) -> Array:
    known = np.isfinite(temp_c)
    return np.interp(time_s, measured_s[known], temp_c[known])


def _key(stay: Stay) -> int:
    return round((stay.heading_deg % 360.0) / 4.0) % 90
