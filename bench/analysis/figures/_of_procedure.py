"""The uncertainty budget of what a procedure measured: air temperatures, shock rates, angles, outputs at rest.

Each follows from the measurement's definition in closed form. A temperature is what its sensor shows less the
sensor's error. A rate of change is a difference of two readings over the time between them; the sensor's errors
at both ends of a fall are independent, and over a part of the fall its error changes by that part. An output at
rest has the scatter of its 10 s means. Readings are rounded by the telemetry: the smallest step seen is the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bench.analysis.common.bench_errors import EAST_ORIGIN, BenchErrors
from bench.analysis.common.uncertainty import Budget, Contribution
from bench.record.benchfile import calibrations_of
from bench.record.events.run import Measured
from bench.record.recording import Run, seconds
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_BLOCK_S = 10.0
_LEAST_BLOCKS = 3
_PPM = 1e-6
_TENTH_TO_NINE = 0.8
"""Part of the fall between its 10 and 90 % points."""


@dataclass(frozen=True)
class _Taken:
    """A measurement and the stretch of its record that it was made of.

    That is the phase it was written down in, up to then; of a shock, which is judged in the soak, all since it
    began.
    """

    value: float
    start_s: float
    end_s: float
    run: Run
    bench: BenchErrors

    def air_c(self) -> Array:
        """Return what the chamber's air sensor showed, (n,)."""
        table = self.run.chamber(("air_temp_c",), self.start_s, self.end_s + 1e-9)
        return np.asarray(table["air_temp_c"], np.float64)

    def resolution(self, sensitivity: float, readings: int) -> Iterator[Contribution]:
        """Yield what rounding adds to so many readings of the air's temperature."""
        steps = np.diff(np.unique(self.air_c()))
        if len(steps):
            standard = float(steps.min()) * math.sqrt(readings / 12.0)
            yield Contribution(
                "air_reading_step_c",
                standard,
                sensitivity,
                "degC",
                distribution="rectangular",
                origin="telemetry",
            )


def procedure_budgets(run: Run) -> dict[str, Budget]:
    """Return the budget of every measurement of a run's procedure that has one, by its name.

    The units are those of the measurement. Of a name that was measured twice the last counts. Settings, counts
    and verdicts of a procedure have no budget, nor have the figures of a standard test here: those are figures
    (`standard_figures`).
    """
    doubt_deg = run.manifest.measured("azimuth_error_2_sigma")
    bench = BenchErrors(calibrations_of(run.manifest.bench), None if doubt_deg is None else 0.5 * doubt_deg)
    phases = run.phases()
    found: dict[str, Budget] = {}
    for at_s, item in run.of(Measured):
        rule = _rule_of(item)
        if rule is None or item.value is None or not math.isfinite(item.value):
            continue
        begun = [
            phase.start_s
            for phase in phases
            if phase.start_s < at_s and (phase.name == "shock" or not item.name.startswith("shock_"))
        ]
        start_s = begun[-1] if begun else 0.0
        with suppress(RecordError):  # a record without that table
            if inputs := tuple(rule(_Taken(item.value, start_s, at_s, run, bench))):
                found[item.name] = Budget(item.value, inputs)
    return found


def _rule_of(item: Measured) -> Callable[[_Taken], Iterator[Contribution]] | None:
    if item.name in _RULES:
        return _RULES[item.name]
    if item.name.startswith("heading_"):
        return _heading
    return _unit_temperature if item.name.endswith("_temperature") else None


def _rate_of_fall(taken: _Taken, over_c: Callable[[float], float]) -> Iterator[Contribution]:
    """rate = fall between two readings, `over_c` of the whole fall, over the time between them."""
    air_c = taken.air_c()
    fall_c = float(air_c[0] - air_c.min()) if len(air_c) else 0.0
    if fall_c > 0.0 and taken.value > 0.0:
        yield taken.bench.of("air_temp_c", taken.value / fall_c, difference=True)
        yield from taken.resolution(taken.value / over_c(fall_c), 2)
        yield taken.bench.of("time_base_ppm", taken.value * _PPM)


