"""Disturbances of the catalogue: looked for in the runs before any fit, taken out of them, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._model_file import DisturbanceTerm, Model, by_parameter
from simulators.effects import Disturbance, Record, catalogue

_SURE = 0.95
"""Highest probability stated: something else may look like it."""
_SAME_LINE = 0.01
"""Cycles a sample by which a line of the model may be off and be the one that was found."""


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
        term = DisturbanceTerm(effect, found.values, found.sigmas)
        if not any(_is_that(own, term, kept[0].stimulus.period_s) for own in model.disturbances):
            terms.append(term)
            sentences[effect.name] = f"{effect.meaning} {found.words}"
    return Disturbed(kept, tuple(terms), dict.fromkeys(sentences, _SURE), sentences)


def _is_that(known: DisturbanceTerm, found: DisturbanceTerm, period_s: float) -> bool:
    """Return whether a disturbance of a model is the one that was found: a line by where means show it."""
    if known.name != found.name:
        return False
    both = [[abs((hz * period_s + 0.5) % 1.0 - 0.5) for hz in lines_hz([term])] for term in (known, found)]
    return not both[0] or min(abs(one - other) for one in both[0] for other in both[1]) < _SAME_LINE
