"""What next: which procedure of the bench would best separate what these runs leave open.

Expected log odds of a procedure = half the squared whitened distance between the two fitted signatures on its
stimulus, what the nominal model can imitate taken out (Chaloner and Verdinelli, Statist. Sci. 10, 1995, for
Gaussian models); the stimulus is simulated with a plain two-lag unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.analysis.gap._cells import band_slices
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import Diagnosis
from bench.analysis.gap._fit import MISFIT
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._rate import RateFinding
from bench.analysis.gap._signature import unexplained
from bench.control.procedure import find_procedure
from drivers.base.arrays import Array
from simulators.effects import Stimulus

_CASE_S, _BOARD_S, _COIL_S = 60.0, 300.0, 900.0
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


@dataclass(frozen=True)
class _Plan:
    procedure: str
    parameters: str
    stimuli: tuple[Stimulus, ...]
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def hours(self) -> float:
        """Bench time that the procedure expects."""
        procedure = find_procedure(self.procedure)
        return procedure.expected_duration_s(procedure.parse(dict(self.settings))) / 3600.0


def suggest(found: Diagnosis, most: int = 4) -> list[Suggestion]:
    """Return procedures by expected log odds an hour for the closest pair of candidates, at most `most`.

    None for runs of a platform: there is one procedure for its position.
    """
    if found.position is not None:
        return []
    pairs = list(_open_questions(found.rate))
    result = []
    for plan in _plans(found.rate.latitude_deg):
        for text, first, second in pairs:
            odds = _log_odds(plan, first, second, found.model)
            result.append(
                Suggestion(plan.procedure, plan.parameters, plan.hours, odds, text, dict(plan.settings))
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
            yield f"size of {cause.name}", (cause.term,), ()


def _log_odds(plan: _Plan, first: Sequence[Term], second: Sequence[Term], model: Model) -> float:
    """Return the log odds expected; a formula that is not quite the real effect is allowed its tolerance."""
    odds = 0.0
    for number, s in enumerate(plan.stimuli):
        whole, other = (
            sum((np.asarray(term.values) @ term.variant.columns(s) for term in terms), np.zeros(len(s)))
            for terms in (first, second)
        )
        phase = np.full(len(s), "run")
        left = []
        for signal in (whole - other, whole):
            run = GapRun(f"{number}", "unit", f"{plan.procedure} {number}", "0", s, signal, phase)
            left.append(unexplained([run], model))
        for part in band_slices(left[0].shape[1] + 1, s.period_s):
            apart, gap = (float((each[:, part] ** 2).sum()) for each in left)
            count = max(part.stop - part.start, 1)
            odds += 0.5 * apart / (1.0 + MISFIT**2 * gap / count)
    return odds


def _plans(latitude_deg: float) -> list[_Plan]:
    """Return the bench's procedures with their usual parameters, as stimuli at 1 s."""
    shock = [(0.0, 25.0), (3600.0, 25.0), (3950.0, -45.0), (8450.0, -45.0), (8800.0, 25.0), (14000.0, 25.0)]
    ramp = [(0.0, 25.0), (3600.0, 25.0), (15600.0, -40.0), (17400.0, -40.0), (36000.0, 60.0), (37800.0, 60.0)]
    room = [(0.0, 25.0), (7200.0, 25.0)]
    wanted = [0.0, *(sign * rate for rate in (1.0, 5.0, 10.0, 20.0, 50.0, 100.0) for sign in (1.0, -1.0))]
    steps = np.repeat(np.array(wanted), 240)
    turning = tuple(_stimulus(shock, latitude_deg, rate_dps=rate) for rate in (20.0, -20.0, 0.0))
    level = _stimulus(room, latitude_deg, rate_dps=20.0, elevation_deg=0.0)
    return [
        _Plan("zero-bias-cold-shock", "axis east", (_stimulus(shock, latitude_deg, elevation_deg=0.0),)),
        _Plan("scale-factor-cold-shock", "rates +20, -20, 0 deg/s", turning),
        _Plan(
            "thermal-ramp",
            "25 to -40 to 60 degC",
            (_stimulus(ramp, latitude_deg, elevation_deg=0.0),),
            {"high_c": 60.0, "dwell_min": 30.0, "both_directions": False},
        ),
        _Plan(
            "constant-rotation",
            "20 deg/s at room, axis level",
            (level,),
            {"rate_dps": 20.0, "turns": 400.0},
        ),
        _Plan(
            "standard-test",
            "rates 1 to 100 deg/s, room temperature only",
            (_stimulus(room, latitude_deg, rates_dps=steps),),
            {"max_rate_dps": 100.0, "temperatures": False},
        ),
    ]


def _stimulus(
    points: list[tuple[float, float]],
    latitude_deg: float,
    *,
    rate_dps: float = 0.0,
    rates_dps: Array | None = None,
    elevation_deg: float = 90.0,
) -> Stimulus:
    times, temperatures = np.array(points).T
    n = int(times[-1]) if rates_dps is None else len(rates_dps)
    time_s = np.arange(1.0, n + 1.0)
    air = np.interp(time_s, times, temperatures)
    rates = np.full(n, rate_dps) if rates_dps is None else rates_dps
    angle = 90.0 + np.concatenate(([0.0], np.cumsum(rates)))
    elevation = np.full(n, elevation_deg)
    bare = Stimulus(time_s, air, air, angle, elevation, latitude_deg)
    case = bare.lagged(air, _CASE_S)
    inside = bare.lagged(bare.lagged(case, _BOARD_S), _COIL_S) + 6.0 * (1.0 - np.exp(-time_s / 1500.0))
    return Stimulus(time_s, inside, case, angle, elevation, latitude_deg)
