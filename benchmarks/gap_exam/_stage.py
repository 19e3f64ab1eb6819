"""A run as it happened: true angle, attitude and temperatures on a fine grid, and when the logger wrote a row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Stage:
    """A run without the gyro: what acts on it, and its log's rows.

    The fine grid has m steps of `step_s`; `angle_deg` (m + 1,) is the table's true angle at their edges,
    `elevation_deg` (m,) the input axis above the horizon, `bodies_c` temperatures by the body's name, (m,)
    each. `t_in_c`, `t_out_c` (m,) are what the sensors feel. Row k of n covers `edges_s[k]` to `edges_s[k +
    1]`; `valid` (n,) says where its output counts, `kept` (n,) whether the file has it. `number` counts the
    runs of a campaign in the order in which they were made. `phases` are (name, start s).
    """

    code: str
    profile: str
    condition: str
    repeat: int
    number: int
    step_s: float
    angle_deg: Array
    elevation_deg: Array
    bodies_c: Mapping[str, Array]
    t_in_c: Array
    t_out_c: Array
    edges_s: Array
    valid: NDArray[np.bool_]
    kept: NDArray[np.bool_]
    phases: tuple[tuple[str, float], ...]
    power_on_s: float = 0.0
    held_out: bool = False

    @property
    def run_id(self) -> str:
        return f"{self.profile} {self.condition} {self.repeat + 1}"

    @property
    def key(self) -> str:
        return f"{self.code}|{self.repeat}"

    @property
    def steps(self) -> int:
        return len(self.elevation_deg)

    @property
    def time_s(self) -> Array:
        """Middles of the fine steps since the first edge, (m,)."""
        return np.asarray((np.arange(self.steps) + 0.5) * self.step_s)

    @property
    def rate_dps(self) -> Array:
        """True rate of the table, (m,)."""
        return np.asarray(np.diff(self.angle_deg) / self.step_s)

    @property
    def axis_dps(self) -> Array:
        """True rate of the table along the input axis, (m,)."""
        return np.asarray(self.rate_dps * np.sin(np.radians(self.elevation_deg)))

    @property
    def turning(self) -> bool:
        return bool(np.abs(self.rate_dps).max() > 1e-4)

    @property
    def seconds(self) -> int:
        """Whole seconds that the log covers."""
        return int(np.floor(self.edges_s[-1] - self.edges_s[0] + 1e-6))

    def body(self, name: str) -> Array:
        return self.bodies_c[name]

    def in_rows(self, signal: Array) -> Array:
        """Return the means of a signal (m,) over the rows, (n,)."""
        return self._means(signal, self.edges_s)

    def in_seconds(self, signal: Array, step_s: float = 1.0) -> Array:
        """Return the means of a signal (m,) over steps from the first row's start, (seconds / step_s,)."""
        steps = round(self.seconds / step_s)
        return self._means(signal, self.edges_s[0] + np.arange(steps + 1) * step_s)

    def at_edges(self, angle_deg: Array) -> Array:
        """Return what a signal at the fine edges (m + 1,) is at the rows' edges, (n + 1,)."""
        return np.asarray(np.interp(self.edges_s, np.arange(self.steps + 1) * self.step_s, angle_deg))

    def seen(self) -> NDArray[np.bool_]:
        """Return which whole seconds are covered by rows with an output, (seconds,)."""
        covered_s = np.where(self.valid & self.kept, np.diff(self.edges_s), 0.0)
        whole = self.edges_s[0] + np.arange(self.seconds + 1.0)
        upto = np.interp(whole, self.edges_s, np.concatenate(([0.0], np.cumsum(covered_s))))
        return np.asarray(np.diff(upto) > 0.99)

    def _means(self, signal: Array, edges_s: Array) -> Array:
        sums = np.concatenate(([0.0], np.cumsum(signal) * self.step_s))
        upto = np.interp(edges_s, np.arange(self.steps + 1) * self.step_s, sums)
        return np.asarray(np.diff(upto) / np.diff(edges_s))
