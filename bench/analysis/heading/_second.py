"""A second temperature, or its difference from the first, as an input: kept where it explains a stay left out
better.

Its regressors are those of the first, [x, x cos, x sin], with a time constant of its own. Each stay beside the
reference is left out once: its positions do not enter the fit, and the misalignment after it is free, so that
later positions do not tell of it either. What the fit then foretells of the stay is held against what was
measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bench.analysis.common.leave_out import within_one_standard_error
from bench.analysis.heading._calibration import Calibration
from bench.analysis.heading._log import Stay
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference, lagged
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

Kind = Literal["temperature", "gradient"]
KINDS: tuple[Kind, ...] = ("temperature", "gradient")
TERMS = ("second x", "second x cos", "second x sin")
_LEAST_STAYS = 4
_LEAST_STAY_S = 12.0 * 3600.0


@dataclass(frozen=True, eq=False)
class SecondSensor:
    """How a second temperature enters: itself, or less the first; `reference` and `tau_s` are of that signal."""

    kind: Kind
    reference: ReferenceTemperature
    tau_s: float

    def change(self, angle_rad: Array, temp_c: Array, second_c: Array) -> Array:
        """Return the signal less its course at the reference heading, K, (n,)."""
        return np.asarray(signal(self.kind, temp_c, second_c) - self.reference.at(angle_rad))


@dataclass(frozen=True, eq=False)
class SecondChoice:
    """What became of a second temperature: `kind` None where it is not used.

    `left_out_as`: rms of the position errors, arcsec, that the fit without a stay leaves on it, (stays,), by
    input: "none", "temperature", "gradient". Empty where there are fewer than four stays to leave out.
    """

    kind: Kind | None
    left_out_as: Mapping[str, Array]


def signal(kind: Kind, temp_c: Array, second_c: Array) -> Array:
    """Return the input itself, degC or K, (n,)."""
    return np.asarray(second_c if kind == "temperature" else second_c - temp_c)


def second_terms(change_k: Array, angle_rad: Array, ratio: float) -> Array:
    """Return the regressors of a change (n,), (n, 3); `ratio`: step by time constant."""
    x = lagged(change_k, ratio)
    return np.stack([x, x * np.cos(angle_rad), x * np.sin(angle_rad)], axis=1)


def reference_of(kind: Kind, angle_rad: Array, temp_c: Array, second_c: Array) -> ReferenceTemperature:
    """Return the course at the reference heading, arrays (n,) of that stay; RecordError without a full day."""
    return fit_reference(angle_rad, signal(kind, temp_c, second_c))


def missing_second(where: str) -> RecordError:
    """Return the refusal of a log without the second temperature that a model needs."""
    return RecordError(
        "this model needs a second temperature",
        where=where,
        found="none",
        expected="a column second_temp_c, the sensor of the calibration",
        remedy="name it, e.g. --column second_temp_c=flange_temperature",
    )


def choose_second(
    run: Calibration, first: Mapping[float, Array], seconds: Mapping[Kind, Mapping[float, Array]]
) -> SecondChoice:
    """Choose by what is left on stays left out.

    `first` and `seconds`: regressors (n, k) on the run's grid by time constant; in each fold the time constants
    are those of the least cost. The simplest input within one standard error of the best is taken.
    """
    stayed = [stay for stay in run.stays[1:] if stay.duration_s >= _LEAST_STAY_S]
    if len(stayed) < _LEAST_STAYS:
        return SecondChoice(None, {})
    every: list[Array] = [run.drifts(drivers) for drivers in first.values()]
    inputs: dict[str, list[tuple[int, ...]]] = {"none": [(k,) for k in range(len(every))]}
    for kind, drivers in seconds.items():
        start = len(every)
        every += [run.drifts(columns) for columns in drivers.values()]
        inputs[kind] = list(product(range(len(first)), range(start, len(every))))
    folds = [_Fold(run, stay, every) for stay in stayed]
    left = {name: np.array([fold.left_out_as(sets) for fold in folds]) for name, sets in inputs.items()}
    taken = within_one_standard_error(left)[0]
    return SecondChoice(next((kind for kind in KINDS if kind == taken), None), left)


class _Fold:
    """The normal equations without one stay, of every column that may enter."""

    def __init__(self, run: Calibration, stay: Stay, every: list[Array]) -> None:
        background, sigma = run.background()
        after = (np.arange(len(run.grid.time_s)) >= stay.stop).astype(np.float64)[:, None]
        self._held, self._scale = run.rows_of(stay), run.scale
        blocks = [background, run.angles(after), *every]
        prior = [sigma, np.full(3, run.priors.start_as)]
        prior += [np.full(block.shape[1], run.priors.gain_dph_per_k) for block in every]
        self._fixed = background.shape[1] + 3
        ends = self._fixed + np.cumsum([0, *(block.shape[1] for block in every)])
        self._places = [np.arange(start, stop) for start, stop in pairwise(ends)]
        columns = np.concatenate(blocks, axis=1)
        fitted = columns[~self._held]
        self._normal = fitted.T @ fitted + np.diag(np.concatenate(prior) ** -2.0)
        self._right = fitted.T @ run.values[~self._held]
        self._tested, self._values = columns[self._held], run.values[self._held]

    def left_out_as(self, sets: list[tuple[int, ...]]) -> float:
        """Return the rms left on the stay by the set of the least cost on all else, arcsec."""
        gains, best = -np.inf, np.empty(0)
        for members in sets:
            place = np.concatenate([np.arange(self._fixed), *(self._places[member] for member in members)])
            normal, right = self._normal[np.ix_(place, place)], self._right[place]
            scale = np.sqrt(np.diag(normal))
            solution = (
                cho_solve(cho_factor(normal / np.outer(scale, scale), lower=True), right / scale) / scale
            )
            if (gain := float(right @ solution)) > gains:
                gains, best = gain, self._values - self._tested[:, place] @ solution
        return float(np.sqrt(best @ best / np.sum(self._scale[self._held] ** 2)))
