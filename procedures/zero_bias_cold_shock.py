"""Zero-bias test through a low-temperature shock: CN115855016B, steps S111 to S114.

The sensitive axis points east, so that the Earth rate it sees is zero and insensitive, to first order, to tilt
about the vertical; drift is then all the gyro's own.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from bench.control.procedure import Procedure, parameter
from bench.control.session import Bench
from bench.control.stream_stations import GyroStation
from bench.record.events.run import Basis
from procedures._cold_shock import (
    ColdShockParameters,
    reference_window,
    return_to_room,
    shock,
    wait_for_equilibrium,
)

_PIECES = 8
"""Of a dwell; their scatter says how well its mean is known."""


class ZeroBiasParameters(ColdShockParameters):
    """The profile, and how east is found."""

    azimuth_deg: float = parameter(
        90.0, "table angle at which the axis should point east", "deg", ge=0, lt=360
    )
    east_after_min: float = parameter(25.0, "time from power-on to the search for east", "min", ge=0, le=600)
    east_dwell_s: float = parameter(480.0, "dwell at each of the four positions", "s", ge=60, le=7200)
    east_tolerance_deg: float = parameter(2.0, "largest mounting azimuth error accepted", "deg", gt=0, le=10)
    repeats: int = parameter(1, "shocks in this run (S114)", "", ge=1, le=20)


def run(bench: Bench, p: ZeroBiasParameters) -> None:
    """Run the test."""
    with bench.step("S111", "Axis east, power on, acquire"):
        bench.phase("warm_up")
        bench.ask(
            f"{bench.table.mounting_text}Mount the units with the sensitive axis of {bench.judge.name} "
            f"horizontal, level within 0.02 deg, pointing east at table angle {p.azimuth_deg:g} deg. "
            "Close the chamber. Ready?",
            act="mount",
            mounting="axis_horizontal",
        )
        bench.table.engage()
        bench.table.point(p.azimuth_deg)
        bench.chamber.go_to(p.room_c)
        bench.chamber.start()
        bench.wait(60.0 * p.east_after_min - bench.now_s, "warming up")
        find_east(bench, p)

    for repeat in range(1, p.repeats + 1):
        with bench.step("S112", f"Equilibrium at room temperature, shock {repeat} of {p.repeats}"):
            wait_for_equilibrium(bench, p, phase="equilibrium")
            reference_window(bench, p)
            shock(bench, p)
        with bench.step("S113", "Back to room temperature, equilibrium"):
            return_to_room(bench, p)

    with bench.step("S114", "Close"):
        bench.phase("close")
        bench.chamber.stop()


def find_east(bench: Bench, p: ZeroBiasParameters) -> float:
    """Measure the axis' azimuth from the Earth rate at two opposite table angles, then turn it to east.

    Returns the table angle at which it points there.

    Positions in the order east, west, west, east, so that a linear warm-up drift cancels. With azimuth
    90 deg + e the output is b - W cos(L) sin(e) at east and b + W cos(L) sin(e) at west. All four means are of
    one unit, the one that is judged by at the end. Where its noise is such that two standard deviations of e are
    beyond the tolerance, nothing is judged and the table stays at `azimuth_deg`: the Earth rate that a wrong
    azimuth lets in is then less than this unit can tell.
    """
    bench.phase("axis_east")
    east, west = p.azimuth_deg, (p.azimuth_deg + 180.0) % 360.0
    dwells: dict[float, list[tuple[float, float]]] = {east: [], west: []}
    for angle in (east, west, west, east):
        bench.table.point(angle)
        start = bench.now_s
        bench.wait(p.east_dwell_s, f"Earth rate at {angle:g} deg")
        dwells[angle].append((start, bench.now_s))
    gyro = bench.judge
    means = {angle: [3600.0 * gyro.mean_rate_dps(*stay) for stay in stays] for angle, stays in dwells.items()}
    horizontal_dph = bench.file.bench.earth_rate_north_dph
    difference = (sum(means[west]) - sum(means[east])) / 4.0
    if math.isnan(difference):
        text = f"east was not found: {gyro.name} had no valid output at one of the four positions"
        bench.invalidate(text, "no_east", device=gyro.name)
        difference = 0.0
    error_deg = math.degrees(math.asin(max(-1.0, min(1.0, difference / horizontal_dph))))
    deviations = [_deviation_dph(gyro, *stay) for stays in dwells.values() for stay in stays]
    doubt_deg = math.degrees(2.0 * math.hypot(*deviations) / 4.0 / horizontal_dph)
    bench.measure("azimuth_error_2_sigma", doubt_deg, "deg")
    limit, basis = p.east_tolerance_deg, Basis("axis_azimuth")
    if doubt_deg > limit:
        bench.measure("azimuth_error", error_deg, "deg", basis=basis)
        bench.note(
            f"{gyro.name} cannot tell east: {error_deg:+.2f} +- {doubt_deg:.2f} deg (2 sigma), accepted are "
            f"{limit:g} deg; the table stays at {p.azimuth_deg:g} deg. east_dwell_s = "
            f"{math.ceil(p.east_dwell_s * (doubt_deg / limit) ** 2)} would do"
        )
        error_deg = 0.0
    elif not bench.measure("azimuth_error", error_deg, "deg", low=-limit, high=limit, basis=basis):
        bench.invalidate(
            f"the axis is {error_deg:+.2f} deg off east, accepted are {limit:g} deg: mount it again",
            "off_east",
            error_deg=error_deg,
            limit_deg=limit,
        )
    east_deg = (p.azimuth_deg - error_deg) % 360.0
    bench.table.point(east_deg)
    bench.measure("east_table_angle", east_deg, "deg", basis=Basis("east_angle"))
    return east_deg


def _deviation_dph(gyro: GyroStation, start_s: float, end_s: float) -> float:
    """Return the standard deviation of a dwell's mean, by its pieces' scatter about a line; 0 if unknown."""
    borders = np.linspace(start_s, end_s, _PIECES + 1).tolist()
    pieces = np.array([3600.0 * gyro.mean_rate_dps(*piece) for piece in pairwise(borders)])
    known = np.flatnonzero(np.isfinite(pieces))
    if len(known) < 4:
        return 0.0
    residuals = pieces[known] - np.polyval(np.polyfit(known, pieces[known], 1), known)
    return float(np.sqrt(np.sum(residuals**2) / (len(known) - 2) / len(known)))


def expected_duration_s(p: ZeroBiasParameters) -> float:
    """Return the expected bench time."""
    warm_up = max(60.0 * p.warm_up_min, 60.0 * p.east_after_min + 4 * p.east_dwell_s + 1800.0)
    return warm_up + p.repeats * (60.0 * p.hold_min + p.shock_duration_s())


PROCEDURE = Procedure(
    name="zero-bias-cold-shock",
    title="Zero bias through a low-temperature shock, axis east",
    source="CN115855016B S111..S114",
    parameters=ZeroBiasParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=ZeroBiasParameters.demands,
)
