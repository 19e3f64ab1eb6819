"""Whirl: by how much the tilt of a bearing that was not foreseen falls, and what is said where it does not.

    python -m benchmarks.off_class.whirl [--family NAME]
    python -m benchmarks.off_class.whirl --own-units N      # what is said of bearings of the class's own

Fitted on one run, judged on another by the true tilt of the bearing about its mean. The noise of the gyros allows
about 280 times (first line of the table). The class's own bearings are those of the emulated lab, with its table
and gyros, whose biases wander: 28 turns, a reversal every four.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.whirl import study_whirl
from bench.analysis.whirl._angle import Alignment
from bench.analysis.whirl._runs import Turns
from benchmarks._measure import Row, figure, usual
from benchmarks.off_class._bearings import FAMILIES, record
from benchmarks.whirl_runs import Plan, emulate, reversing
from simulators.plant.wobble import nominal_wobble

_ALIGNED = Alignment(None, 0.0, None, None, 0.0, 0)
_OF_BEARING = ("line", "change", "sense", "repeat")
GOAL = 100.0


@dataclass(frozen=True)
class Outcome:
    """Rms of the tilt about its mean before and after, arcsec; the findings that speak of lines or of the fit."""

    before_arcsec: float
    after_arcsec: float
    findings: tuple[str, ...]

    @property
    def factor(self) -> float:
        """By how many times it fell."""
        return self.before_arcsec / self.after_arcsec


def examine(family: str) -> Outcome:
    """Fit on one run of a bearing, judge on another."""
    fitted, _ = record(FAMILIES[family], 1)
    judged, truth = record(FAMILIES[family], 2)
    turns = [Turns(fitted, _ALIGNED, ()), Turns(judged, _ALIGNED, ())]
    study = study_whirl(turns[:1], turns[1:], gauge="mean")
    left = truth - study.compensation.tilt_arcsec(judged.angle_rad)
    before, after = (float(np.sqrt(np.mean(np.abs(x - x.mean()) ** 2) / 2.0)) for x in (truth, left))
    told = tuple(finding.text for finding in study.findings if finding.code != "level")
    return Outcome(before, after, told)


def own_units(units: int) -> tuple[int, tuple[str, ...]]:
    """Return of how many of the emulated lab's bearings lines, changes or differences were found, and what."""
    said: list[str] = []
    wrong = 0
    for unit in range(units):
        pair = (Plan(reversing(28, 4, 6.0), nominal_wobble(unit), 10 * unit + k, rate_hz=50) for k in (1, 2))
        fitted, judged = (Turns(emulate(plan)[0], _ALIGNED, ()) for plan in pair)
        found = [
            f.text for f in study_whirl([fitted], [judged], gauge="mean").findings if f.code in _OF_BEARING
        ]
        wrong += bool(found)
        said += found
    return wrong, tuple(said)


def rows() -> Iterator[Row]:
    """Return by how many times the tilt fell, family by family."""
    for family in FAMILIES:
        outcome = examine(family)
        told = f"{len(outcome.findings)} findings"
        yield figure(f"whirl, {family}, {told}", outcome.factor, GOAL, "goal, or a finding", "times less")
    units = usual(10, 2)
    wrong, _ = own_units(units)
    yield figure(
        f"whirl, findings on {units} bearings of the class", wrong, 1.0, "at most", "units", least=True
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--family", action="append", choices=tuple(FAMILIES), help="default all")
    parser.add_argument("--own-units", type=int, default=0, help="examine so many of the class's own instead")
    asked = parser.parse_args(arguments)
    if asked.own_units:
        wrong, said = own_units(asked.own_units)
        print(f"{wrong} of {asked.own_units} bearings with a finding", *said, sep="\n")
        return
    print("| bearing | before, arcsec | after | times less | findings |\n|---|---|---|---|---|")
    for family in asked.family or FAMILIES:
        o = examine(family)
        print(
            f"| {family} | {o.before_arcsec:.2f} | {o.after_arcsec:.4f} | {o.factor:.0f} | "
            f"{'; '.join(o.findings) or 'none'} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
