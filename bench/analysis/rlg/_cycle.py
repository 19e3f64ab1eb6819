"""A chamber cycle of another maker's recording: what a regression on temperature gains on the part held out.

For tables with gyros and one temperature. Where a table has no usable time, the row number takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import block_means
from bench.analysis.common.stepwise import stepwise
from bench.record.exchange import read_log, read_mapping, read_table
from drivers.base.arrays import Array
from drivers.base.errors import BenchError, ConfigurationError, RecordError

BLOCK_ROWS = 25
"""Rows a mean: in the recording this was made for temperature moves by about half a degree in them."""
_STATIC = ("T", "T^2", "T^3")
_DYNAMIC = (*_STATIC, "dT", "T*dT", "lag T")
_LAG_BLOCKS = 12.0
_TURN_K = 10.0
"""A leg ends where temperature turns by more than this."""
_SHORTEST = 10
"""Means of a leg that can be fitted or judged."""
_WORTH_PCT, _MOSTLY_PCT = 20.0, 80.0
_OUTLIER = 8.0
_APART = 2.0
"""Rms over 1 sigma of what is left from which on the legs are said to lie apart."""


@dataclass(frozen=True)
class Spread:
    """Of row means on the held-out leg: `sigma` about their own mean, `rms` about what the fitted legs foretell.

    An offset between the legs counts in `rms` only: 1 sigma is what is left when the bias is set anew on every
    leg.
    """

    sigma: float
    rms: float


@dataclass(frozen=True, eq=False)
class AxisGain:
    """One axis on the held-out part, in the recording's unit, before and after.

    Before, the fitted legs' mean foretells it; `static`: temperature only; `dynamic`: with its rate and its
    past. `means`, `left_static`, `left_dynamic`, shape (m,): the means of the whole recording, and what the
    equations leave.
    """

    axis: str
    before: Spread
    after_static: Spread
    after_dynamic: Spread
    terms_static: tuple[str, ...]
    terms_dynamic: tuple[str, ...]
    means: Array
    left_static: Array
    left_dynamic: Array
    one_way: bool = False

    @property
    def static_pct(self) -> float:
        """Improvement of 1 sigma by temperature only."""
        return 100.0 * (1.0 - self.after_static.sigma / self.before.sigma)

    @property
    def dynamic_pct(self) -> float:
        """Improvement of 1 sigma by temperature, its rate and its past."""
        return 100.0 * (1.0 - self.after_dynamic.sigma / self.before.sigma)

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
        best = min(self.after_static, self.after_dynamic, key=lambda spread: spread.sigma)
        apart = ""
        if best.rms > _APART * best.sigma:
            apart = (
                f"; the legs lie {np.sqrt(best.rms**2 - best.sigma**2):.3g} apart, which it does not foretell"
            )
        if past and self.dynamic_pct > self.static_pct + 5.0:
            return f"depends on the temperature's past or rate ({', '.join(past)}){apart}"
        part = "" if self.best_pct >= _MOSTLY_PCT else " in part"
        beyond = (
            "one leg tells nothing of rate and past" if self.one_way else "rate and past explain nothing more"
        )
        return f"follows temperature{part}; {beyond}{apart}"


@dataclass(frozen=True, eq=False)
class CycleStudy:
    """What each axis gains on the held-out leg, and what was left out of the recording.

    `temp_c`, shape (m,): means over `block` rows of temperature; those after number `turn` were held out.
    `failed`: axes that could not be judged, and why.
    """

    axes: tuple[AxisGain, ...]
    remarks: tuple[str, ...]
    temp_c: Array
    turn: int
    block: int = BLOCK_ROWS
    failed: tuple[tuple[str, str], ...] = ()


def study_chamber_cycle(temp_c: Array, rates: dict[str, Array], block: int = BLOCK_ROWS) -> CycleStudy:
    """Fit on the legs before the last turn of temperature, judge on the leg after it, axis by axis.

    `temp_c`, shape (n,), row by row; `rates`, axis -> shape (n,); `block` rows make a mean. Rows far from their
    neighbours and rows without a value are left out and named. The held-out leg is judged as far as the fitted
    legs' temperatures reach. An axis that cannot be judged leaves the others alone. RecordError for a recording
    without a turn, or of which no axis can be judged.
    """
    known = {axis: values for axis, values in rates.items() if np.isfinite(values).mean() > 0.5}
    failed = {axis: "more than half of its values are missing" for axis in rates if axis not in known}
    use, remarks = _sound_rows(temp_c, known)
    temp = block_means(temp_c[use], block)
    turns = _turns(temp)
    turn = turns[-1] if turns else 0
    if not _SHORTEST <= turn <= len(temp) - _SHORTEST:
        raise RecordError(
            "the recording is no cycle",
            found=f"{len(temp)} means of {block} rows, the last turn of temperature at {turn}",
            expected=f"a turn by more than {_TURN_K:g} degC with at least {_SHORTEST} means before and after it",
            remedy="say fewer rows a mean (--block) if there are too few of them",
        )
    fitted = np.arange(len(temp)) <= turn
    covered = (temp >= temp[fitted].min()) & (temp <= temp[fitted].max())
    if len(turns) == 1:
        remarks.append(
            "the fitted leg goes one way only: what depends on rate and past looks there as if it depended on "
            "temperature"
        )
    if beyond := int((~fitted & ~covered).sum()):
        remarks.append(
            f"{beyond} of {int((~fitted).sum())} means of the held-out leg are beyond the fitted range"
        )
    gains = []
    for axis, values in known.items():
        try:
            gain = _gain(axis, block_means(values[use], block), temp, fitted, ~fitted & covered)
            gains.append(replace(gain, one_way=len(turns) == 1))
        except (BenchError, np.linalg.LinAlgError) as error:
            failed[axis] = str(error)
    if not gains:
        raise RecordError(
            "no axis can be judged", found="; ".join(f"{axis}: {why}" for axis, why in failed.items())
        )
    return CycleStudy(tuple(gains), tuple(remarks), temp, turn, block, tuple(failed.items()))


def _gain(
    axis: str, means: Array, temp: Array, fitted: NDArray[np.bool_], held_out: NDArray[np.bool_]
) -> AxisGain:
    if np.ptp(means[fitted]) == 0.0 or np.ptp(means[held_out]) == 0.0:
        raise RecordError(
            "it does not change", found=f"{means[fitted][0]:g} in all rows", expected="a gyro's output"
        )
    terms, left = [], [means - means[fitted].mean()]
    for x, names in zip(_terms(temp), (_STATIC, _DYNAMIC), strict=True):
        result = stepwise(x[fitted], means[fitted], names=names, prewhiten=True)
        terms.append(result.selected)
        left.append(means - result.predict(x))
    before, static, dynamic = (
        Spread(float(np.std(part[held_out], ddof=1)), float(np.sqrt(np.mean(part[held_out] ** 2))))
        for part in left
    )
    return AxisGain(axis, before, static, dynamic, terms[0], terms[1], means, left[1], left[2])


def load_chamber_cycle(path: Path, mapping_file: Path | None = None) -> tuple[Array, dict[str, Array]]:
    """Return temperature (n,) and axis -> rates (n,) of a log of any format.

    With a mapping file: its `t_in` (or `t_out`, `air`) and all its gyros, in deg/s. Without: columns
    imu.gyro.x|y|z and imu.temperature as they stand. ConfigurationError for a log that has none.
    """
    if mapping_file is None:
        names = ["imu.temperature", *(f"imu.gyro.{axis}" for axis in "xyz")]
        columns = read_table(path, names).columns
        return columns[names[0]], {name[-1]: columns[name] for name in names[1:]}
    mapping = read_mapping(mapping_file)
    columns = dict(read_log(path, mapping).columns)
    heat = next((name for name in ("t_in", "t_out", "air") if name in columns), None)
    gyros = {name[-1]: values for name, values in columns.items() if name in ("rate_x", "rate_y", "rate_z")}
    if "output" in columns:
        gyros = {mapping.axis: columns["output"]} | gyros
    if heat is None or not gyros:
        raise ConfigurationError(
            "a chamber cycle needs gyros and a temperature",
            where=str(mapping_file),
            found=", ".join(columns) or "no columns",
            expected="output or gyros, and t_in, t_out or air",
        )
    return columns[heat], dict(sorted(gyros.items()))


def _sound_rows(temp_c: Array, rates: dict[str, Array]) -> tuple[NDArray[np.bool_], list[str]]:
    use = np.ones(len(temp_c), dtype=np.bool_)
    for values in (temp_c, *rates.values()):
        use &= np.isfinite(values)
    remarks = [f"{int((~use).sum())} rows without a value left out"] if not use.all() else []
    far = np.zeros(len(temp_c), dtype=np.bool_)
    for values in rates.values():
        padded = np.pad(np.where(use, values, np.nanmedian(values)), 4, mode="reflect")
        distance = np.abs(values - np.median(np.lib.stride_tricks.sliding_window_view(padded, 9), axis=1))
        # most distances are zero where the output is coarse or stands still for a while: those say no size
        moving = distance[use & (distance > 0.0)]
        if moving.size:
            far |= use & (distance > _OUTLIER * 1.4826 * np.median(moving))
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
