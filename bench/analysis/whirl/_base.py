"""A base that moves: its rate, recorded by a reference on it, is taken out of the gyros that turn.

The gyros feel the base's rate W in axes that turn with the table: (Wx + j Wy) e^(-j psi) about x and y, Wz
about z. The reference's mean is taken off first, since its bias and the Earth's rate stay for the fit, as on a
base that stands. By how much its clock is late, and how its axes lie and scale against the gyros (a complex
coefficient for each of its three), is found from the record, together with the whirl's lines: where the base
moves at the frequency of a line, that line would else count as the base's. It is found from means over half a
period of the highest line: an engine has many times the rate of a sway and says nothing of what the lines need.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.whirl._angle import Alignment, align_angle
from bench.analysis.whirl._lines import HIGHEST
from bench.analysis.whirl._types import Complex, Finding, UnfitRotation
from bench.record.exchange import read_table
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

COLUMNS = ("time_s", "base_rate_x_dps", "base_rate_y_dps", "base_rate_z_dps")
_ROUNDS = 6
_PARTS = 8
_MOST_DELAY_S, _SETTLED_S = 1.0, 1e-6
_MOST_CROOKED = 0.3
"""Part of the reference's rate that its axes and scale may change before it is doubted that the gyros felt it."""
_MOST_YAW = 0.02
"""Rate of the base about z against the table's: beyond it the whirl's own tilt on it is no longer small."""


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Rate of the base in its own axes (those of the unit at angle 0), deg/s (m, 3), at bench times (m,)."""

    time_s: Array
    rate_dps: Array

    @classmethod
    def load(cls, path: Path) -> BaseMotion:
        """Read a log of any format that imports read; RecordError for words, gaps or time that goes back."""
        table = read_table(path, COLUMNS)
        values = np.column_stack([table.columns[name] for name in COLUMNS])
        steps = np.diff(values[:, 0])
        if table.words or not np.isfinite(values).all() or not (steps > 0.0).all():
            raise RecordError(
                "the base's log cannot be used",
                where=str(path),
                found=f"{int((~np.isfinite(values)).sum())} missing, {int((steps <= 0.0).sum())} steps back",
                expected="numbers in " + ", ".join(COLUMNS) + ", times increasing",
            )
        return cls(values[:, 0], values[:, 1:])

    def means(self, edges_s: Array, delay_s: float) -> Array:
        """Return the mean rate between edges (n + 1,), (n, 3), of a reference stamped late by `delay_s`.

        RecordError where the log does not cover them.
        """
        late = edges_s + delay_s
        if late[0] < self.time_s[0] - 1.0 or late[-1] > self.time_s[-1] + 1.0:
            raise RecordError(
                "the base's log does not cover the run",
                found=f"{self.time_s[0]:.1f} to {self.time_s[-1]:.1f} s",
                expected=f"{edges_s[0]:.1f} to {edges_s[-1]:.1f} s, in the run's own time",
                remedy="record the base from before the rotation until after it",
            )
        steps = 0.5 * (self.rate_dps[1:] + self.rate_dps[:-1]) * np.diff(self.time_s)[:, None]
        turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        at = np.stack([np.interp(late, self.time_s, column) for column in turned.T], axis=1)
        return np.asarray(np.diff(at, axis=0) / np.diff(edges_s)[:, None])


@dataclass(frozen=True, eq=False)
class BaseFit:
    """How the reference lay on the gyros. `crooked`, complex (3,): what of its x, y, z has to be added, 1.

    `before_dps`, `after_dps`: rms of the gyros' rate in the base's axes without whirl, of means over half a
    period of the highest line. `yaw_share`: the base's rate about z against the table's.
    """

    delay_s: float
    delay_sigma_s: float
    crooked: Complex
    before_dps: float
    after_dps: float
    yaw_share: float

    @property
    def felt(self) -> float:
        """How much of the reference's level rate the gyros felt, its axes taken as they are said to lie: 1."""
        return float((1.0 + 0.5 * (self.crooked[0] - 1j * self.crooked[1])).real)

    def findings(self) -> list[Finding]:
        """Return what the reference was taken for, whether the gyros felt it, and that the base yaws too much."""
        rms = (
            f"a base that moves: {3600.0 * self.before_dps:.1f} arcsec/s rms before and "
            f"{3600.0 * self.after_dps:.1f} after the reference was taken out"
        )
        late = f"{1e3 * self.delay_s:.1f} +- {1e3 * self.delay_sigma_s:.1f} ms late"
        if abs(self.felt - 1.0) <= _MOST_CROOKED:
            said = [Finding("base", f"{rms}, which was {late}")]
        else:
            doubt = f"the gyros felt {self.felt:.2f} times what it shows, so its delay is not known"
            remedy = "check its axes, signs and unit, or that the base moved at all"
            said = [Finding("base", f"{rms}; {doubt}: {remedy}")]
        if self.yaw_share > _MOST_YAW:
            share = 100.0 * self.yaw_share
            said.append(
                Finding(
                    "base", f"the base yaws by {share:.1f} % of the table's rate: lines are off by as much"
                )
            )
        return said


