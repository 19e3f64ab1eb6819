"""The tables: strategies, families and kinds, effects, the worst cases, realised on expected information."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from bench.analysis.gap import UNKNOWN
from bench.campaign.hunt import ALIKE, NO_GAP
from benchmarks.hunt._cases import NULL, OUTSIDE, PAIR, SINGLE
from benchmarks.hunt._seek import BUDGET_H, ENDS, UNTIL, Searched
from benchmarks.hunt._strategies import FIXED, RANDOM, SEARCH, STRATEGIES, SUGGESTED
from drivers.base.arrays import Array

_SAID = {
    SEARCH: "the search",
    FIXED: "(a) standard tests in the best fixed order",
    RANDOM: "(b) random runs",
    SUGGESTED: "(c) `gap diagnose`'s suggestion, repeated",
}
_TWO_SIDED = 1.96
_DRAWS = 2000
_WORST = 10
_FIRST = 3
"""Runs whose slope is shown apart: most of what a search learns comes of them."""


def tables(found: Sequence[Searched], order: Sequence[str]) -> list[str]:
    """Return all tables of searches of one mode as lines of Markdown."""
    own = [one for one in found if one.strategy == SEARCH]
    return [
        f"Hours to the right answer, of at most {BUDGET_H:g} h, until {100 * UNTIL:g} %; a wrong or open end "
        f"counts as {BUDGET_H:g} h. In brackets 95 % intervals (Wilson; of medians and slopes by drawing cases "
        f"again). Fixed order: {', '.join(order)}.",
        "",
        *_strategies(found),
        "",
        *_parts(own),
        "",
        *_by_effect(own),
        "",
        *_worst(own),
    ]


def _strategies(found: Sequence[Searched]) -> list[str]:
    lines = [
        "| strategy | n | right | wrong ends | open, what acts among those left | ended in budget | "
        "hours, median | times the search's | slope of realised on expected nats | of the first three runs | "
        "of later ones | of the cases without pairs |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    hours = {s: {one.case: to_right_h(one) for one in found if one.strategy == s} for s in STRATEGIES}
    for name in STRATEGIES:
        own = [one for one in found if one.strategy == name]
        if not own:
            continue
        pairs = [(hours[SEARCH][case], h) for case, h in hours[name].items() if case in hours[SEARCH]]
        times = _with_interval(pairs, _times, "{:.2f}") if pairs else "-"
        lines.append(
            f"| {_SAID[name]} | {len(own)} | {_share([one.right for one in own])} | "
            f"{_share([one.wrong for one in own])} | {_among(own)} | "
            f"{_share([one.ended in ENDS for one in own])} | "
            f"{_with_interval([(h,) for h in hours[name].values()], _median, '{:.1f}')} | {times} | "
            f"{_slope(own)} | {_slope(own, slice(_FIRST))} | {_slope(own, slice(_FIRST, None))} | "
            f"{_slope([one for one in own if one.kind != PAIR])} |"
        )
    return [*lines, "", *_one_of(found), "", _processor(found)]


def _one_of(found: Sequence[Searched]) -> list[str]:
    """Return the row of ends that leave several open because no run tells them apart."""
    own = [one for one in found if one.strategy == SEARCH and one.ended == ALIKE]
    among, right = (sum(getattr(one, mark) for one in own) for mark in ("among", "right"))
    open_still = sum(not one.checked for one in own)
    sizes = ", ".join(str(len(one.one_of)) for one in own) or "-"
    return [
        "| the search, one of several that no run tells apart | n | of how many | what acts is one of them | "
        "and no further run decides | not checked yet |",
        "|---|---|---|---|---|---|",
        "| counted above as right where both hold, else as wrong, as neither before the check | "
        f"{len(own)} | {sizes} | {among} | {right} | {open_still} |",
    ]


def _among(own: Sequence[Searched]) -> str:
    """Return of how many open ends what acts is among the fewest explanations left."""
    still = [one for one in own if one.ended not in ENDS]
    return f"{sum(one.among for one in still)} of {len(still)}"


def to_right_h(one: Searched) -> float:
    """Return the bench hours to the right answer; the whole budget where it did not come."""
    return min(one.hours, BUDGET_H) if one.right else BUDGET_H


def _processor(found: Sequence[Searched]) -> str:
    own = [one for one in found if one.strategy == SEARCH]
    choices = [step.choice_s for one in own for step in one.steps]
    looks = [step.diagnosis_s for one in own for step in one.steps]
    if not choices:
        return "No search yet."
    return (
        f"Processor seconds of the search, median and most: choice {statistics.median(choices):.1f} and "
        f"{max(choices):.1f}, diagnosis {statistics.median(looks):.1f} and {max(looks):.1f}, of "
        f"{len(choices)} steps."
    )


def _slope(own: Sequence[Searched], part: slice = slice(None)) -> str:
    """Return the slope through zero of realised on expected information by run, cases drawn again as a whole."""
    sums = [
        (
            sum(step.expected * step.gained for step in one.steps[part]),
            sum(step.expected**2 for step in one.steps[part]),
        )
        for one in own
    ]
    told = [each for each in sums if each[1] > 0.0]
    return _with_interval(told, _ratio_of_sums, "{:.2f}") if told else "-"


def _parts(own: Sequence[Searched]) -> list[str]:
    """Return the search's table by plant family and by kind."""
    lines = ["| the search | n | right | wrong ends | hours, median |", "|---|---|---|---|---|"]
    groups: dict[str, list[Searched]] = {}
    for name in sorted({one.family for one in own}):
        groups[f"family {name}"] = [one for one in own if one.family == name]
    for kind in (SINGLE, PAIR, OUTSIDE, NULL):
        groups[f"kind {kind}"] = [one for one in own if one.kind == kind]
    return lines + [_row(name, some) for name, some in groups.items() if some]


