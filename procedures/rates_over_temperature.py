"""Rates of both signs in turn, at room temperature and while the air ramps to its ends and back.

The axis is up. One run shows bias and scale factor over rate, temperature and its change: the rate
changes every minute, far faster than a unit warms through. IEEE Std 952 measures the scale factor at rates of
both signs and at several temperatures; here the temperatures are passed, not waited for.
"""

from __future__ import annotations

from itertools import cycle

from pydantic import model_validator

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from procedures._mounting import begin_axis_up
from procedures.thermal_ramp import go_to_end

_SETTLING_S = 5.0
"""For the table to be at its next rate."""


class RatesOverTemperatureParameters(Parameters):
    """The rates, and the profile."""

    max_rate_dps: float = parameter(20.0, "largest rate of both signs", "deg/s", gt=0, le=1000)
    rates_per_sign: int = parameter(1, "rates of each sign, evenly spaced", "", ge=1, le=50)
    rate_dwell_s: float = parameter(60.0, "dwell at each rate", "s", ge=10, le=3600)
    sequences: int = parameter(1, "times that all rates are made at room temperature", "", ge=1, le=100)
    over_temperature: bool = parameter(True, "go on with the rates while the air ramps to both ends and back")
    low_c: float = parameter(-40.0, "cold end", "degC", ge=-70, le=85)
    high_c: float = parameter(60.0, "hot end", "degC", ge=-70, le=125)
    ramp_k_per_min: float = parameter(1.0, "ramp demanded of the chamber", "K/min", gt=0, le=15)
    dwell_min: float = parameter(30.0, "dwell at each end", "min", ge=0, le=600)
    room_c: float = parameter(25.0, "chamber temperature before and after", "degC", ge=10, le=35)
    warm_up_min: float = parameter(60.0, "time from power-on to the first rate", "min", ge=0, le=600)

    @model_validator(mode="after")
    def _ends_are_apart(self) -> RatesOverTemperatureParameters:
        if self.over_temperature and self.low_c >= self.high_c:
            raise ValueError(f"low_c {self.low_c:g} degC must be below high_c {self.high_c:g} degC")
        return self

    def rates_dps(self) -> list[float]:
        """Return the rates in turn: rest, the positive ones rising, rest, the negative ones."""
        step = self.max_rate_dps / self.rates_per_sign
        sizes = [step * number for number in range(1, self.rates_per_sign + 1)]
        return [0.0, *sizes, 0.0, *(-size for size in sizes)]

    def legs(self) -> list[tuple[str, float, float]]:
        """Return the ramps in turn: phase, the air's end in degC, dwell there in minutes."""
        if not self.over_temperature:
            return []
        return [
            ("ramp_cold", self.low_c, self.dwell_min),
            ("ramp_hot", self.high_c, self.dwell_min),
            ("ramp_room", self.room_c, 0.0),
        ]


def run(bench: Bench, p: RatesOverTemperatureParameters) -> None:
    """Run the test."""
    with bench.step("1", "Axis up, power on, acquire"):
        bench.phase("warm_up")
        begin_axis_up(bench, p.room_c)
        bench.wait(60.0 * p.warm_up_min - bench.now_s, "warming up")

    in_turn = cycle(p.rates_dps())

    def next_rate() -> None:
        rate_dps = next(in_turn)
        bench.table.spin(rate_dps)
        bench.wait(p.rate_dwell_s, f"{rate_dps:+g} deg/s")

    with bench.step("2", f"Rates at {p.room_c:g} degC"):
        bench.phase("rates")
        for _ in range(p.sequences * len(p.rates_dps())):
            next_rate()

    for number, (phase, end_c, dwell_min) in enumerate(p.legs(), start=3):
        with bench.step(str(number), f"Rates on the ramp to {end_c:g} degC at {p.ramp_k_per_min:.3g} K/min"):
            bench.phase(phase)
            go_to_end(bench, end_c, p.ramp_k_per_min, next_rate)
            there_s = bench.now_s
            if dwell_min:
                bench.phase(f"dwell_{phase.removeprefix('ramp_')}")
            while bench.now_s - there_s < 60.0 * dwell_min:
                next_rate()

    with bench.step(str(len(p.legs()) + 3), "Close"):
        bench.phase("close")
        bench.table.stop()
        bench.chamber.stop()


def expected_duration_s(p: RatesOverTemperatureParameters) -> float:
    """Return the expected bench time."""
    at_room_s = p.sequences * len(p.rates_dps()) * (p.rate_dwell_s + _SETTLING_S)
    legs = p.legs()
    starts = [p.room_c, *(end_c for _, end_c, _ in legs)]
    ways_k = sum(abs(end_c - start_c) for start_c, (_, end_c, _) in zip(starts, legs, strict=False))
    dwells_min = sum(dwell_min for _, _, dwell_min in legs)
    return 60.0 * (p.warm_up_min + ways_k / p.ramp_k_per_min + dwells_min) + at_room_s


def demands(p: RatesOverTemperatureParameters) -> Demands:
    """Return the extremes of the run."""
    if not p.over_temperature:
        return Demands(max_rate_dps=p.max_rate_dps, min_temp_c=p.room_c, max_temp_c=p.room_c)
    return Demands(
        max_rate_dps=p.max_rate_dps,
        min_temp_c=min(p.low_c, p.room_c),
        max_temp_c=max(p.high_c, p.room_c),
        max_ramp_k_per_min=p.ramp_k_per_min,
    )


PROCEDURE = Procedure(
    name="rates-over-temperature",
    title="Rates of both signs in turn, at room temperature and on ramps to both ends, axis up",
    source="IEEE Std 952 scale factor test, temperatures passed on a ramp",
    parameters=RatesOverTemperatureParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=demands,
)
