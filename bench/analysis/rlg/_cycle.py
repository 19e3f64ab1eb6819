"""A chamber cycle of another maker's recording: what a regression on temperature gains on the part held out.

For tables with a gyro of three axes, one temperature and no usable time: the row number takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import block_means
from bench.analysis.common.stepwise import stepwise
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_BLOCK = 25
"""Rows a mean: temperature moves by about half a degree in them."""
_STATIC = ("T", "T^2", "T^3")
_DYNAMIC = (*_STATIC, "dT", "T*dT", "lag T")
_LAG_BLOCKS = 12.0
_TURN_K = 10.0
"""A leg ends where temperature turns by more than this."""
_SHORTEST = 10
"""Means of a leg that can be fitted or judged."""
_WORTH_PCT, _MOSTLY_PCT = 20.0, 80.0
_OUTLIER = 8.0


@dataclass(frozen=True, eq=False)
class AxisGain:
    """One axis: 1 sigma of row means on the held-out part in the recording's unit, before and after.

    `static`: temperature only; `dynamic`: with its rate and its past. `means`,
    `left_static`, `left_dynamic`, shape (m,): the means of the whole recording, and what the equations leave.
    """

    axis: str
    before: float
    after_static: float
    after_dynamic: float
    terms_static: tuple[str, ...]
    terms_dynamic: tuple[str, ...]
    means: Array
    left_static: Array
    left_dynamic: Array

    @property
    def static_pct(self) -> float:
        """Improvement by temperature only."""
        return 100.0 * (1.0 - self.after_static / self.before)

    @property
    def dynamic_pct(self) -> float:
        """Improvement by temperature, its rate and its past."""
        return 100.0 * (1.0 - self.after_dynamic / self.before)

    @property
    def best_pct(self) -> float:
        """Improvement by the better of the two, which is known only after a look at the held-out leg."""
        return max(self.static_pct, self.dynamic_pct)

    @property
    def gains(self) -> bool:
        """Whether the better of the two is worth having."""
        return self.best_pct >= _WORTH_PCT

    @property
    def verdict(self) -> str:
        """What the axis gains, in words."""
        past = [name for name in self.terms_dynamic if name not in _STATIC]
        if not self.gains:
            return "hardly reproducible: leave it uncompensated"
        if past and self.dynamic_pct > self.static_pct + 5.0:
            return f"depends on the temperature's past or rate ({', '.join(past)})"
        part = "" if self.best_pct >= _MOSTLY_PCT else " in part"
        return f"follows temperature{part}; rate and past explain nothing more"


@dataclass(frozen=True, eq=False)
class CycleStudy:
    """What each axis gains on the held-out leg, and what was left out of the recording.

    `temp_c`, shape (m,): means of temperature; those after number `turn` were held out.
    """

    axes: tuple[AxisGain, ...]
    remarks: tuple[str, ...]
    temp_c: Array
    turn: int


def study_chamber_cycle(temp_c: Array, rates: dict[str, Array]) -> CycleStudy:
    """Fit on the legs before the last turn of temperature, judge on the leg after it, axis by axis.

    `temp_c`, shape (n,), row by row; `rates`, axis -> shape (n,). Rows far from their neighbours and rows without
    a value are left out and named. The held-out leg is judged as far as the fitted legs' temperatures reach.
    RecordError for a recording without a turn.
    """
    use, remarks = _sound_rows(temp_c, rates)
    temp = block_means(temp_c[use], _BLOCK)
    turns = _turns(temp)
    turn = turns[-1] if turns else 0
    if not _SHORTEST <= turn <= len(temp) - _SHORTEST:
        raise RecordError(
            "the recording is no cycle",
            found=f"{len(temp)} means of {_BLOCK} rows, the last turn of temperature at {turn}",
            expected=f"a turn by more than {_TURN_K:g} degC with at least {_SHORTEST} means before and after it",
        )
    static, dynamic = _terms(temp)
    fitted = np.arange(len(temp)) <= turn
    covered = (temp >= temp[fitted].min()) & (temp <= temp[fitted].max())
    held_out = ~fitted & covered
    if len(turns) == 1:
        remarks.append(
            "the fitted leg goes one way only: what depends on rate and past looks there as if it depended on "
            "temperature"
        )
    beyond = int((~fitted & ~covered).sum())
    if beyond:
        remarks.append(
            f"{beyond} of {int((~fitted).sum())} means of the held-out leg are beyond the fitted range"
        )
    gains = []
    for axis, values in rates.items():
        means = block_means(values[use], _BLOCK)
        terms, left = [], []
        for x, names in ((static, _STATIC), (dynamic, _DYNAMIC)):
            result = stepwise(x[fitted], means[fitted], names=names, prewhiten=True)
            terms.append(result.selected)
            left.append(means - result.predict(x))
        before, after_static, after_dynamic = (
            float(np.std(series[held_out], ddof=1)) for series in (means, *left)
        )
        figures = (before, after_static, after_dynamic, terms[0], terms[1], means, left[0], left[1])
        gains.append(AxisGain(axis, *figures))
    return CycleStudy(tuple(gains), tuple(remarks), temp, turn)


def load_chamber_cycle(path: Path) -> tuple[Array, dict[str, Array]]:
    """Read a tab-separated table with columns imu.gyro.x|y|z and imu.temperature; RecordError if it has none."""
    if not path.is_file():
        raise RecordError(
            "no such recording",
            where=str(path),
            expected="a tab-separated table with imu.gyro.x|y|z and imu.temperature",
        )
    with path.open(encoding="utf-8") as file:
        names = file.readline().rstrip("\n").split("\t")
    wanted = ["imu.temperature", *(f"imu.gyro.{axis}" for axis in "xyz")]
    if missing := [name for name in wanted if name not in names]:
        raise RecordError(
            "the table lacks columns", where=str(path), found=", ".join(names), expected=", ".join(missing)
        )
    table = np.genfromtxt(path, delimiter="\t", skip_header=1, usecols=[names.index(name) for name in wanted])
    return table[:, 0], {axis: table[:, n] for n, axis in enumerate("xyz", start=1)}


def _sound_rows(temp_c: Array, rates: dict[str, Array]) -> tuple[NDArray[np.bool_], list[str]]:
    use = np.ones(len(temp_c), dtype=np.bool_)
    for values in (temp_c, *rates.values()):
        use &= np.isfinite(values)
    remarks = [f"{int((~use).sum())} rows without a value left out"] if not use.all() else []
    far = np.zeros(len(temp_c), dtype=np.bool_)
    for values in rates.values():
        padded = np.pad(np.where(use, values, np.nanmedian(values)), 4, mode="reflect")
        distance = np.abs(values - np.median(np.lib.stride_tricks.sliding_window_view(padded, 9), axis=1))
        far |= use & (distance > _OUTLIER * 1.4826 * np.nanmedian(distance[use]))
    if far.any():
        at = np.flatnonzero(far)
        remarks.append(f"{len(at)} outlying rows left out, the first at row {at[0]}")
    return use & ~far, remarks


def _turns(temp: Array) -> list[int]:
    """Return where temperature turns by more than `_TURN_K`."""
    turns, extreme, sign = [], 0, 0.0
    for at, value in enumerate(temp):
        if sign == 0.0:
            moved = value - temp[0]
            sign = float(np.sign(moved)) if abs(moved) > _TURN_K else 0.0
            extreme = at
        elif sign * (value - temp[extreme]) >= 0.0:
            extreme = at
        elif sign * (temp[extreme] - value) > _TURN_K:
            turns.append(extreme)
            extreme, sign = at, -sign
    return turns


def _terms(temp: Array) -> tuple[Array, Array]:
    rate = np.gradient(temp)
    lag, lagged = temp[0], np.empty_like(temp)
    for index, value in enumerate(temp):
        lag += (value - lag) / _LAG_BLOCKS
        lagged[index] = lag
    static = np.column_stack([temp, temp**2, temp**3])
    return static, np.column_stack([static, rate, temp * rate, temp - lagged])
