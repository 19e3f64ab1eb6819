"""The heading campaign: reduction of the heading sensitivity on held-out sequences, and the time it takes.

`python -m benchmarks.heading [plants]` prints the table, ours beside the design study's figures; `rows()`
gives the figures of the summary. Plants' noise and heading sequences of the tests are none of the
calibrations'. A platform that the fit refuses, since the measured temperature is not what drives it, counts
with 0 %.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.heading import HeadingCompensator, LaggedModel, PlatformLog, integrate
from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import fit_lagged
from bench.analysis.heading._nine import compensate_nine, fit_nine
from benchmarks._heading_plants import CALIBRATIONS, PlatformRun, fly, sequence, twin
from benchmarks._measure import Row, figure
from drivers.base.arrays import Array
from drivers.base.clock import host_seconds
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import ConfigurationError
from simulators.plant.space_stable import PlatformParameters, SpaceStablePlatform, draw_platform

Correction = Callable[[PlatformRun], Array]
DAY_S = SIDEREAL_DAY_S


@dataclass(frozen=True)
class Method:
    """A way to calibrate and correct; `study` are the design study's p10 and median."""

    name: str
    calibration: str
    fit: Callable[[PlatformRun], Correction]
    study: tuple[float | None, float | None] = (None, None)


def nine(window_s: float) -> Callable[[PlatformRun], Correction]:
    """Return the paper's form with that window."""

    def fit(run: PlatformRun) -> Correction:
        model = replace(fit_nine(run.log, window_s=window_s), reference=run.reference)
        return lambda other: compensate_nine(model, other.log)

    return fit


def lagged_form(form: str) -> Callable[[PlatformRun], Correction]:
    """Return the lagged model."""

    def fit(run: PlatformRun) -> Correction:
        model = fit_lagged(run.log, form, reference=run.reference)  # type: ignore[arg-type]  # two names
        HeadingCompensator(model)  # refuses here, before any test
        return lambda other: forward(model, other.log)

    return fit


def forward(model: LaggedModel, log: PlatformLog) -> Array:
    """Return the misalignment that the real-time compensation gives."""
    return HeadingCompensator(model).feed(log.time_s, log.sidereal_rad, log.temp_c).phi_as


def nothing(run: PlatformRun) -> Array:
    """Return no correction, which is what a refusal amounts to."""
    return np.zeros((len(run.log.time_s), 3))


def oracle(run: PlatformRun) -> Correction:
    """Return the true drift that temperature makes."""
    return lambda other: integrate(other.log.time_s, other.truth.thermal_dph)


METHODS = (
    Method("paper: 24 h window, nine equations", "3+1", nine(DAY_S), (-170, 34)),
    Method("paper: 24 h window, least squares", "5+1", nine(DAY_S), (-27, 56)),
    Method("paper's form, 36 h, nine equations", "3+1", nine(1.5 * DAY_S), (-30, 61)),
    Method("paper's form, 36 h, least squares", "5+1", nine(1.5 * DAY_S), (32, 69)),
    Method("LAG9", "3+1", lagged_form("lag9"), (84, 94.1)),
    Method("LAG9", "5+1", lagged_form("lag9"), (86, 94.9)),
    Method("LAG15", "5+1", lagged_form("lag15"), (89, 95.3)),
    Method("LAG15", "12+1", lagged_form("lag15"), (90, 95.7)),
    Method("oracle (true thermal drift)", "5+1", oracle, (91, 96.9)),
)


def reductions(
    draw: Callable[[int], PlatformParameters],
    method: Method,
    plants: int,
    tests: tuple[int, ...] = (0, 1, 2, 3),
) -> tuple[Array, Array]:
    """Return (reduction in %, heading-induced position error left in arcmin) over plants x tests."""
    percent, left = [], []
    for seed in range(plants):
        parameters = draw(seed)
        try:
            correct = method.fit(fly(parameters, 10_000 + seed, CALIBRATIONS[method.calibration]))
        except ConfigurationError:  # not driven by the temperature that is measured: left as it is
            correct = nothing
        for test in tests:
            stays, noise = sequence(test, seed), 20_000 + 10 * seed + test
            run, still = fly(parameters, noise, stays), twin(parameters, noise, stays)
            before, after = differences(run, still, correct(run) - correct(still))
            percent.append(100.0 * (1.0 - after / before))
            left.append(after / 60.0)
    return np.array(percent), np.array(left)


