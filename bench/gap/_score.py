"""Scores of an exam: what was right, by kind of case and signal-to-noise ratio, with Wilson intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.gap._exam import Answer, Closed, Sealed
from simulators.exam import KNOWN

EDGES = (0.3, 1.0, 3.0, 10.0, 30.0)


@dataclass(frozen=True)
class Marked:
    """One case, opened and compared. `named` are the causes, `right` those that are true."""

    sealed: Sealed
    answer: Answer
    closed: Closed
    seconds: float

    @property
    def known(self) -> frozenset[str]:
        """True effects that the catalogue has."""
        return frozenset(effect for effect in self.sealed.case.effects if effect in KNOWN)

    @property
    def foreign(self) -> bool:
        """Whether an effect outside the catalogue acted."""
        return len(self.known) < len(self.sealed.case.effects)

    @property
    def named(self) -> frozenset[str]:
        """Deterministic causes named."""
        return frozenset(self.answer.causes)

    @property
    def first(self) -> bool:
        """Whether the causes named are exactly the true ones."""
        return self.named == self.known

    @property
    def in_set(self) -> bool:
        """Whether every true effect is a cause or a stated alternative of one."""
        stated = set(self.named)
        for rivals in self.answer.alternatives.values():
            stated.update(rivals)
        return self.known <= stated

    @property
    def unknown(self) -> bool:
        """Whether something outside the catalogue was reported."""
        return self.answer.unknown_probability > 0.5


@dataclass(frozen=True)
class Line:
    """One line of the table: how many of how many, 95 % Wilson interval."""

    what: str
    snr: str
    right: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson (JASA 22, 1927) interval of the proportion."""
        return wilson(self.right, self.of)


def wilson(right: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """Return Wilson's interval of a proportion; (0, 1) for no trials."""
    if of == 0:
        return 0.0, 1.0
    p = right / of
    centre = p + z * z / (2.0 * of)
    half = z * math.sqrt(p * (1.0 - p) / of + z * z / (4.0 * of * of))
    below = 1.0 + z * z / of
    return max(0.0, (centre - half) / below), min(1.0, (centre + half) / below)


def table(marked: Sequence[Marked]) -> list[Line]:
    """Return the exam's lines."""
    lines = [_line("null: a cause or unknown named (less is better)", marked, "null", _alarm)]
    for low, high in pairwise(EDGES):
        band = [each for each in marked if low <= each.sealed.case.snr < high]
        snr = f"{low:g}..{high:g}"
        lines += [
            _line("single: right effect and nothing else", band, "single", lambda m: m.first, snr),
            _line(
                "single: right effect named or a stated alternative", band, "single", lambda m: m.in_set, snr
            ),
            _line("single: called unknown (less is better)", band, "single", lambda m: m.unknown, snr),
            _line("pair: exactly both", band, "pair", lambda m: m.first, snr),
            _line("pair: both named or alternatives", band, "pair", lambda m: m.in_set, snr),
            _line("outside the catalogue: called unknown", band, "unknown", lambda m: m.unknown, snr),
            _line(
                "outside the catalogue: a false cause named", band, "unknown", lambda m: bool(m.named), snr
            ),
            _line("known and unknown: both reported", band, "known and unknown", _both, snr),
        ]
    lines.append(_line("stochastic: named exactly", marked, "stochastic", _stochastic))
    strong = [each for each in marked if each.sealed.case.kind in ("single", "pair") and _coverable(each)]
    covered = sum(c.stated.low <= c.true_share <= c.stated.high for c in (each.closed for each in strong))
    lines.append(Line("shrinkage: 95 % interval holds the true shrinkage", "1..30", covered, len(strong)))
    good = sum(each.closed.true_share >= 0.95 for each in strong)
    lines.append(
        Line("shrinkage: at least 95 % of what the true effect would give", "1..30", good, len(strong))
    )
    return [line for line in lines if line.of]


def _line(
    what: str, marked: Sequence[Marked], kind: str, right: Callable[[Marked], bool], snr: str = "all"
) -> Line:
    own = [each for each in marked if each.sealed.case.kind == kind]
    return Line(what, snr, sum(right(each) for each in own), len(own))


def _alarm(each: Marked) -> bool:
    return bool(each.named or each.answer.stochastic) or each.unknown


def _both(each: Marked) -> bool:
    return each.unknown and each.known <= each.named


def _stochastic(each: Marked) -> bool:
    return each.answer.stochastic == (each.sealed.case.stochastic,) and not each.named and not each.unknown


def _coverable(each: Marked) -> bool:
    return each.sealed.case.snr >= 1.0 and each.closed.stated.cells > 0
