"""What acted on the gyro during a run: temperatures, table angle, attitude, place; and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph

REFERENCE_C = 25.0
SMOOTHING_S = 60.0
STEADY_DPS = 0.02
"""Changes of a table's rate below which it is steady: those of its servo."""
_BENT_DEG = 1e-4
"""Angle by which the rates at a sample's edges are off its mean, together, from which its rate is not even."""
_WAVES_DEG = 720.0
"""Of two waves in a sample, over which eight points integrate to 4e-6."""
_PARTS = 32
"""Parts of a sample in which the rate turns."""


@dataclass(frozen=True)
class Stimulus:
    """Inputs at equal steps of `period_s`; sample k covers the step that ends at `time_s[k]` since power-on.

    `time_s`, `t_in_c`, `t_out_c`, `elevation_deg` float64 (n,); `angle_deg` (n + 1,) the table's angle at the
    samples' edges, turns counted, counter-clockwise about up, zero where a horizontal axis points north.
    `elevation_deg` is the sensitive axis above the horizon: 90 up, 0 horizontal. `edge_rate_dps` (n + 1,) is the
    table's rate at the samples' edges where telemetry is finer than the samples. `force_g` (3, n): specific force
    in units of standard gravity as the unit's accelerometers measure it, along the sensitive axis and then along
    the two after it in the order x, y, z, x; `cross_rate_dph` (2, n): rates about these two as its gyros measure
    them. Both None where nothing measured them. `over_offset_dph` (n,): what each ms of an offset between the
    clocks of gyro and table does to the rate, over the offset that a bench has, where it is known.
    """

    time_s: Array
    t_in_c: Array
    t_out_c: Array
    angle_deg: Array
    elevation_deg: Array
    latitude_deg: float
    period_s: float = 1.0
    edge_rate_dps: Array | None = None
    force_g: Array | None = None
    cross_rate_dph: Array | None = None
    over_offset_dph: Array | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def table_rate_dps(self) -> Array:
        """Mean table rate over each sample, (n,)."""
        return np.asarray(np.diff(self.angle_deg) / self.period_s)

    @cached_property
    def axis_rate_dps(self) -> Array:
        """Table rate along the sensitive axis, (n,)."""
        return np.asarray(self.table_rate_dps * np.sin(np.radians(self.elevation_deg)))

    @cached_property
    def input_rate_dph(self) -> Array:
        """True rate along the sensitive axis with the Earth's, mean over each sample, deg/h, (n,)."""
        elevation = np.radians(self.elevation_deg)
        vertical = earth_rate_up_dph(self.latitude_deg) * np.sin(elevation)
        level = earth_rate_north_dph(self.latitude_deg) * np.cos(elevation) * self.harmonic(1)[0]
        return np.asarray(3600.0 * self.axis_rate_dps + vertical + level)

    @cached_property
    def mean_speed_dph(self) -> Array:
        """Mean magnitude of the input rate over each sample, deg/h, (n,): more than its mean's where it turns.

        There the rate is a parabola through its values at the edges (Colella and Woodward 1984, eq. 1.4); where
        these are not known nothing says how it turns.
        """
        rate = self.input_rate_dph
        speed = np.abs(rate)
        if self.edge_rate_dps is None:
            return speed
        along = 3600.0 * np.sin(np.radians(self.elevation_deg))
        earth = rate - 3600.0 * self.axis_rate_dps
        first, last = (along * edge + earth for edge in (self.edge_rate_dps[:-1], self.edge_rate_dps[1:]))
        bulge = 6.0 * (rate - 0.5 * (first + last))
        steep = np.where(bulge == 0.0, 1.0, bulge)
        crest = np.clip(0.5 + 0.5 * (last - first) / steep, 0.0, 1.0)
        extreme = first + crest * (last - first + bulge * (1.0 - crest))
        at = np.flatnonzero(np.ptp(np.sign([first, last, extreme]), axis=0) > 0.0)
        inside = (np.arange(_PARTS) + 0.5)[:, None] / _PARTS
        within = first[at] + inside * (last[at] - first[at] + bulge[at] * (1.0 - inside))
        speed[at] = np.maximum(np.abs(within).mean(axis=0), speed[at])
        return speed

    def harmonic(self, order: int) -> Array:
        """Return the means over each sample of cos and sin of `order` times the table angle, (2, n).

        The integral over the sample is exact for a constant rate in it: sin(m d/2)/(m d/2) at the middle angle.
        Where the rates at its edges are known and others, the angle is a cubic in it, and Gauss' rule of eight
        points integrates, where a sample has no more than two waves.
        """

        def waves() -> Array:
            middle = np.radians(order * 0.5 * (self.angle_deg[1:] + self.angle_deg[:-1]))
            half_turns = order * np.diff(self.angle_deg) / 360.0
            result = np.asarray(np.sinc(half_turns) * np.stack((np.cos(middle), np.sin(middle))))
            at, angles_deg, weights = self._bent
            whole = np.ptp(angles_deg, axis=1) * order < _WAVES_DEG
            turned = np.radians(order * angles_deg[whole])
            result[:, at[whole]] = np.stack((np.cos(turned), np.sin(turned))) @ weights
            return result

        return self.once(f"harmonic {order}", waves)

    @cached_property
    def _bent(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Samples, (k,), in which the rate is not even, the angle at eight points in each, (k, 8), weights."""
        nodes, weights = np.polynomial.legendre.leggauss(8)
        inside = 0.5 + 0.5 * nodes
        if self.edge_rate_dps is None:
            return np.zeros(0, np.int64), np.zeros((0, 8)), 0.5 * weights
        first, last = (
            self.period_s * (edge - self.table_rate_dps)
            for edge in (self.edge_rate_dps[:-1], self.edge_rate_dps[1:])
        )
        at = np.flatnonzero(np.abs(first) + np.abs(last) > _BENT_DEG)
        # Hermite's cubic less the straight line
        off = np.outer(first[at], inside * (1.0 - inside) ** 2) - np.outer(
            last[at], inside**2 * (1.0 - inside)
        )
        start, turn = self.angle_deg[:-1][at], np.diff(self.angle_deg)[at]
        return at, start[:, None] + np.outer(turn, inside) + off, 0.5 * weights

    def once(self, name: str, work: Callable[[], Array]) -> Array:
        """Return what `work` gives, which is done once and kept under a name."""
        if name not in self._kept:
            self._kept[name] = work()
        return self._kept[name]

    @cached_property
    def _kept(self) -> dict[str, Array]:
        return {}

    @cached_property
    def _followers(self) -> dict[tuple[int, float], tuple[Array, Array]]:
        return {}

    @cached_property
    def _plays(self) -> dict[tuple[int, float], tuple[Array, Array]]:
        return {}

    @cached_property
    def warm_k(self) -> Array:
        """T_in above 25 degC, smoothed over a minute, (n,)."""
        return self._smooth(self.t_in_c) - REFERENCE_C

    @cached_property
    def case_warm_k(self) -> Array:
        """T_out above 25 degC, smoothed over a minute, (n,)."""
        return self._smooth(self.t_out_c) - REFERENCE_C

    @cached_property
    def gradient_k(self) -> Array:
        """T_in - T_out, smoothed over a minute, (n,)."""
        return self._smooth(self.t_in_c - self.t_out_c)

    @cached_property
    def warming_k_per_min(self) -> Array:
        """Rate of change of T_in over about two minutes, (n,)."""
        return np.asarray(60.0 * np.gradient(self._smooth(self.warm_k), self.period_s))

    @cached_property
    def gradient_rate_k_per_min(self) -> Array:
        """Rate of change of T_in - T_out over about two minutes, (n,)."""
        return np.asarray(60.0 * np.gradient(self._smooth(self.gradient_k), self.period_s))

    def lagged(self, values: Array, lag_s: float) -> Array:
        """Return a first-order follower of `values`, (n,), settled at its first value; `values` for lag 0."""
        if lag_s <= 0.0:
            return values
        from scipy.signal import lfilter  # here, because a lab that models no effect starts without it

        key = id(values), lag_s
        if key not in self._followers:
            decay = math.exp(-self.period_s / lag_s)
            result, _ = lfilter([1.0 - decay], [1.0, -decay], values, zi=[decay * values[0]])
            # kept with its input, whose id stays its own so long
            self._followers[key] = values, np.asarray(result)
        return self._followers[key][1]

    def slack(self, values: Array, half_width: float) -> Array:
        """Return by how much a play operator is off its input, (n,): it moves only when pushed.

        Of every tenth sample (Visintin 1994, ch. III), interpolated: what it follows is slow.
        """
        return self.slacks(values, (half_width,), np.asarray) if half_width > 0.0 else np.zeros(len(values))

    def slacks(self, values: Array, half_widths: Sequence[float], curve: Callable[[Array], Array]) -> Array:
        """Return by how much the mean of a curve of some plays is off the curve of their input, (n,)."""
        few = values[::10]
        plays = [self._played(values, half) if half > 0.0 else few for half in half_widths]
        off = sum((curve(each) for each in plays), start=np.zeros(len(few))) / len(plays) - curve(few)
        every = np.arange(len(values), dtype=np.float64)
        return np.asarray(np.interp(every, every[::10], off))

    def _played(self, values: Array, half_width: float) -> Array:
        key = id(values), half_width
        if key not in self._plays:
            # kept with its input, whose id stays its own so long
            self._plays[key] = values, play(values[::10], half_width)
        return self._plays[key][1]

    def _smooth(self, values: Array) -> Array:
        from scipy.ndimage import uniform_filter1d

        width = max(1, round(SMOOTHING_S / self.period_s))
        return np.asarray(uniform_filter1d(values, width | 1, mode="nearest"))


def play(values: Array, half_width: float) -> Array:
    """Return what follows `values` (n,) with a play of `half_width` to either side, (n,), from the first value.

    Each sample cuts what there was to an interval about it. Two such cuts are one cut again, so that those of
    ever more samples are put together, twice as many at a time (Hillis and Steele, Commun. ACM 29(12), 1986).
    """
    low, high = values - half_width, values + half_width
    low[0] = high[0] = values[0]
    reach = 1
    while reach < len(values):
        ends = [np.clip(end[:-reach], low[reach:], high[reach:]) for end in (low, high)]
        low, high = (np.concatenate((end[:reach], cut)) for end, cut in zip((low, high), ends, strict=True))
        reach *= 2
    return low


def follower(values: Array, time_constant_s: float, period_s: float, start: float) -> Array:
    """First-order follower, exact for an input that is linear between samples; `start` is its first value."""
    if time_constant_s < 1e-6 * period_s:
        return values
    decay = math.exp(-period_s / time_constant_s)
    mean = (1.0 - decay) * time_constant_s / period_s
    coefficients = [1.0 - mean, mean - decay]
    from scipy.signal import lfilter  # here: a lab starts without scipy (decision 0021)

    first = start - coefficients[0] * values[0]
    result, _ = lfilter(coefficients, [1.0, -decay], values, zi=[first])
    return np.asarray(result)


def gain(time_constant_s: float) -> float:
    """Return the share of the way that a follower goes in one second; 1 for one without a lag."""
    return 1.0 - math.exp(-1.0 / time_constant_s) if time_constant_s > 0.0 else 1.0