def differences(run: PlatformRun, still: PlatformRun, made: Array) -> tuple[float, float]:
    """Return rms of the heading's position error before and after, arcsec: run less its twin that stayed."""
    north, east = run.log.north_as - still.log.north_as, run.log.east_as - still.log.east_as
    own = position_error(made, run.log.sidereal_rad, run.log.latitude_deg)
    return rms(north, east), rms(north - own[0], east - own[1])


def rms(north: Array, east: Array) -> float:
    """Return the rms of both channels together."""
    return float(np.sqrt(np.mean(north**2 + east**2)))


def timing() -> tuple[float, float]:
    """Return (fit, compensation) of 200 h at a sample a minute, s."""
    platform = SpaceStablePlatform(draw_platform(3), 5, 60.0)
    platform.advance(np.zeros(240 * 60))
    platform.align()
    heading = np.concatenate([np.full(60 * 50, 90.0 * k) for k in range(4)])
    made = platform.advance(heading)
    log = PlatformLog(
        made.time_s, made.angle_rad, made.north_as, made.east_as, made.temp_c, made.heading_deg, 40.0
    )
    begin = host_seconds()
    model = fit_lagged(log)
    fitted = host_seconds()
    forward(model, log)
    return fitted - begin, host_seconds() - fitted


def rows() -> list[Row]:
    """Return the summary's figures: medians and 10th percentiles against the issue's demands, and the
    time."""
    percent, _ = reductions(draw_platform, METHODS[5], 12)
    paper, _ = reductions(draw_platform, METHODS[3], 12)
    fit_s, run_s = timing()
    figures = (
        ("heading effect, LAG9 5+1, median reduction", float(np.median(percent)), 90.0, "demanded", "%"),
        (
            "heading effect, LAG9 5+1, 10th percentile",
            float(np.percentile(percent, 10)),
            80.0,
            "demanded",
            "%",
        ),
        (
            "heading effect, LAG9 5+1, rest",
            100 - float(np.median(percent)),
            100 - float(np.median(paper)),
            "paper's form, 36 h",
            "%",
        ),
        ("heading effect, fits and runs of 200 h in a second", 1.0 / (fit_s + run_s), 1.0, "demanded", "1/s"),
    )
    return [figure(*row, least=row[0].endswith("rest")) for row in figures]


def main(plants: int) -> None:
    """Print the table."""
    print(f"{plants} plants x 4 tests, 1e-3 deg/h; in brackets the design study's figures")
    print(
        f"{'method':44} {'calibration':11} {'p10':>12} {'p25':>5} {'median':>13} {'p90':>5} "
        f"{'left, arcmin':>12}"
    )
    for method in METHODS:
        line(method.name, method, draw_platform, plants)
    lag = METHODS[5]
    line(
        "LAG9, effect 3e-4", replace(lag, study=(67, 86)), lambda s: draw_platform(s, effect_dph=3e-4), plants
    )
    for name, study, structure in (
        ("second pole 2 h, withheld", (76, 91), {"second_pole_h": 2.0}),
        ("hidden gradient, 11 %", (67, 89), {"gradient_share": 0.11}),
        ("hidden gradient, 29 %", (40, 82), {"gradient_share": 0.29}),
        ("core 12 h", (77, 94), {"core_tau_h": 12.0}),
    ):

        def draw(seed: int, structure: dict[str, float] = structure) -> PlatformParameters:
            return draw_platform(seed, **structure)  # type: ignore[arg-type]  # numbers by name

        line(f"LAG9, {name}", replace(lag, study=study), draw, plants)
        line(f"LAG15, {name}", replace(METHODS[6], study=(None, None)), draw, plants)
    line(
        "LAG9, short calibration 96 h",
        replace(lag, calibration="96 h", study=(None, None)),
        draw_platform,
        plants,
    )
    fit_s, run_s = timing()
    print(f"200 h at 1 sample/min: fit {fit_s:.3f} s, compensation {run_s:.3f} s")


def line(name: str, method: Method, draw: Callable[[int], PlatformParameters], plants: int) -> None:
    """Print one row."""
    percent, left = reductions(draw, method, plants)
    p10, p25, median, p90 = np.percentile(percent, [10, 25, 50, 90])
    known = ["" if error is None else f" ({error:g})" for error in method.study]
    print(
        f"{name:44} {method.calibration:11} {f'{p10:.0f}{known[0]}':>12} {p25:5.0f} "
        f"{f'{median:.1f}{known[1]}':>13} "
        f"{p90:5.0f} {np.sqrt(np.mean(left**2)):8.2f}",
        flush=True,
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
