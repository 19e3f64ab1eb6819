"""Heading effect: what a fitted compensation leaves on platforms of other physics, and when it refuses.

    python -m benchmarks.off_class.heading [--plants N] [--second]

With --second the fit may use each platform's second sensor, where stays left out say so. A platform that the
fit refuses is left as it is: 0 %. Harm is a sequence that the compensation made worse.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.heading import HeadingCompensation, HeadingCompensator, LaggedModel, fit_reference
from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import choose_input, fit_lagged
from benchmarks._heading_plants import CALIBRATIONS, sequence
from benchmarks._measure import Row, figure, usual
from benchmarks.off_class._heading_plants import FAMILIES, Drift, Flight, fly
from drivers.base.errors import BenchError

TESTS = (0, 1, 2, 3)
GOALS = {"median": 88.0, "p10": 65.0}


@dataclass(frozen=True)
class Outcome:
    """Reductions in % of every sequence of the platforms accepted, and what the true drift would give; how many
    platforms were refused of how many, and warned of; how many sequences reached what was told at least;
    on how many platforms a second sensor was used."""

    family: str
    reductions: tuple[float, ...]
    limits: tuple[float, ...]
    refused: int
    platforms: int
    warned: int
    told: int
    used: int

    @property
    def harm(self) -> int:
        """Sequences made worse."""
        return sum(value < 0.0 for value in self.reductions)

    def percentile(self, share: float) -> float:
        """Return a percentile of the reductions, NaN where all were refused."""
        return float(np.percentile(self.reductions, share)) if self.reductions else float("nan")


def examine(family: str, plants: int, *, second: bool = False) -> Outcome:
    """Calibrate on five headings beside the reference, judge on four sequences of others."""
    drift, found, limits, refused, warned, told, used = FAMILIES[family], [], [], 0, 0, 0, 0
    for seed in range(plants):
        calibration = fly(drift, seed, 10_000 + seed, CALIBRATIONS["5+1"])
        try:
            reference = fit_reference(calibration.warm_angle_rad, calibration.warm_temp_c)
            choice = choose_input(calibration.log, reference=reference) if second else None
            kind = choice.kind if choice else None
            used += kind is not None
            model = fit_lagged(calibration.log, reference=reference, second=kind)
            HeadingCompensation.from_fit(model, "", {}).stream("")
        except BenchError:
            refused += 1
            continue
        warned += model.evidence.mixed
        for test in TESTS:
            reached, limit = reduction(drift, model, seed, test)
            found.append(reached)
            limits.append(limit)
            told += reached >= model.evidence.least_reduction_percent
    return Outcome(family, tuple(found), tuple(limits), refused, plants, warned, told, used)


def reduction(drift: Drift, model: LaggedModel, seed: int, test: int) -> tuple[float, float]:
    """Return the reductions in % on a sequence by the model and by the true drift, run less its twin that does
    not turn."""
    stays, noise = sequence(test, seed), 20_000 + 10 * seed + test
    run, still = fly(drift, seed, noise, stays), fly(drift, seed, noise, stays, turned=False)
    north, east = run.log.north_as - still.log.north_as, run.log.east_as - still.log.east_as
    before = np.mean(north**2 + east**2)
    found = []
    for made in (_made(model, run) - _made(model, still), run.thermal_as - still.thermal_as):
        own = position_error(made, run.log.sidereal_rad, run.log.latitude_deg)
        after = np.mean((north - own[0]) ** 2 + (east - own[1]) ** 2)
        found.append(float(100.0 * (1.0 - np.sqrt(after / before))))
    return found[0], found[1]


def _made(model: LaggedModel, flight: Flight) -> np.ndarray:
    log = flight.log
    return HeadingCompensator(model).feed(log.time_s, log.sidereal_rad, log.temp_c, log.second_c).phi_as


def rows() -> Iterator[Row]:
    """Return median and 10th percentile of the reduction, family by family, and how often harm was done."""
    harm = 0
    for family in FAMILIES:
        outcome = examine(family, usual(12, 4))
        harm += outcome.harm
        told = f"{family}, {outcome.refused} of {outcome.platforms} refused"
        for name, share in (("median", 50.0), ("p10", 10.0)):
            value = outcome.percentile(share)
            if np.isfinite(value):
                yield figure(f"heading, {told}, {name}", value, GOALS[name], "goal", "% less")
    yield figure(
        "heading, sequences made worse, all families", float(harm), 0.0, "goal", "sequences", least=True
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--plants", type=int, default=12)
    parser.add_argument("--second", action="store_true", help="give the fit each platform's second sensor")
    asked = parser.parse_args(arguments)
    print(
        "| family | refused | warned | median | p10 | worst | made worse | as told | true drift, median | "
        "second used |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )
    for family in FAMILIES:
        o = examine(family, asked.plants, second=asked.second)
        print(
            f"| {family} | {o.refused} of {o.platforms} | {o.warned} | {o.percentile(50):.1f} | "
            f"{o.percentile(10):.1f} | {o.percentile(0):.1f} | {o.harm} | {o.told} of {len(o.reductions)} | "
            f"{np.median(o.limits) if o.limits else float('nan'):.1f} | {o.used} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
