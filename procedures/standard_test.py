"""The test plan of the gyro standards as one campaign: IEEE Std 952 (fibre optic), 647 (ring laser), GJB 2426A.

Axis horizontal: warm-up, bias, power cycles, noise, threshold and resolution by small turns against the Earth
rate, misalignment. Axis up: scale factor over rates of both signs, rising and falling, then bias and scale factor
at other temperatures. Every interval of measurement is an event; the figures are made of them afterwards. How
long and how often the small turns and the rates are dwelt at follows from the noise that the test has measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from bench.control.procedure import Demands, Procedure
from bench.control.session import Bench
from bench.record.events.run import Interval, Series
from procedures._by_noise import AtRest
from procedures._power import power_cycle
from procedures._standard_plan import EAST_BY_HAND, SETTLE_S, Dwell, Plan, StandardTestParameters
from procedures.thermal_ramp import go_to_end
from procedures.zero_bias_cold_shock import ZeroBiasParameters, find_east

_RESOLUTION_DEG = 45.0
"""Angle from east at which resolution is tested: a large input that still changes with angle."""
_PIECE_S = 300.0
"""A record at rest is taken in pieces: the bench holds the last 65,536 arrivals of a stream."""
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


def run(bench: Bench, p: StandardTestParameters) -> None:
    """Run the campaign."""
    plan = Plan.of(p)
    grade = plan.grade
    with bench.step("1", "Warm-up, axis east"):
        bench.phase("warm_up")
        _mount(bench, "axis_horizontal", f"horizontal, pointing east at table angle {p.azimuth_deg:g} deg")
        bench.table.engage()
        bench.table.point(p.azimuth_deg)
        bench.chamber.go_to(p.room_c)
        bench.chamber.start()
        _measure(bench, plan.warm_up)
        east_deg = p.azimuth_deg
        if p.grade not in EAST_BY_HAND:
            search = ZeroBiasParameters(azimuth_deg=p.azimuth_deg, east_dwell_s=grade.east_dwell_s)
            east_deg = find_east(bench, search)

    with bench.step("2", "Bias"):
        bench.phase("bias")
        for dwell in plan.bias():
            if cycle := dwell.fields["cycle"]:
                power_cycle(bench, f"cycle {cycle} of {grade.power_cycles}", p.off_s)
                bench.wait(60.0 * grade.warm_up_min, "warming up")
            _measure(bench, dwell)
    with bench.step("3", "Noise"):
        bench.phase("noise")
        plan = plan.after(_record_noise(bench, plan.noise))
        _tell(bench, plan)
    with bench.step("4", "Threshold and resolution"):
        for test, from_deg in (("threshold", east_deg), ("resolution", east_deg + _RESOLUTION_DEG)):
            bench.phase(test)
            small_inputs(bench, from_deg, plan.small_inputs(test))
    with bench.step("5", "Misalignment of the input axis"):
        bench.phase("misalignment")
        roll_deg = 0.0
        for dwell in plan.misalignment():
            if dwell.fields["roll_deg"] != roll_deg:
                roll_deg = dwell.fields["roll_deg"]
                bench.table.stop()
                _turn_over(bench, roll_deg)
            _at_rate(bench, dwell)
        bench.table.stop()

    with bench.step("6", "Scale factor"):
        bench.phase("scale_factor")
        _mount(bench, "axis_up", "up along the table's axis, the cable through the slip ring")
        for dwell in plan.scale_factor():
            _at_rate(bench, dwell)
    if p.temperatures:
        with bench.step("7", "Bias and scale factor over temperature"):
            over_temperature(bench, p, plan.temperature())
    with bench.step("8", "Close"):
        bench.phase("close")
        bench.table.stop()
        bench.chamber.stop()


def small_inputs(bench: Bench, from_deg: float, dwells: Iterable[Dwell]) -> None:
    """Turn the axis by small angles from `from_deg`, back in between, so that each input has its own zero.

    Output over azimuth near east + a: W cos(lat) cos(90 deg + a); its slope is W cos(lat) cos(a).
    """
    for dwell in dwells:
        from_east = math.radians(_RESOLUTION_DEG) if dwell.test == "resolution" else 0.0
        turned, input_dph = turned_for(
            dwell.fields["input_dph"], from_east, bench.file.bench.earth_rate_north_dph
        )
        bench.table.point((from_deg + math.degrees(turned)) % 360.0, tolerance_deg=0.001)
        bench.wait(SETTLE_S, "settling")
        _measure(bench, replace(dwell, fields={**dwell.fields, "input_dph": input_dph}))


def turned_for(input_dph: float, from_east: float, horizontal_dph: float) -> tuple[float, float]:
    """Return the turn from `from_east`, rad both, that changes the input by so much, and by how much it does.

    What the Earth's rate cannot give to one side is given to the other; what it cannot give at all is as large as
    it can be.
    """
    before = math.sin(from_east)
    for wanted_dph in (input_dph, -input_dph):
        share = before - wanted_dph / horizontal_dph
        if abs(share) <= 1.0:
            return math.asin(share) - from_east, wanted_dph
    share = -math.copysign(1.0, before or 1.0)
    return math.asin(share) - from_east, (before - share) * horizontal_dph


def over_temperature(bench: Bench, p: StandardTestParameters, dwells: Iterable[Dwell]) -> None:
    """Soak at room, cold and hot; at each measure at rest and at the largest rate of both signs."""
    at_c = math.nan
    for dwell in dwells:
        if (temp_c := dwell.fields["temp_c"]) != at_c:
            at_c = temp_c
            bench.phase(f"temperature_{temp_c:g}")
            bench.table.stop()
            go_to_end(bench, temp_c, p.ramp_k_per_min)
            bench.wait(60.0 * p.soak_min, f"soak at {temp_c:g} degC")
        _at_rate(bench, dwell)
    bench.phase("return")
    bench.table.stop()
    go_to_end(bench, p.room_c, p.ramp_k_per_min)


def _record_noise(bench: Bench, dwell: Dwell) -> dict[str, AtRest]:
    """Record at rest; return what each gyro that still speaks then gave, second by second."""
    begin_s = bench.now_s
    pieces: dict[str, list[AtRest]] = {name: [] for name in bench.gyros}
    whole, rest_s = divmod(dwell.length_s, _PIECE_S)
    for length_s in [_PIECE_S] * int(whole) + [rest_s] * (rest_s > 0.0):
        start_s = bench.now_s
        bench.wait(length_s, "noise")
        for name, gyro in bench.gyros.items():
            samples, sums_dps = gyro.seconds(start_s, bench.now_s)
            pieces[name].append(AtRest(samples, 3600.0 * sums_dps))
    bench.event(Interval(dwell.test, begin_s, bench.now_s))
    return {name: AtRest.of_pieces(pieces[name]) for name, gyro in bench.gyros.items() if not gyro.gone}


def _tell(bench: Bench, plan: Plan) -> None:
    """Write down what the noise makes of the plan, and what will be shown."""
    if not plan.by_noise:
        bench.note("no dwell follows from the noise: the record at rest is too short or has no samples")
        return
    columns: dict[str, list[float | None]] = {
        "input [deg/h]": [each.input_dph for each in plan.inputs],
        "dwell [s]": [each.schedule.dwell_s for each in plan.inputs],
        "repeats": [float(each.schedule.repeats) for each in plan.inputs],
        "standard error [deg/h]": [each.schedule.error_dph for each in plan.inputs],
    }
    bench.event(Series("Small inputs of threshold and resolution, by the noise measured", columns))
    for name in plan.too_noisy:
        bench.note(
            f"{name} is too noisy for these inputs in steps_h = {plan.grade.steps_h:g}: dwells and repeats are "
            "those that the others need"
        )
    bench.measure("rate_dwell", plan.rate_dwell_s, "s")
    bench.measure("rate_sequences", plan.sequences, "")
    if plan.shown_dph is not None:
        bench.measure("smallest_input_shown", plan.shown_dph, "deg/h")
        return
    most = plan.inputs[-1]
    bench.note(
        f"the noise hides every input: {most.input_dph:g} deg/h has a standard error of "
        f"{most.schedule.error_dph:.2g} deg/h in steps_h = {plan.grade.steps_h:g}, and half of it is shown from "
        f"{plan.needed_dph:.2g} deg/h on. A longer steps_h or larger inputs would show it"
    )


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


def _at_rate(bench: Bench, dwell: Dwell) -> None:
    # what a level axis feels is its misalignment
    bench.table.spin(dwell.fields["rate_dps"], across=dwell.test == "misalignment")
    bench.wait(SETTLE_S, "settling")
    _measure(bench, dwell)


def _measure(bench: Bench, dwell: Dwell) -> None:
    """Record for as long as it takes, then say from when to when and under what."""
    start_s = bench.now_s
    bench.wait(dwell.length_s, dwell.test.replace("_", " "))
    bench.event(Interval(dwell.test, start_s, bench.now_s, **dwell.fields))


def expected_duration_s(p: StandardTestParameters) -> float:
    """Return the expected bench time, before the noise has a say: with all of `steps_h` used."""
    return Plan.of(p).duration_s()


def intervals(p: StandardTestParameters, at_rest_dph: ArrayLike) -> Sequence[Interval]:
    """Return the intervals of measurement that a unit's noise would make of the test; 1 s means at rest (n,)."""
    return Plan.of(p).after({"unit": AtRest.of_means(at_rest_dph)}).intervals()


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
    measured, plan = set(_ALWAYS), Plan.of(p)
    if p.misalignment == "both":
        measured.add("input-axis misalignment, component across the table")
    if plan.grade.power_cycles > 0:
        measured.add("bias repeatability")
    if plan.sequences > 1:
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
    intervals=intervals,
)