def _mean_rate_of_fall(taken: _Taken) -> Iterator[Contribution]:
    """From 10 to 90 % of the fall."""
    yield from _rate_of_fall(taken, lambda fall_c: _TENTH_TO_NINE * fall_c)


def _steepest_fall(taken: _Taken) -> Iterator[Contribution]:
    """Within 60 s: as many K as K/min."""
    yield from _rate_of_fall(taken, lambda _: taken.value)


def _air(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("air_temp_c", -1.0)
    yield from taken.resolution(1.0, 1)


def _unit_temperature(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("unit_temp_c", -1.0)


def _output(taken: _Taken) -> Iterator[Contribution]:
    """The mean of a unit's output: what its 10 s means scatter."""
    means = min(
        (_block_means_dph(taken, gyro) for gyro in taken.run.gyros),
        key=lambda each: abs(float(each.mean()) - taken.value) if len(each) else math.inf,
        default=np.zeros(0),
    )
    if len(means) >= _LEAST_BLOCKS:
        standard = float(means.std(ddof=1)) / math.sqrt(len(means))
        yield Contribution(
            "noise", standard, 1.0, "deg/h", kind="A", freedom=len(means) - 1, origin="10 s means"
        )


def _block_means_dph(taken: _Taken, gyro: str) -> Array:
    table = taken.run.gyro(gyro, ("time_ns", "rate_dps", "valid"), taken.start_s, taken.end_s)
    good = table["valid"].astype(np.bool_)
    block = ((seconds(table)[good] - taken.start_s) // _BLOCK_S).astype(np.int64)
    count = int((taken.end_s - taken.start_s) // _BLOCK_S)
    kept = block < count
    samples = np.bincount(block[kept], minlength=count)
    total = np.bincount(block[kept], table["rate_dps"][good][kept].astype(np.float64), count)
    return np.asarray(3600.0 * total[samples > 0] / samples[samples > 0])


def _azimuth(taken: _Taken) -> Iterator[Contribution]:
    """asin(difference of outputs over twice the Earth's horizontal rate): its doubt is measured beside it."""
    sigma_deg = taken.bench.azimuth_sigma_deg
    if sigma_deg is not None:
        yield Contribution("noise", sigma_deg, 1.0, "deg", kind="A", origin=EAST_ORIGIN)
        error = math.radians(taken.run.manifest.measured("azimuth_error") or 0.0)
        slope = math.tan(error) * math.tan(math.radians(taken.run.manifest.latitude_deg))
        yield taken.bench.of("latitude_deg", slope)
        yield taken.bench.of("table_angle_deg", -1.0)


def _east(taken: _Taken) -> Iterator[Contribution]:
    """The table's angle less the azimuth error; one that was too doubtful to be judged was not used."""
    errors = [item for _, item in taken.run.of(Measured) if item.name == "azimuth_error"]
    if errors and errors[-1].passed is None:
        yield BenchErrors(taken.bench.calibrations).of("azimuth_deg", -1.0)
        yield from _angle(taken)
    else:
        yield from _azimuth(taken)


def _angle(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("table_angle_deg", -1.0)


def _heading(taken: _Taken) -> Iterator[Contribution]:
    """The table's angle, and where north is on it."""
    yield from _angle(taken)
    yield taken.bench.of("azimuth_deg", -1.0)


def _rate(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("table_rate_ppm", -taken.value * _PPM)


_RULES: Mapping[str, Callable[[_Taken], Iterator[Contribution]]] = {
    "shock_rate_10_90": _mean_rate_of_fall,
    "shock_steepest_60s": _steepest_fall,
    "shock_lowest_air": _air,
    "air": _air,
    "found_air": _air,
    "reference_output": _output,
    "output_at_rest": _output,
    "azimuth_error": _azimuth,
    "east_table_angle": _east,
    "found_angle": _angle,
    "angle_error": _angle,
    "found_rate": _rate,
    "rate": _rate,
}
