"""Disturbances of the catalogue: looked for in the runs before any fit, taken out of them, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._model_file import DisturbanceTerm, Model, by_parameter
from simulators.effects import Disturbance, Record, catalogue

_SURE = 0.95
"""Highest probability stated: something else may look like it."""


@dataclass(frozen=True)
class Disturbed:
    """What was found: runs with it taken out, and each kind as a term with its probability and a sentence."""

    runs: list[GapRun]
    terms: tuple[DisturbanceTerm, ...]
    probabilities: dict[str, float]
    sentences: dict[str, str]


def lines_hz(terms: Sequence[DisturbanceTerm]) -> list[float]:
    """Return the frequencies of the disturbances that have one."""
    named = [by_parameter(term, term.values) for term in terms]
    return [values["frequency_hz"] for values in named if "frequency_hz" in values]


def without_disturbances(runs: Sequence[GapRun], model: Model) -> Disturbed:
    """Find disturbances in runs against a model, one kind after the other; those the model has are not named."""
    known = {term.name for term in model.disturbances}
    kept = list(runs)
    terms: list[DisturbanceTerm] = []
    sentences: dict[str, str] = {}
    for effect in catalogue().values():
        if not isinstance(effect, Disturbance):
            continue
        found = effect.find([Record(run.stimulus, run.output_dph, model.predict) for run in kept])
        if found is None:
            continue
        kept = [replace(run, output_dph=own) for run, own in zip(kept, found.outputs_dph, strict=True)]
        if effect.name not in known:
            terms.append(DisturbanceTerm(effect, found.values, found.sigmas))
            sentences[effect.name] = f"{effect.meaning} {found.words}"
    return Disturbed(kept, tuple(terms), dict.fromkeys(sentences, _SURE), sentences)
