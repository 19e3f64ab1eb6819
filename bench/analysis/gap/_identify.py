"""What runs can show, before a diagnosis: the smallest size of every effect, and what does the same in them.

Nothing of the output counts but its noise: the answer follows from what the table and the chamber did.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.gap._candidates import (
    candidate_variants,
    candidates_of,
    effects_beside,
    possible_candidates,
)
from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._data import GapRun, beside
from bench.analysis.gap._diagnose import Recording
from bench.analysis.gap._evidence import Candidate, reduced
from bench.analysis.gap._fit import MISFIT, weighted_gram
from bench.analysis.gap._generic import FreeCurve
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._prepare import prepare
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_DEFLECTION = 10.0
"""Signal over noise, summed over all coefficients, from which an effect is found as a rule."""


@dataclass(frozen=True)
class Identifiable:
    """What some runs can show of an effect.

    `least` maps each parameter to the size, in its unit, at which it stands ten standard deviations above the
    noise, alone and with the nominal model's parameters fitted beside it; infinite for one that shows nothing.
    `alike` maps effects that could pass for it to the part of its energy that they leave. `reason` says why
    these runs cannot show the effect at all; then the rest is empty.
    """

    effect: str
    least: Mapping[str, float]
    alike: Mapping[str, float]
    reason: str = ""


def identifiable(runs: Sequence[Recording], model: Model) -> tuple[Identifiable, ...]:
    """Return what `runs` can show of every effect that `model` lacks, in the order of the catalogue.

    One effect is alike another if it leaves less than a sixteenth of the other's energy: formulas of the
    catalogue miss a quarter of a real effect's amplitude. ConfigurationError for runs of a platform, logs
    without a gyro, and runs that cannot be diagnosed.
    """
    rates = [run for run in runs if isinstance(run, GapRun)]
    if not rates:
        of_channels = any(isinstance(run, ChannelSeries) for run in runs)
        raise ConfigurationError(
            "these runs have no rate",
            found="a log without a gyro" if of_channels else "positions of a platform",
            expected="runs of a gyro",
        )
    variants = [each for each in candidate_variants(model, rates) if not isinstance(each.effect, FreeCurve)]
    data = prepare(
        [run for run in beside(model.simulation, rates) if isinstance(run, GapRun)], model, variants
    )
    gram = weighted_gram(data.cells, np.ones(len(data.cells)))
    system = reduced(gram, model.sigmas)
    candidates = candidates_of(variants)
    possible, reasons = possible_candidates(
        system, gram, candidates, variants, len(model.sigmas), model.noise.coarseness
    )
    of_effect: dict[str, list[Candidate]] = {}
    for index in possible:
        of_effect.setdefault(candidates[index].effect, []).append(candidates[index])
    result = []
    for name in effects_beside(model):
        if name not in of_effect:
            result.append(Identifiable(name, {}, {}, reasons.get(name, "none of its forms suits these runs")))
            continue
        # the middle of an effect's grid of shapes stands for it
        usual = of_effect[name][len(of_effect[name]) // 2]
        parameters = variants[usual.variant].effect.parameters
        energies = np.diag(system)[list(usual.columns)].tolist()
        least = {
            parameter.name: _DEFLECTION / math.sqrt(energy) if energy > 0.0 else math.inf
            for parameter, energy in zip(parameters, energies, strict=True)
        }
        left = {
            other: min(_left(system, usual, each) for each in theirs)
            for other, theirs in of_effect.items()
            if other != name
        }
        near = sorted((part, other) for other, part in left.items() if part < MISFIT**2)
        result.append(Identifiable(name, least, {other: part for part, other in near}))
    return tuple(result)


def _left(system: Array, one: Candidate, other: Candidate) -> float:
    """Return the part of one's energy that the other's columns leave, each column of one counted alike."""
    own, theirs = np.array(one.columns), np.array(other.columns)
    size = np.sqrt(np.diag(system)[theirs])
    kept = theirs[size > 0.0]
    size = size[size > 0.0]
    inner = system[np.ix_(kept, kept)] / np.outer(size, size) + 1e-9 * np.eye(len(kept))
    across = system[np.ix_(kept, own)] / size[:, None]
    energy = np.diag(system)[own]
    explained = (across * np.linalg.solve(inner, across)).sum(axis=0)
    shown = energy > 0.0
    return float(np.mean(1.0 - explained[shown] / energy[shown]))
