"""The uncertainty budget of every figure of a standard test: the unit's noise, and what is known of the bench.

Each input is the error of an instrument, what it shows less what is true: as its certificate has it, or assumed
of a class and named so. The sensitivities follow from the figures' definitions in closed form:
bias = output - W cos(lat) cos(azimuth) cos(elevation) - W sin(lat) sin(elevation), scale factor = output over
(angle over time) / cos(axis to axis), input of a small turn = W cos(lat) times a difference of sines.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from bench.analysis.common.bench_errors import ASSUMED_ORIGIN, BenchErrors
from bench.analysis.common.quantiles import student
from bench.analysis.common.uncertainty import COVERAGE, Budget, Contribution
from bench.analysis.figures._estimate import TWO_SIDED
from bench.analysis.figures._parts import (
    ELEVATION,
    MISALIGNMENT_ACROSS,
    MISALIGNMENT_ALONG,
    Figure,
    turned_over,
)
from bench.analysis.figures._record import Measured
from drivers.base.constants import EARTH_RATE_DPH, earth_rate_north_dph, earth_rate_up_dph

_RAD = math.pi / 180.0
_PPM = 1e-6
_TIME_POWER = {"angle random walk": 0.5, "quantisation": 1.0, "rate random walk": -0.5, "rate ramp": -1.0}
"""With which power of the averaging time a coefficient of given Allan deviation grows (IEEE Std 952, annex C)."""


def with_budgets(figures: Sequence[Figure], record: Measured, bench: BenchErrors) -> list[Figure]:
    """Return the figures corrected and with intervals that hold what the bench adds, each with its budget.

    `figures` have the intervals of their noise. Where those lie evenly about the value, the interval is that
    of the budget; else the bench's share is added to either side in squares (MOVER). A figure without an
    interval stays as it is.
    """
    by_name = {figure.name: figure for figure in figures}
    walk = by_name.get("angle random walk")
    freedom = math.inf
    if walk is not None and walk.seen and walk.standard_error > 0.0:
        freedom = 0.5 * (walk.value / walk.standard_error) ** 2  # JCGM 100, G.3
    return [_with_budget(figure, by_name, record, bench, freedom) for figure in figures]


def _with_budget(
    figure: Figure, by_name: Mapping[str, Figure], record: Measured, bench: BenchErrors, freedom: float
) -> Figure:
    if figure.low is None or figure.high is None:
        return figure
    repeats = math.isfinite(figure.freedom)
    divisor = student(0.5 + 0.5 * COVERAGE, figure.freedom) if repeats else TWO_SIDED
    noise = Contribution(
        "noise",
        (figure.high - figure.low) / (2.0 * divisor),
        unit=figure.unit,
        kind="A",
        freedom=figure.freedom if repeats else freedom,
        origin="repeats" if repeats else "noise record",
    )
    of_bench = tuple(_of_bench(figure, by_name, record, bench))
    budget = Budget(figure.value, (noise, *of_bench))
    below, above = figure.value - figure.low, figure.high - figure.value
    if math.isclose(below, above, rel_tol=1e-6):
        below = above = budget.half_width
    else:
        added = Budget(0.0, of_bench).half_width
        below, above = math.hypot(below, added), math.hypot(above, added)
    low, high = budget.value - below, budget.value + above
    if figure.low >= 0.0 and not math.isclose(figure.low + figure.high, 2.0 * figure.value, rel_tol=1e-6):
        low = max(low, 0.0)  # a magnitude
    seen = figure.seen and (figure.name == "bias" or low > 0.0 or high < 0.0)
    return replace(figure, value=budget.value, low=low, high=high, seen=seen, budget=budget)


def _of_bench(
    figure: Figure, by_name: Mapping[str, Figure], record: Measured, bench: BenchErrors
) -> Iterator[Contribution]:
    name, value = figure.name, figure.value
    latitude = record.latitude_deg * _RAD
    north, up = earth_rate_north_dph(record.latitude_deg), earth_rate_up_dph(record.latitude_deg)
    per_degree = {
        part: found.value
        for part in ("bias", "scale-factor")
        if (found := by_name.get(f"{part} temperature sensitivity")) is not None and found.seen
    }
    if name == "bias":
        azimuth = record.azimuth_deg(record.needed("bias")[0]) * _RAD
        lies, sine = by_name.get(ELEVATION), 0.0
        if lies is None:
            yield bench.of("fixture_deg", -up * _RAD)
        else:
            sine = math.sin(lies.value * _RAD)
            yield Contribution("input_axis_deg", lies.standard_error, -up * _RAD, "deg", sine / _RAD, "A",
                               origin="misalignment test")  # fmt: skip
        yield bench.of("table_level_deg", -up * _RAD)
        yield bench.of("azimuth_deg", -north * math.sin(azimuth) * _RAD)
        of_latitude = EARTH_RATE_DPH * (math.cos(latitude) * sine - math.sin(latitude) * math.cos(azimuth))
        yield bench.of("latitude_deg", of_latitude * _RAD)
        if "bias" in per_degree:
            yield bench.of("unit_temp_c", per_degree["bias"], signed=False)
    elif name == "scale factor":
        yield bench.of("time_base_ppm", -value * _PPM)
        yield bench.of("table_rate_ppm", value * _PPM)
        yield _cosine(by_name, bench, value)
        if "scale-factor" in per_degree:
            yield bench.of("unit_temp_c", value * _PPM * per_degree["scale-factor"], signed=False)
    elif name in (ELEVATION, MISALIGNMENT_ALONG, MISALIGNMENT_ACROSS):
        slope = math.tan(value * _RAD) / _RAD * _PPM
        if name != ELEVATION:
            # turned over it is half the difference of two seats in the same fixture
            over = 180.0 in turned_over(record.intervals("misalignment"))
            yield (
                bench.of("fixture_seat_deg", 0.5, difference=True) if over else bench.of("fixture_deg", -1.0)
            )
        yield bench.of("time_base_ppm", -slope)
        yield bench.of("table_rate_ppm", slope)
    elif name in ("threshold", "resolution"):
        steps = [step for step in record.intervals(name) if step.input_dph]
        azimuth = (
            record.azimuth_deg(min(steps, key=lambda step: abs(abs(step.input_dph or 0.0) - value))) * _RAD
        )
        yield bench.of("table_angle_deg", north * math.sin(azimuth) * _RAD, difference=True)
        yield bench.of("latitude_deg", value * math.tan(latitude) * _RAD)
        yield bench.of("azimuth_deg", -value / math.tan(azimuth) * _RAD)
    elif name.endswith("temperature sensitivity"):
        temps = [record.temp_c(item) for item in record.intervals("temperature")]
        span = min((abs(temp - temps[0]) for temp in temps if abs(temp - temps[0]) >= 1.0), default=math.inf)
        yield bench.of("unit_temp_c", value / span, difference=True)
    elif name in _TIME_POWER:
        yield bench.of("time_base_ppm", -_TIME_POWER[name] * value * _PPM)
    elif name.startswith("warm-up"):
        yield bench.of("time_base_ppm", -value * _PPM)


def _cosine(by_name: Mapping[str, Figure], bench: BenchErrors, scale_factor: float) -> Contribution:
    """Return what the angle between input axis and table takes off the scale factor, 1 - cos, in ppm.

    Half the sum of the squares of its two components m + d: m the unit's misalignment, d what fixture and table
    add, normal with standard deviation s. Its mean is |m|^2 / 2 + s^2, its variance |m|^2 s^2 + s^4; without m it
    is exponential. A component that was not measured is taken for a draw of the size of the one that was.
    """
    parts = [bench.of(name, 1.0).standard for name in ("fixture_deg", "table_wobble_deg")]
    along, across = by_name.get(MISALIGNMENT_ALONG), by_name.get(MISALIGNMENT_ACROSS)
    known, shape = 0.0, "exponential"
    if along is not None and across is not None:
        known = math.hypot(along.value, across.value) * _RAD
    elif along is not None:
        parts.append(along.value)
    size = math.hypot(*parts) * _RAD
    if known > size:
        shape = "normal"
    ppm, standard = (0.5 * known**2 + size**2) / _PPM, size * math.hypot(known, size) / _PPM
    return Contribution("axis_cosine_ppm", standard, scale_factor * _PPM, "ppm", ppm, distribution=shape,
                        origin="misalignment test" if along else ASSUMED_ORIGIN)  # fmt: skip
