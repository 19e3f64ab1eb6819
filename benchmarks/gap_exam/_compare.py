"""Two sets of answers to the same cases: which marks are others now.

A table of rates hides what changes: a case that is lost for each that is won leaves it as it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.gap_exam._score import Marked, marked_cases
from benchmarks.gap_exam._table import details
from drivers.base.errors import ConfigurationError

_CLEAR_SNR = 1.0
_STRONG_SNR = 3.0


def faults(case: Marked) -> tuple[str, ...]:
    """Return in words what is wrong with an answer; an effect at an SNR below 1 need not be found."""
    answer = case.answer
    beside = answer.unknown or answer.differs
    found = [
        (case.kind == "null" and case.alarmed, "an alarm without a gap"),
        (bool(case.known) and case.snr >= _CLEAR_SNR and not all(case.found.values()), "not found"),
        (case.false_cause, "a false cause"),
        (
            case.kind in ("single", "pair") and case.snr >= _CLEAR_SNR and not case.false_cause and beside,
            "unknown beside it",
        ),
        (case.kind == "mixed" and not beside, "nothing unknown"),
        (case.kind == "outside" and case.snr >= _STRONG_SNR and not beside, "nothing unknown"),
        (case.kind == "noise" and not answer.noise, "noise not found"),
        (bool(answer.error), "no answer"),
    ]
    return tuple(words for wrong, words in found if wrong)


def compared(before: Path, after: Path) -> Iterator[str]:
    """Yield a line for each case whose faults differ between two folders, and last how many have any.

    ConfigurationError if the folders have no case in common.
    """
    ours, theirs = ({case.name: case for case in marked_cases(folder)} for folder in (before, after))
    common = sorted(ours.keys() & theirs.keys())
    if not common:
        raise ConfigurationError(
            "the two folders have no answered case in common",
            where=f"{before}, {after}",
            expected="answers of two states of the code to the same cases",
            remedy="copy cases and sealed into a second folder and diagnose it with the other state",
        )
    wrong = [0, 0]
    for name in common:
        both = [faults(each[name]) for each in (ours, theirs)]
        wrong = [count + bool(own) for count, own in zip(wrong, both, strict=True)]
        if both[0] != both[1]:
            was, now = (", ".join(own) or "right" for own in both)
            yield f"{was} -> {now}: {details([theirs[name]])[0]}"
    yield f"{wrong[0]} of {len(common)} cases with a fault before, {wrong[1]} after"
