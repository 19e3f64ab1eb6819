"""Scores of an exam: what was right, by kind of case and signal-to-noise ratio, with Wilson intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

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
    def placed(self) -> bool:
        """Whether the strongest cell lies in the region that holds 80 % of the true energy."""
        return self.answer.strongest in self.sealed.region

    @property
    def claims(self) -> list[tuple[float, bool]]:
        """Stated probabilities, of each cause named and of something unknown, and whether they came true."""
        stated = [(p, name in self.known) for name, p in self.answer.probabilities.items()]
        return [*stated, (self.answer.unknown_probability, self.foreign)]

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
    detectable = [each for each in marked if each.sealed.case.snr >= 1.0]
    pairs = [each for each in detectable if each.sealed.case.kind == "pair"]
    hits = sum(len(each.named & each.known) for each in pairs)
    lines.append(Line("pairs: precision", "1..30", hits, sum(len(each.named) for each in pairs)))
    lines.append(Line("pairs: recall", "1..30", hits, sum(len(each.known) for each in pairs)))
    lines.append(_line("stochastic: named exactly", marked, "stochastic", _stochastic))
    for low, high in pairwise(EDGES[1:]):
        acted = [each for each in marked if each.sealed.region and low <= each.sealed.case.snr < high]
        right = sum(each.placed for each in acted)
        lines.append(
            Line("place: strongest cell in the true 80 % region", f"{low:g}..{high:g}", right, len(acted))
        )
    strong = [each for each in marked if each.sealed.case.kind in ("single", "pair") and _coverable(each)]
    covered = sum(c.stated.low <= c.true_share <= c.stated.high for c in (each.closed for each in strong))
    lines.append(Line("shrinkage: 95 % interval holds the true shrinkage", "1..30", covered, len(strong)))
    good = sum(each.closed.true_share >= 0.95 for each in strong)
    lines.append(Line("shrinkage: at least 95 % of the oracle's", "1..30", good, len(strong)))
    return [line for line in lines if line.of]


def shrinkage_quantiles(marked: Sequence[Marked]) -> tuple[float, float]:
    """Return median and 10th percentile of true shrinkage over the oracle's, single effects and pairs, SNR >= 1.

    The oracle takes out the true effect with its true amplitude, nothing but noise is left: its share is 1.
    """
    shares = [
        each.closed.true_share
        for each in marked
        if each.sealed.case.kind in ("single", "pair") and _coverable(each)
    ]
    if not shares:
        return math.nan, math.nan
    return float(np.median(shares)), float(np.quantile(shares, 0.1))


@dataclass(frozen=True)
class Reliability:
    """Claims of about one probability: their mean, how many there were and how many came true."""

    stated: float
    count: int
    true: int


def reliability(marked: Sequence[Marked]) -> tuple[list[Reliability], float]:
    """Return claims in ten bins of probability, and the expected calibration error (Naeini et al., AAAI 2015)."""
    claims = [claim for each in marked for claim in each.claims]
    bins: list[Reliability] = []
    error = 0.0
    for k in range(10):
        own = [claim for claim in claims if k / 10 <= claim[0] < (k + 1) / 10 or (k == 9 and claim[0] >= 1.0)]
        if not own:
            continue
        stated, true = sum(p for p, _ in own) / len(own), sum(right for _, right in own)
        bins.append(Reliability(stated, len(own), true))
        error += abs(stated * len(own) - true) / len(claims)
    return bins, error


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
