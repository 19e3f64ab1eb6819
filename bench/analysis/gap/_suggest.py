"""What next: which procedure of the bench would best separate what these runs leave open.

Expected log odds of a procedure = half the squared whitened distance between the two fitted signatures on its
stimulus, what the nominal model can imitate taken out (Chaloner and Verdinelli, Statist. Sci. 10, 1995, for
Gaussian models).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.analysis.gap._cells import band_slices
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._designs import Design, usual_designs
from bench.analysis.gap._diagnose import Diagnosis
from bench.analysis.gap._fit import MISFIT
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._rate import RateFinding
from bench.analysis.gap._signature import unexplained

_MOST = 300.0
"""Log odds beyond which more decides no better."""


@dataclass(frozen=True)
class Suggestion:
    """A procedure with parameters, its bench time, and the log odds expected between the two named candidates.

    `settings` are the procedure's parameters that are not at their defaults.
    """

    procedure: str
    parameters: str
    hours: float
    log_odds: float
    decides: str
    settings: Mapping[str, object] = field(default_factory=dict)


def suggest(found: Diagnosis, most: int = 4) -> list[Suggestion]:
    """Return procedures by expected log odds an hour for the closest pair of candidates, at most `most`.

    None for runs of a platform, for there is one procedure for its position, nor for channels without a gyro.
    """
    if found.of_rate is None:
        return []
    pairs = list(_open_questions(found.rate))
    result = []
    for design in usual_designs(found.rate.latitude_deg):
        for text, first, second in pairs:
            odds = _log_odds(design, first, second, found.model)
            result.append(
                Suggestion(design.procedure, design.text, design.hours, odds, text, dict(design.settings))
            )
    result.sort(key=lambda each: -min(each.log_odds, _MOST) / each.hours)
    return [each for each in result if each.log_odds > 1.0][:most]


def _open_questions(found: RateFinding) -> Iterator[tuple[str, Sequence[Term], Sequence[Term]]]:
    """Yield candidates that these runs cannot tell apart well; with none, the size of each cause."""
    doubtful = [cause for cause in found.causes if cause.rivals]
    for cause in doubtful:
        for name, rival in cause.rivals.items():
            yield f"{cause.name} or {name}", (cause.term,), (rival,)
    near = found.resembles[:1]
    other = near[0].name if near else "nothing"
    curves = {part.follows: part.term for part in found.unknown_parts if part.term is not None}
    for follows, curve in curves.items():
        yield f"free curve over {follows} or {other}", (curve,), [cause.term for cause in near]
    learned = found.learned.terms if found.learned else ()
    if learned and not curves:
        yield (
            f"{' and '.join(term.name for term in learned)} or {other}",
            learned,
            [cause.term for cause in near],
        )
    if not doubtful and not found.unknown_parts:
        for cause in found.causes:
            yield f"size of {cause.name}", cause.terms, ()


def _log_odds(design: Design, first: Sequence[Term], second: Sequence[Term], model: Model) -> float:
    """Return the log odds expected; a formula that is not quite the real effect is allowed its tolerance."""
    odds = 0.0
    for number, s in enumerate(design.stimuli.values()):
        whole, other = (
            sum((np.asarray(term.values) @ term.variant.columns(s) for term in terms), np.zeros(len(s)))
            for terms in (first, second)
        )
        phase = np.full(len(s), "run")
        left = []
        for signal in (whole - other, whole):
            run = GapRun(f"{number}", "unit", f"{design.procedure} {number}", "0", s, signal, phase)
            left.append(unexplained([run], model))
        for part in band_slices(left[0].shape[1] + 1, s.period_s):
            apart, gap = (float((each[:, part] ** 2).sum()) for each in left)
            count = max(part.stop - part.start, 1)
            odds += 0.5 * apart / (1.0 + MISFIT**2 * gap / count)
    return odds
