"""The test plan of the gyro standards as one campaign: IEEE Std 952 (fibre optic), 647 (ring laser), GJB 2426A.

Axis horizontal: warm-up, bias, power cycles, noise, threshold and resolution by small turns against the Earth
rate, misalignment. Axis up: scale factor over rates of both signs, rising and falling, then bias and scale factor
at other temperatures. Every interval of measurement is an event; the figures are made of them afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Interval
from procedures._power import power_cycle
from procedures.thermal_ramp import go_to_end
from procedures.zero_bias_cold_shock import ZeroBiasParameters, find_east

_STEPS = 5
_RESOLUTION_DEG = 45.0
"""Angle from east at which resolution is tested: a large input that still changes with angle."""
_SETTLE_S = 20.0
_ROLLS_DEG = {"as_mounted": (0.0,), "reversed": (0.0, 180.0), "both": (0.0, 180.0, 90.0, 270.0)}
"""Positions about the input axis for its misalignment, right-handed from how the unit is mounted first."""
_EAST_BY_HAND = ("mems",)
"""Grades too noisy to find east by the Earth rate within the 2 deg that are accepted: it is what was mounted."""
_ALWAYS = (
    "bias",
    "bias stability, 10 s averages",
    "bias stability, 100 s averages",
    "warm-up time to 3 s_100",
    "threshold",
    "resolution",
    "input-axis misalignment, component along the table",
    "input-axis elevation, unit in its fixture",
    "scale factor",
    "scale-factor nonlinearity",
    "scale-factor asymmetry",
    "scale-factor hysteresis, rising and falling",
    "angle random walk",
    "bias instability",
    "quantisation",
    "rate random walk",
    "rate ramp",
    "Allan deviation, minimum",
)
"""Figures that every run of this test measures."""


@dataclass(frozen=True)
class Grade:
    """What a class of gyro needs: times in min, h and s, the smallest input step in deg/h, power cycles."""

    warm_up_min: float
    bias_min: float
    noise_h: float
    smallest_step_dph: float
    step_dwell_s: float
    power_cycles: int = 6


GRADES = {
    "fog": Grade(60.0, 60.0, 6.0, 0.01, 900.0),
    "rlg": Grade(60.0, 120.0, 12.0, 0.002, 1800.0),
    "mems": Grade(20.0, 30.0, 2.0, 0.6, 600.0),
}


class StandardTestParameters(Parameters):
    """What to test; what is not given follows from the grade."""

    grade: Literal["fog", "rlg", "mems"] = parameter("fog", "class of gyro: fog, rlg or mems")
    warm_up_min: float | None = parameter(None, "warm-up (not given: by grade)", "min", ge=10, le=600)
    bias_min: float | None = parameter(None, "bias record (not given: by grade)", "min", ge=10, le=1440)
    noise_h: float | None = parameter(
        None, "record for the Allan deviation (not given: by grade)", "h", ge=0.5, le=200
    )
    smallest_step_dph: float | None = parameter(
        None,
        "smallest input of threshold and resolution, doubled four times (not given: by grade)",
        "deg/h",
        gt=0,
        le=0.6,
    )
    step_dwell_s: float | None = parameter(
        None, "dwell at each input (not given: by grade)", "s", ge=60, le=7200
    )
    power_cycles: int | None = parameter(
        None,
        "switch off and on so often, with a bias record each (not given: 6, as GJB 2426A asks)",
        ge=0,
        le=20,
    )
    off_s: float = parameter(60.0, "time without power", "s", ge=5, le=7200)
    misalignment: Literal["as_mounted", "reversed", "both"] = parameter(
        "both",
        "as_mounted: one position, the fixture's error in it; reversed: turned by 180 deg in the fixture as "
        "well, free of it; both: four positions, both components",
    )
    max_rate_dps: float = parameter(20.0, "largest rate of the scale-factor test", "deg/s", gt=0, le=1000)
    rates_per_sign: int = parameter(11, "rates of each sign", "", ge=2, le=50)
    sequences: int = parameter(2, "rate sequences, for the repeatability", "", ge=1, le=20)
    rate_dwell_s: float = parameter(
        60.0, "least time at a rate, rounded up to whole turns", "s", ge=10, le=3600
    )
    temperatures: bool = parameter(True, "test bias and scale factor at low_c and high_c too")
    low_c: float = parameter(-40.0, "cold temperature", "degC", ge=-70, le=20)
    high_c: float = parameter(60.0, "hot temperature", "degC", ge=30, le=125)
    room_c: float = parameter(25.0, "room temperature", "degC", ge=10, le=35)
    soak_min: float = parameter(150.0, "soak at each temperature", "min", ge=10, le=1440)
    ramp_k_per_min: float = parameter(2.0, "ramp between temperatures", "K/min", gt=0, le=10)
    azimuth_deg: float = parameter(
        90.0, "table angle at which the axis should point east", "deg", ge=0, lt=360
    )

    def plan(self) -> Grade:
        """Return the grade's preset with what was given in its place."""
        preset = GRADES[self.grade]
        given = {name: getattr(self, name) for name in Grade.__dataclass_fields__}
        return Grade(
            **{name: getattr(preset, name) if value is None else value for name, value in given.items()}
        )

    def rates(self) -> list[float]:
        """Return one sequence: zero, up to the largest rate and back, the same to the other side, zero."""
        step = self.max_rate_dps / self.rates_per_sign
        up = [step * number for number in range(1, self.rates_per_sign + 1)]
        side = [*up, *up[-2::-1], 0.0]
        return [0.0, *side, *(-rate for rate in side)]

    def dwell_s(self, rate_dps: float) -> float:
        """Return the time at a rate: whole turns, so that errors that turn with the table cancel."""
        if rate_dps == 0.0:
            return self.rate_dwell_s
        turn_s = 360.0 / abs(rate_dps)
        return turn_s * math.ceil(self.rate_dwell_s / turn_s)


