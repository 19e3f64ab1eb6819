"""The exam's table: a row a question, a column a folder, every figure with n and its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest

from benchmarks.gap_exam._score import Marked

Cases = Sequence[Marked]
_EDGES = (1.0, 3.0, 10.0, math.inf)
_SURE = 0.94
_CALIBRATION = (0.0, 0.5, 0.8, 0.9, 0.94, 1.001)
_WORSE = -0.01


def share_text(right: Sequence[bool]) -> str:
    """Return how many of how many, with Wilson's 95 % interval (JASA 22, 1927)."""
    k, n = sum(right), len(right)
    if not n:
        return "-"
    interval = binomtest(k, n).proportion_ci(method="wilson")
    return f"{k}/{n} = {100 * k / n:.0f} % [{100 * interval.low:.0f}, {100 * interval.high:.0f}]"


def _between(cases: Cases, low: float, high: float = math.inf) -> list[Marked]:
    return [case for case in cases if low <= case.snr < high]


def _of_kind(cases: Cases, *kinds: str) -> list[Marked]:
    return [case for case in cases if case.kind in kinds]


def _answered(cases: Cases) -> list[Marked]:
    """Return the cases that were not refused: to refuse is no alarm, and no proof that there would be none."""
    return [case for case in cases if not case.answer.error]


def _nulls(cases: Cases) -> str:
    return share_text([case.alarmed for case in _answered(_of_kind(cases, "null"))])


def _singles(low: float, high: float, *, exactly: bool) -> Callable[[Cases], str]:
    def row(cases: Cases) -> str:
        some = _between(_of_kind(cases, "single"), low, high)
        return share_text([case.exact if exactly else all(case.found.values()) for case in some])

    return row


def _false(cases: Cases) -> str:
    acted = _of_kind(cases, "single", "pair", "outside", "mixed")
    return share_text([case.false_cause for case in _answered(_between(acted, 3.0))])


def _twins(cases: Cases) -> str:
    return share_text([twin for case in _of_kind(cases, "single") for twin in case.twins])


def _pairs(what: str) -> Callable[[Cases], str]:
    def row(cases: Cases) -> str:
        pairs = _of_kind(cases, "pair")
        hits = [hit for case in pairs for hit in case.found.values()]
        if what == "recall":
            return share_text(hits)
        if what == "precision":
            return share_text([true for case in pairs for true in case.right])
        return share_text([case.exact for case in pairs])

    return row


def _outside(*, changing: bool, right: Callable[[Marked], bool]) -> Callable[[Cases], str]:
    def row(cases: Cases) -> str:
        some = _answered(_between(_of_kind(cases, "outside"), 3.0))
        return share_text([right(case) for case in some if case.changing == changing])

    return row


def _seen(case: Marked) -> bool:
    return case.answer.unknown or case.answer.differs


def _mixed(cases: Cases) -> str:
    both = [case for case in _of_kind(cases, "mixed") if 0 < len(case.known) < len(case.seal.effects)]
    return share_text([_seen(case) and all(case.found.values()) for case in both])


def _noise(cases: Cases) -> str:
    def named(case: Marked) -> bool:
        wanted = {name for names in case.seal.names.values() for name in names}
        return bool(case.answer.noise & wanted)

    return share_text([named(case) for case in _of_kind(cases, "noise")])


def _stated(low: float, high: float) -> Callable[[Cases], str]:
    def row(cases: Cases) -> str:
        return share_text(
            [
                true
                for case in cases
                for cause, true in zip(case.answer.causes, case.right, strict=True)
                if low <= cause.probability < high
            ]
        )

    return row


def _intervals(cases: Cases) -> str:
    holds = [
        case.answer.share[1] - 1e-9 <= case.closed <= case.answer.share[2] + 1e-9
        for case in _between(_of_kind(cases, "single", "pair"), 1.0)
        if case.answer.share is not None and math.isfinite(case.closed)
    ]
    return share_text(holds)


def _quantiles(values: Sequence[float]) -> str:
    values = [value for value in values if math.isfinite(value)]
    if not values:
        return "-"
    return f"{np.median(values):.2f} / {np.quantile(values, 0.1):.2f} (n = {len(values)})"


def _closed(cases: Cases) -> str:
    return _quantiles([case.closed for case in _between(_of_kind(cases, "single", "pair"), 1.0)])


def _unnamed(cases: Cases) -> list[float]:
    some = [case for case in _between(_of_kind(cases, "outside"), 3.0) if not case.changing]
    return [case.elsewhere for case in some if math.isfinite(case.elsewhere)]


def _learned(cases: Cases) -> str:
    return _quantiles(_unnamed(cases))


def _worse(cases: Cases) -> str:
    return share_text([value < _WORSE for value in _unnamed(cases)])