def without_base(
    edges_s: Array, rate_dps: Array, poll_s: Array, poll_deg: Array, base: BaseMotion
) -> tuple[Array, Array, Alignment, BaseFit]:
    """Return rates (n, 3) as on a base that stands, table angle in rad (n + 1,), how it was found, and the fit.

    UnfitRotation where the reference cannot be laid on the gyros within a second.
    """
    delay_s, found = 0.0, np.zeros(3, np.complex128)
    period_s = float(edges_s[1] - edges_s[0])
    for _ in range(_ROUNDS):
        moved, still_z = _moved(base, edges_s, delay_s), rate_dps[:, 2]
        angle, alignment = align_angle(edges_s, still_z - moved[:, 2], poll_s, poll_deg)
        turn, blocks = np.exp(0.5j * (angle[1:] + angle[:-1])), _Blocks.of(angle, period_s)
        felt = (rate_dps[:, 0] + 1j * rate_dps[:, 1]) * turn
        level = moved[:, 0] + 1j * moved[:, 1]
        slope = np.gradient(level, period_s)
        step, found = blocks.solve(felt - level, slope, moved)
        if abs(step) < _SETTLED_S:
            break
        delay_s += float(np.clip(step, -0.5 * _MOST_DELAY_S, 0.5 * _MOST_DELAY_S))
        if abs(delay_s) > _MOST_DELAY_S:
            break
    if abs(delay_s) > _MOST_DELAY_S or not np.isfinite(delay_s):
        raise UnfitRotation(
            "the base's log does not fit the gyros",
            where="--base",
            found=f"late by {delay_s:.2f} s",
            expected=f"at most {_MOST_DELAY_S:g} s",
            remedy="check its clock, its axes (those of the unit at angle 0) and their signs",
        )
    removed = level + moved @ found
    rates = rate_dps.copy()
    left = (felt - removed) / turn
    rates[:, 0], rates[:, 1], rates[:, 2] = left.real, left.imag, still_z - moved[:, 2]
    before, after = (blocks.rms(part) for part in (felt, felt - removed))
    yaw = float(np.std(blocks.means(moved)[:, 2]) / np.degrees(np.median(np.abs(np.diff(angle))) / period_s))
    sigma_s = blocks.scatter(felt - removed, slope, moved)
    return rates, angle, alignment, BaseFit(delay_s, sigma_s, found, before, after, yaw)


def _moved(base: BaseMotion, edges_s: Array, delay_s: float) -> Array:
    moved = base.means(edges_s, delay_s)
    return np.asarray(moved - moved.mean(axis=0))


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Means over blocks of `samples`; `own`, complex (blocks, k): what no base makes.

    `own` has a column for each line of the whirl (its rate for 1 rad), one for the gyros' biases and one for the
    mean.
    """

    samples: int
    own: Complex

    @classmethod
    def of(cls, angle_rad: Array, period_s: float) -> _Blocks:
        turn = 2.0 * np.pi / float(np.median(np.abs(np.diff(angle_rad))))
        samples = max(1, round(0.5 * turn / HIGHEST))
        edges = angle_rad[::samples][: (len(angle_rad) - 1) // samples + 1]
        lines = np.array([line for line in range(-HIGHEST, HIGHEST + 1) if line])
        tilts = np.exp(1j * edges[:, None] * lines)
        rates = np.diff(tilts, axis=0) / (samples * period_s)
        middle = np.exp(0.5j * (edges[1:] + edges[:-1]))
        return cls(samples, np.column_stack([rates, middle, np.ones(len(middle))]))

    def means(self, values: Complex | Array) -> Any:
        """Return means of (n, ...) over blocks, (blocks, ...); what is left over at the end falls away."""
        count = len(self.own)
        return values[: count * self.samples].reshape(count, self.samples, *values.shape[1:]).mean(axis=1)

    def solve(self, left: Complex, slope: Complex, moved: Array) -> tuple[float, Complex]:
        """Return the delay's step and three complex coefficients of what is left, by least squares."""
        solution = _least_squares(self._columns(slope, moved), self.means(left))
        return float(solution[0]), solution[1:7:2] + 1j * solution[2:7:2]

    def scatter(self, left: Complex, slope: Complex, moved: Array) -> float:
        """Return the standard deviation of the delay, by how much eighths of the record differ."""
        left = self.means(left)
        whole = self._columns(slope, moved)
        left = left - whole[:, 7:] @ _least_squares(whole, left)[7:]
        parts = np.array_split(np.arange(len(left)), _PARTS)
        steps = [_least_squares(whole[part, :7], left[part])[0] for part in parts]
        return float(np.std(steps, ddof=1) / np.sqrt(_PARTS))

    def rms(self, rate: Complex) -> float:
        """Return the rms an axis of a rate (n,), without what the whirl makes."""
        mean = self.means(rate)
        columns = np.column_stack([self.own, 1j * self.own])
        left = mean - columns @ _least_squares(columns, mean)
        return float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0))

    def _columns(self, slope: Complex, moved: Array) -> Complex:
        """Return delay, three complex axes (real and imaginary apart) and what is `own`, (blocks, 7 + 2 k)."""
        axes = self.means(moved)
        turned = [part for axis in axes.T for part in (axis, 1j * axis)]
        return np.column_stack([self.means(slope), *turned, self.own, 1j * self.own])


def _least_squares(columns: Complex, values: Complex) -> Array:
    """Return real coefficients of complex columns (n, k)."""
    rows = np.concatenate([columns.real, columns.imag])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([values.real, values.imag]), rcond=None)[0])