def run(bench: Bench, p: StandardTestParameters) -> None:
    """Run the campaign."""
    plan = p.plan()
    with bench.step("1", "Warm-up, axis east"):
        bench.phase("warm_up")
        _mount(bench, "axis_horizontal", f"horizontal, pointing east at table angle {p.azimuth_deg:g} deg")
        bench.table.engage()
        bench.table.point(p.azimuth_deg)
        bench.chamber.go_to(p.room_c)
        bench.chamber.start()
        _interval(bench, "warm_up", 60.0 * plan.warm_up_min)
        east = p.azimuth_deg
        if p.grade not in _EAST_BY_HAND:
            east = find_east(
                bench, ZeroBiasParameters(azimuth_deg=p.azimuth_deg, east_dwell_s=plan.step_dwell_s)
            )

    with bench.step("2", "Bias"):
        bench.phase("bias")
        _interval(bench, "bias", 60.0 * plan.bias_min, cycle=0)
        for cycle in range(1, plan.power_cycles + 1):
            power_cycle(bench, f"cycle {cycle} of {plan.power_cycles}", p.off_s)
            bench.wait(60.0 * plan.warm_up_min, "warming up")
            _interval(bench, "bias", 60.0 * plan.bias_min, cycle=cycle)
    with bench.step("3", "Noise"):
        bench.phase("noise")
        _interval(bench, "noise", 3600.0 * plan.noise_h)
    with bench.step("4", "Threshold and resolution"):
        bench.phase("threshold")
        small_steps(bench, "threshold", east, plan)
        bench.phase("resolution")
        small_steps(bench, "resolution", east + _RESOLUTION_DEG, plan)
    with bench.step("5", "Misalignment of the input axis"):
        bench.phase("misalignment")
        for roll_deg in _ROLLS_DEG[p.misalignment]:
            if roll_deg:
                _turn_over(bench, roll_deg)
            for sense in (1.0, -1.0):
                _at_rate(bench, p, "misalignment", sense * p.max_rate_dps, roll_deg=roll_deg)
            bench.table.stop()

    with bench.step("6", "Scale factor"):
        bench.phase("scale_factor")
        _mount(bench, "axis_up", "up along the table's axis, the cable through the slip ring")
        for sequence in range(1, p.sequences + 1):
            for rate in p.rates():
                _at_rate(bench, p, "scale_factor", rate, sequence=sequence)
    if p.temperatures:
        with bench.step("7", "Bias and scale factor over temperature"):
            over_temperature(bench, p)
    with bench.step("8", "Close"):
        bench.phase("close")
        bench.table.stop()
        bench.chamber.stop()


def small_steps(bench: Bench, test: str, angle_deg: float, plan: Grade) -> None:
    """Turn the axis by small angles from `angle_deg`, back in between, so that each step has its own zero."""
    horizontal_dph = bench.file.bench.earth_rate_north_dph
    # Output over azimuth near east + a: W cos(lat) cos(90 deg + a); its slope is W cos(lat) cos(a).
    from_east = math.radians(_RESOLUTION_DEG) if test == "resolution" else 0.0
    for number in range(_STEPS):
        step_dph = plan.smallest_step_dph * 2.0**number
        there = math.asin(min(1.0, math.sin(from_east) + step_dph / horizontal_dph))
        turned_deg = math.degrees(there - from_east)
        for sense, change in ((0, 0.0), (1, turned_deg), (0, 0.0)):
            bench.table.point((angle_deg + change) % 360.0, tolerance_deg=0.001)
            bench.wait(_SETTLE_S, "settling")
            _interval(bench, test, plan.step_dwell_s, step=number, input_dph=-sense * step_dph)