def _row(name: str, some: Sequence[Searched]) -> str:
    median = _with_interval([(to_right_h(one),) for one in some], _median, "{:.1f}")
    right, wrong = (_share([getattr(one, mark) for one in some]) for mark in ("right", "wrong"))
    return f"| {name} | {len(some)} | {right} | {wrong} | {median} |"


def _by_effect(own: Sequence[Searched]) -> list[str]:
    """Return the search's ends by what acted, each effect of a pair by itself."""
    lines = ["| effect | n | right | wrong ends | hours, median |", "|---|---|---|---|---|"]
    groups: dict[str, list[Searched]] = {}
    for one in own:
        for effect in one.sizes or {NO_GAP: 0.0}:
            groups.setdefault(effect if effect == NO_GAP else f"{effect} ({one.family})", []).append(one)
    for effect, some in sorted(groups.items()):
        median = statistics.median(to_right_h(one) for one in some)
        right, wrong = sum(one.right for one in some), sum(one.wrong for one in some)
        lines.append(f"| {effect} | {len(some)} | {right} | {wrong} | {median:.1f} |")
    return lines


def _worst(own: Sequence[Searched]) -> list[str]:
    lines = ["| worst cases | has | ended | hours | what went wrong |", "|---|---|---|---|---|"]
    ranked = sorted(own, key=lambda one: (one.right, not one.wrong, -one.hours))
    for one in ranked[:_WORST]:
        end = f"{one.ended}: {', '.join(one.one_of) or f'{one.acts} {100.0 * one.probability:.0f} %'}"
        lines.append(f"| {one.case} | {one.truth} | {end} | {one.hours:.1f} | {_what(one)} |")
    return lines


def _what(one: Searched) -> str:
    if one.right:
        longest = max(one.steps, key=lambda step: step.hours)
        return f"right after {len(one.steps)} runs, the longest {longest.procedure} of {longest.hours:.1f} h"
    if one.one_of:
        return "a further run decides" if one.among else "none of those named"
    if not one.wrong:
        return f"no answer after {len(one.steps)} runs"
    if one.acts == NO_GAP:
        shown = ", ".join(sorted({step.procedure for step in one.steps}))
        return f"seen in no run: {one.truth}; made were {shown}"
    if one.kind == NULL:
        return "nothing acts"
    if one.kind == OUTSIDE:
        return "a name for what the catalogue has not" if UNKNOWN not in one.acts else "a name beside it"
    if UNKNOWN in one.acts:
        return "called unknown, or something unknown beside it"
    named, acting = len(one.acts.split(" + ")), len(one.sizes)
    return (
        "one of two not seen" if named < acting else "another name" if named == acting else "a name too many"
    )


def _share(marks: Sequence[bool]) -> str:
    """Return a share in percent with its interval (Wilson 1927)."""
    n, k, z = len(marks), sum(marks), _TWO_SIDED
    middle = (k + 0.5 * z * z) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(k * (n - k) / n + 0.25 * z * z)
    return f"{100.0 * k / n:.0f} % [{100.0 * max(middle - half, 0.0):.0f}, {100.0 * min(middle + half, 1.0):.0f}]"


def _with_interval(rows: Sequence[tuple[float, ...]], statistic: Callable[[Array], float], form: str) -> str:
    """Return a statistic of rows with its 95 % interval, rows drawn again."""
    values = np.array(rows, dtype=np.float64)
    rng = np.random.default_rng(len(rows))
    drawn = [statistic(values[rng.integers(0, len(values), len(values))]) for _ in range(_DRAWS)]
    low, high = np.quantile(drawn, (0.025, 0.975)).tolist()
    return f"{form.format(statistic(values))} [{form.format(low)}, {form.format(high)}]"


def _median(rows: Array) -> float:
    return float(np.median(rows[:, 0]))


def _times(rows: Array) -> float:
    """Return the ratio of the medians, the second column's over the first's."""
    return float(np.median(rows[:, 1]) / np.median(rows[:, 0]))


def _ratio_of_sums(rows: Array) -> float:
    total = rows.sum(axis=0)
    return float(total[0] / total[1]) if total[1] else math.nan


def by_mode(found: Sequence[Searched]) -> Mapping[str, list[Searched]]:
    """Return searches by how their runs were recorded."""
    modes: dict[str, list[Searched]] = {}
    for one in found:
        modes.setdefault(one.mode, []).append(one)
    return modes