def _parameters(cases: Cases) -> str:
    return share_text([held for case in cases for held in case.covered])


def _seconds(cases: Cases) -> str:
    seconds = [case.answer.seconds for case in cases if math.isfinite(case.answer.seconds)]
    return f"{np.median(seconds):.1f} / {max(seconds):.1f}" if seconds else "-"


ROWS: tuple[tuple[str, str, Callable[[Cases], str]], ...] = (
    ("cases answered", "", lambda cases: share_text([not case.answer.error for case in cases])),
    ("nulls with anything named", "1 %", _nulls),
    *(
        (
            f"singles: right and nothing else, SNR {low:g} {'up' if high == math.inf else f'to {high:g}'}",
            aim,
            _singles(low, high, exactly=True),
        )
        for (low, high), aim in zip(
            [*pairwise(_EDGES), (3.0, math.inf)], ("85 %", "", "", "95 %"), strict=True
        )
    ),
    ("singles: right one named, SNR 1 up", "", _singles(1.0, math.inf, exactly=False)),
    ("a false cause anywhere, SNR 3 up", "5 %", _false),
    ("false causes of singles that the runs cannot tell from the true one", "", _twins),
    ("pairs: precision", "92 %", _pairs("precision")),
    ("pairs: recall", "88 %", _pairs("recall")),
    ("pairs: exactly both", "", _pairs("exactly")),
    ("outside, the same in repeats, SNR 3 up: called unknown", "95 %", _outside(changing=False, right=_seen)),
    (
        "outside, the same in repeats, SNR 3 up: a false cause beside",
        "8 %",
        _outside(changing=False, right=lambda case: case.false_cause),
    ),
    (
        "outside, differing between repeats, SNR 3 up: said so",
        "",
        _outside(changing=True, right=lambda case: case.answer.differs),
    ),
    (
        "outside, differing between repeats, SNR 3 up: a false cause",
        "8 %",
        _outside(changing=True, right=lambda case: case.false_cause),
    ),
    ("mixed: both reported", "80 %", _mixed),
    ("noise: right one named", "", _noise),
    *(
        (
            f"stated {100 * low:.0f} to {100 * min(high, 1.0):.0f} %: true",
            "90..98 %" if low == _SURE else "",
            _stated(low, high),
        )
        for low, high in pairwise(_CALIBRATION)
    ),
    ("interval of shrinkage holds the true one", "92..98 %", _intervals),
    ("named gap closed on held-out runs, median / 10th percentile", ".98 / .90", _closed),
    (
        "outside, the same in repeats: closed on a profile left out, median / 10th percentile",
        "60 %",
        _learned,
    ),
    ("outside, the same in repeats: a profile left out worse than nominal", "1 %", _worse),
    ("parameters: 95 % interval holds", "92..98 %", _parameters),
    ("seconds of processor a case, median / longest", "3", _seconds),
)


def table(columns: Sequence[tuple[str, Cases]]) -> list[str]:
    """Return the table as lines of Markdown; with several columns one of all cases comes last."""
    if len(columns) > 1:
        columns = [*columns, ("all", [case for _, cases in columns for case in cases])]
    lines = [
        "| | aim | " + " | ".join(name for name, _ in columns) + " |",
        "|---|---|" + "---|" * len(columns),
    ]
    lines += [
        f"| {what} | {aim} | " + " | ".join(row(cases) for _, cases in columns) + " |"
        for what, aim, row in ROWS
    ]
    return lines


def details(cases: Cases) -> list[str]:
    """Return a line a case: what was put in with its ratio, what was answered, what was closed."""
    return [f"{case.name}: {_truth(case)} -> {_reply(case)}{_share(case)}" for case in cases]


def _truth(case: Marked) -> str:
    ratios = [f"{name} {case.seal.snr.get(name, size):.1f}" for name, size in case.seal.effects]
    return " + ".join(ratios) or "nothing"


def _reply(case: Marked) -> str:
    if case.answer.error:
        return case.answer.error.strip().splitlines()[-1]
    stated = [
        f"{'|'.join(sorted(cause.members))} {cause.probability:.2f}{'' if true else ' (false)'}"
        for cause, true in zip(case.answer.causes, case.right, strict=True)
    ]
    stated += sorted(case.answer.noise)
    stated += ["unknown"] if case.answer.unknown else []
    stated += ["differs between repeats"] if case.answer.differs else []
    return ", ".join(stated) or "no gap"


def _share(case: Marked) -> str:
    if math.isnan(case.closed):
        return ""
    stated = case.answer.share
    shown = "nothing" if stated is None else f"{stated[0]:.2f} [{stated[1]:.2f}, {stated[2]:.2f}]"
    return f"; closed {case.closed:.2f}, stated {shown}"