def over_temperature(bench: Bench, p: StandardTestParameters) -> None:
    """Soak at room, cold and hot; at each measure at rest and at the largest rate of both signs."""
    for temp_c in (p.room_c, p.low_c, p.high_c):
        bench.phase(f"temperature_{temp_c:g}")
        bench.table.stop()
        go_to_end(bench, temp_c, p.ramp_k_per_min)
        bench.wait(60.0 * p.soak_min, f"soak at {temp_c:g} degC")
        for rate in (0.0, p.max_rate_dps, -p.max_rate_dps):
            _at_rate(bench, p, "temperature", rate, longest=True, temp_c=temp_c)
    bench.phase("return")
    bench.table.stop()
    go_to_end(bench, p.room_c, p.ramp_k_per_min)


def _mount(bench: Bench, mounting: str, how: str) -> None:
    bench.ask(
        f"{bench.table.mounting_text}Mount the units with their sensitive axes {how}. Ready?",
        act="mount",
        mounting=mounting,
    )


def _turn_over(bench: Bench, roll_deg: float) -> None:
    bench.ask(
        f"{bench.table.mounting_text}Turn the units in their fixture about their sensitive axes, to "
        f"{roll_deg:g} deg from how they were mounted at first, clockwise seen along the axis. Ready?",
        act="mount",
        mounting="axis_horizontal",
        roll_deg=roll_deg,
    )


def _at_rate(
    bench: Bench,
    p: StandardTestParameters,
    test: str,
    rate_dps: float,
    *,
    longest: bool = False,
    **fields: float,
) -> None:
    bench.table.spin(rate_dps, across=test == "misalignment")  # what a level axis feels is its misalignment
    bench.wait(_SETTLE_S, "settling")
    dwell_s = p.dwell_s(rate_dps)
    if longest:
        turn_s = 360.0 / abs(rate_dps) if rate_dps else 1.0
        dwell_s = max(dwell_s, turn_s * math.ceil(600.0 / turn_s))
    _interval(bench, test, dwell_s, rate_dps=rate_dps, **fields)


def _interval(bench: Bench, test: str, duration_s: float, **fields: float) -> None:
    """Record for `duration_s`, then say from when to when and under what."""
    start_s = bench.now_s
    bench.wait(duration_s, test.replace("_", " "))
    bench.event(Interval(test, start_s, bench.now_s, **fields))


def expected_duration_s(p: StandardTestParameters) -> float:
    """Return the expected bench time."""
    plan = p.plan()
    total = 60.0 * (plan.warm_up_min + plan.bias_min) + 3600.0 * plan.noise_h + 4.0 * plan.step_dwell_s
    total += plan.power_cycles * (p.off_s + 60.0 * (plan.warm_up_min + plan.bias_min))
    total += 2 * _STEPS * 3 * (plan.step_dwell_s + _SETTLE_S + 10.0)
    total += len(_ROLLS_DEG[p.misalignment]) * 2 * (p.dwell_s(p.max_rate_dps) + 30.0)
    total += p.sequences * sum(p.dwell_s(rate) + _SETTLE_S + 10.0 for rate in p.rates())
    if p.temperatures:
        ramps = 2.0 * (p.high_c - p.low_c) / p.ramp_k_per_min
        total += 60.0 * (3 * p.soak_min + ramps) + 9 * 660.0
    return total


def demands(p: StandardTestParameters) -> Demands:
    """Return the extremes of the run."""
    return Demands(
        max_rate_dps=p.max_rate_dps,
        min_temp_c=p.low_c if p.temperatures else p.room_c,
        max_temp_c=p.high_c if p.temperatures else p.room_c,
        max_ramp_k_per_min=p.ramp_k_per_min,
    )


def figures(p: StandardTestParameters) -> set[str]:
    """Return the figures that such a run measures."""
    measured = set(_ALWAYS)
    if p.misalignment == "both":
        measured.add("input-axis misalignment, component across the table")
    if p.plan().power_cycles > 0:
        measured.add("bias repeatability")
    if p.sequences > 1:
        measured.add("scale-factor repeatability")
    if p.temperatures:
        measured |= {"bias temperature sensitivity", "scale-factor temperature sensitivity"}
    return measured


PROCEDURE = Procedure(
    name="standard-test",
    title="Test plan of the standards: bias, noise, threshold, scale factor, temperature",
    source="IEEE Std 952 / 647, GJB 2426A",
    parameters=StandardTestParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=demands,
    figures=figures,
)
