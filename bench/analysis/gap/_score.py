"""Scores of an exam: what was right, by kind of case and signal-to-noise ratio, with Wilson intervals."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from bench.analysis.gap._exam import Answer, Closed, Sealed
from drivers.base.errors import ConfigurationError
from simulators.exam import KNOWN

EDGES = (0.3, 1.0, 3.0, 10.0, 30.0)


@dataclass(frozen=True)
class Marked:
    """One case, opened and compared: a line of the exam's results file.

    The truth: `seed`, `kind`, `effects`, `stochastic`, `snr`, and the seal `sha256`. What was answered: `causes`
    with their probabilities, the `alternatives` of each, `stochastic_named`, probability `unknown`.
    `stated_share` is the shrinkage on sealed runs with its interval (NaN: no gap there), `true_share` the same
    without noise. `placed`: the strongest cell lies in the region that holds 80 % of the true energy.
    """

    seed: int
    kind: str
    effects: tuple[str, ...]
    stochastic: str
    snr: float
    sha256: str
    causes: Mapping[str, float]
    alternatives: Mapping[str, Mapping[str, float]]
    stochastic_named: tuple[str, ...]
    unknown: float
    placed: bool
    stated_share: tuple[float, float, float]
    true_share: float
    seconds: float

    @classmethod
    def of(cls, sealed: Sealed, answer: Answer, closed: Closed, seconds: float) -> Marked:
        """Compare an answer with the truth."""
        case, stated = sealed.case, closed.stated
        return cls(
            case.seed,
            case.kind,
            tuple(case.effects),
            case.stochastic,
            case.snr,
            sealed.sha256,
            dict(answer.probabilities),
            {name: dict(own) for name, own in answer.alternatives.items()},
            tuple(answer.stochastic),
            answer.unknown_probability,
            answer.strongest in sealed.region,
            (stated.share, stated.low, stated.high) if stated.cells else (math.nan,) * 3,
            closed.true_share,
            seconds,
        )

    @classmethod
    def from_line(cls, text: str) -> Marked:
        """Return the case that a line of the results file holds; ConfigurationError for another text."""
        try:
            facts = json.loads(text)
            for key in ("effects", "stochastic_named", "stated_share"):
                facts[key] = tuple(facts[key])
            return cls(**facts)
        except (ValueError, TypeError, KeyError) as error:
            raise ConfigurationError(
                "a line of the results is no exam case",
                found=str(error),
                expected="a line as the exam writes it",
            ) from error

    @property
    def line(self) -> str:
        """The case as a line of the results file; `from_line` reads it back."""
        return json.dumps(asdict(self))

    @property
    def known(self) -> frozenset[str]:
        """True effects that the catalogue has."""
        return frozenset(effect for effect in self.effects if effect in KNOWN)

    @property
    def foreign(self) -> bool:
        """Whether an effect outside the catalogue acted."""
        return len(self.known) < len(self.effects)

    @property
    def named(self) -> frozenset[str]:
        """Deterministic causes named."""
        return frozenset(self.causes)

    @property
    def first(self) -> bool:
        """Whether the causes named are exactly the true ones."""
        return self.named == self.known

    @property
    def in_set(self) -> bool:
        """Whether every true effect is a cause or a stated alternative of one."""
        stated = set(self.named)
        for rivals in self.alternatives.values():
            stated.update(rivals)
        return self.known <= stated

    @property
    def claims(self) -> list[tuple[float, bool]]:
        """Stated probabilities, of each cause named and of something unknown, and whether they came true."""
        stated = [(p, name in self.known) for name, p in self.causes.items()]
        return [*stated, (self.unknown, self.foreign)]

    @property
    def called_unknown(self) -> bool:
        """Whether something outside the catalogue was reported."""
        return self.unknown > 0.5


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


@dataclass(frozen=True)
class Reliability:
    """Claims of about one probability: their mean, how many there were and how many came true."""

    stated: float
    count: int
    true: int


_Row = tuple[str, str, Callable[[Marked], bool]]
"""Words of a line, the kind of cases that it counts, which of them are right."""
_NULL: _Row = (
    "null: a cause or unknown named (less is better)",
    "null",
    lambda case: bool(case.named or case.stochastic_named) or case.called_unknown,
)
_BY_SNR: tuple[_Row, ...] = (
    ("single: right effect and nothing else", "single", lambda case: case.first),
    ("single: right effect named or a stated alternative", "single", lambda case: case.in_set),
    ("single: called unknown (less is better)", "single", lambda case: case.called_unknown),
    ("pair: exactly both", "pair", lambda case: case.first),
    ("pair: both named or alternatives", "pair", lambda case: case.in_set),
    ("outside the catalogue: called unknown", "unknown", lambda case: case.called_unknown),
    ("outside the catalogue: a false cause named", "unknown", lambda case: bool(case.named)),
    (
        "known and unknown: both reported",
        "known and unknown",
        lambda case: case.called_unknown and case.known <= case.named,
    ),
)
_STOCHASTIC: _Row = (
    "stochastic: named exactly",
    "stochastic",
    lambda case: case.stochastic_named == (case.stochastic,) and not case.named and not case.called_unknown,
)


def _line(what: str, kind: str, right: Callable[[Marked], bool], marked: Sequence[Marked], snr: str) -> Line:
    outcomes = [right(case) for case in marked if case.kind == kind]
    return Line(what, snr, sum(outcomes), len(outcomes))


@dataclass(frozen=True)
class Exam:
    """An exam: `cases` were planned, `marked` are those finished."""

    seed: int
    cases: int
    marked: tuple[Marked, ...]

    @property
    def lines(self) -> list[Line]:
        """The lines of its table."""
        marked, closed = self.marked, self._closed
        lines = [_line(*_NULL, marked, "all")]
        for low, high in pairwise(EDGES):
            band = [case for case in marked if low <= case.snr < high]
            lines += [_line(*row, band, f"{low:g}..{high:g}") for row in _BY_SNR]
        pairs = [case for case in marked if case.kind == "pair" and case.snr >= 1.0]
        hits = sum(len(pair.named & pair.known) for pair in pairs)
        lines.append(Line("pairs: precision", "1..30", hits, sum(len(pair.named) for pair in pairs)))
        lines.append(Line("pairs: recall", "1..30", hits, sum(len(pair.known) for pair in pairs)))
        lines.append(_line(*_STOCHASTIC, marked, "all"))
        for low, high in pairwise(EDGES[1:]):
            placed = [case.placed for case in marked if case.effects and low <= case.snr < high]
            what, snr = "place: strongest cell in the true 80 % region", f"{low:g}..{high:g}"
            lines.append(Line(what, snr, sum(placed), len(placed)))
        covered = sum(case.stated_share[1] <= case.true_share <= case.stated_share[2] for case in closed)
        lines.append(Line("shrinkage: 95 % interval holds the true shrinkage", "1..30", covered, len(closed)))
        good = sum(case.true_share >= 0.95 for case in closed)
        lines.append(Line("shrinkage: at least 95 % of the oracle's", "1..30", good, len(closed)))
        return [line for line in lines if line.of]

    @property
    def _closed(self) -> list[Marked]:
        """Single effects and pairs, SNR >= 1, with a gap on the sealed runs."""
        able = [case for case in self.marked if case.kind in ("single", "pair") and case.snr >= 1.0]
        return [case for case in able if math.isfinite(case.stated_share[0])]

    @property
    def shrinkage_quantiles(self) -> tuple[float, float]:
        """Median and 10th percentile of true shrinkage over the oracle's, single effects and pairs, SNR >= 1.

        The oracle takes out the true effect with its true amplitude, nothing but noise is left: its share is 1.
        """
        shares = [case.true_share for case in self._closed]
        if not shares:
            return math.nan, math.nan
        return float(np.median(shares)), float(np.quantile(shares, 0.1))

    @property
    def reliability(self) -> tuple[list[Reliability], float]:
        """Claims in ten bins of probability, and the expected calibration error (Naeini et al., AAAI 2015)."""
        claims = [claim for each in self.marked for claim in each.claims]
        bins: list[Reliability] = []
        error = 0.0
        for k in range(10):
            own = [
                claim for claim in claims if k / 10 <= claim[0] < (k + 1) / 10 or (k == 9 and claim[0] >= 1.0)
            ]
            if not own:
                continue
            stated, true = sum(p for p, _ in own) / len(own), sum(right for _, right in own)
            bins.append(Reliability(stated, len(own), true))
            error += abs(stated * len(own) - true) / len(claims)
        return bins, error
