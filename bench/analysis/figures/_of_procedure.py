"""The uncertainty budget of what a procedure measured: air temperatures, shock rates, angles, outputs at rest.

The procedure says what each number rests on (`Basis`), and its inputs follow in closed form. A temperature is
what its sensor shows less the sensor's error. A rate of change is a difference of two readings over the time
between them; the sensor's errors at both ends of a fall are independent, and over a part of the fall its error
changes by that part. An output at rest has the scatter of its 10 s means. Readings are rounded by the telemetry:
the smallest step seen is the step.
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
from bench.record.events.run import Basis, Measured, Source, labels
from bench.record.recording import Run, seconds
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_BLOCK_S = 10.0
_LEAST_BLOCKS = 3
_PPM = 1e-6


@dataclass(frozen=True)
class _Taken:
    """A measurement and the stretch of its record that it was made of."""

    value: float
    unit: str
    gyro: str | None
    basis: Basis
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
    """Return the budget of every measurement of a run's procedure that says what it rests on, by its name.

    The units are those of the measurement. Where several gyros have one of that name it is "name of gyro";
    of one that was measured twice the last counts. Settings, counts
    and verdicts of a procedure have no budget, nor have the figures of a standard test here: those are figures
    (`standard_figures`).
    """
    doubt_deg = run.manifest.measured("azimuth_error_2_sigma")
    bench = BenchErrors(calibrations_of(run.manifest.bench), None if doubt_deg is None else 0.5 * doubt_deg)
    phases = run.phases()
    found: dict[str, Budget] = {}
    measured = run.of(Measured)
    for (at_s, item), label in zip(measured, labels([each for _, each in measured]), strict=True):
        basis = item.basis
        if basis is None or item.value is None or not math.isfinite(item.value):
            continue
        start_s = basis.since_s
        if start_s is None:
            start_s = max((phase.start_s for phase in phases if phase.start_s < at_s), default=0.0)
        taken = _Taken(item.value, item.unit, item.gyro, basis, start_s, at_s, run, bench)
        with suppress(RecordError):  # a record without that table
            if inputs := tuple(_inputs(taken)):
                found[label] = Budget(item.value, inputs)
    return found


def _inputs(taken: _Taken) -> Iterator[Contribution]:
    basis = taken.basis
    if basis.standard_error is not None:
        error = basis.standard_error
        yield Contribution("noise", error, 1.0, taken.unit, kind="A", origin="the procedure")
    if basis.of is not None:
        yield from _RULES[basis.of](taken)
    for quantity, sensitivity in basis.inputs.items():
        yield taken.bench.of(quantity, sensitivity)


def _rate_of_fall(taken: _Taken) -> Iterator[Contribution]:
    """rate = fall between two readings, a part of the whole fall, over the time between them."""
    air_c = taken.air_c()
    fall_k = float(air_c[0] - air_c.min()) if len(air_c) else 0.0
    if fall_k > 0.0 and taken.value > 0.0:
        change_k = taken.basis.change_k or fall_k
        yield taken.bench.of("air_temp_c", taken.value / fall_k, difference=True)
        yield from taken.resolution(taken.value / change_k, 2)
        yield taken.bench.of("time_base_ppm", taken.value * _PPM)


def _air(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("air_temp_c", -1.0)
    yield from taken.resolution(1.0, 1)


def _unit_temperature(taken: _Taken) -> Iterator[Contribution]:
    yield taken.bench.of("unit_temp_c", -1.0)


def _output(taken: _Taken) -> Iterator[Contribution]:
    """The mean of a gyro's output: what its 10 s means scatter."""
    if taken.gyro is None or taken.gyro not in taken.run.gyros:
        return
    means = _block_means_dph(taken, taken.gyro)
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


_RULES: Mapping[Source, Callable[[_Taken], Iterator[Contribution]]] = {
    "air_temperature": _air,
    "air_rate": _rate_of_fall,
    "unit_temperature": _unit_temperature,
    "gyro_output": _output,
    "axis_azimuth": _azimuth,
    "east_angle": _east,
    "table_angle": _angle,
    "table_rate": _rate,
    "heading": _heading,
}
