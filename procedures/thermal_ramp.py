"""Slow thermal ramp from cold to hot and back, axis east: the run a temperature model of a ring laser is made of.

-40 .. +65 degC at 1 degC in 3 min with a dwell at each end, both directions, all gyros of the bench at once.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from procedures.zero_bias_cold_shock import ZeroBiasParameters, find_east

_WINDOW_S = 900.0
_LEAST_SHARE = 0.3
"""Part of the demanded ramp that the air must follow over a quarter of an hour."""
_AT_END_K = 1.0
_ROOM_RAMP_K_PER_MIN = 3.0


class ThermalRampParameters(Parameters):
    """The profile, and how east is found."""

    low_c: float = parameter(-40.0, "cold end", "degC", ge=-70, le=85)
    high_c: float = parameter(65.0, "hot end", "degC", ge=-70, le=125)
    ramp_k_per_min: float = parameter(1.0 / 3.0, "ramp demanded of the chamber", "K/min", gt=0, le=10)
    dwell_min: float = parameter(60.0, "dwell at each end", "min", ge=0, le=600)
    downwards: bool = parameter(False, "begin at the hot end and go down first")
    both_directions: bool = parameter(True, "come back on a second ramp")
    room_c: float = parameter(25.0, "chamber temperature before and after", "degC", ge=10, le=35)
    warm_up_min: float = parameter(60.0, "time from power-on to the first soak", "min", ge=0, le=600)
    azimuth_deg: float = parameter(
        90.0, "table angle at which the axes should point east", "deg", ge=0, lt=360
    )
    search_east: bool = parameter(True, "measure the azimuth by the Earth rate and turn to east")
    east_dwell_s: float = parameter(480.0, "dwell at each of four positions", "s", ge=60, le=7200)

    def ends(self) -> tuple[float, float]:
        """Return the first and the second end."""
        return (self.high_c, self.low_c) if self.downwards else (self.low_c, self.high_c)

    def ramp_s(self) -> float:
        """Return how long a ramp takes."""
        return 60.0 * abs(self.high_c - self.low_c) / self.ramp_k_per_min


def run(bench: Bench, p: ThermalRampParameters) -> None:
    """Run the test."""
    first, second = p.ends()

    with bench.step("1", "Axes east, power on, acquire"):
        bench.phase("warm_up")
        bench.ask(
            f"{bench.table.mounting_text}Mount the units side by side with their sensitive axes level "
            "within 0.02 deg, pointing east at "
            f"table angle {p.azimuth_deg:g} deg. Close the chamber. Ready?",
            act="mount",
            mounting="axis_horizontal",
        )
        bench.table.engage()
        bench.table.point(p.azimuth_deg)
        bench.chamber.go_to(p.room_c)
        bench.chamber.start()
        bench.wait(60.0 * p.warm_up_min - bench.now_s, "warming up")
        if p.search_east:
            find_east(bench, ZeroBiasParameters(azimuth_deg=p.azimuth_deg, east_dwell_s=p.east_dwell_s))

    with bench.step("2", f"Soak at {first:g} degC"):
        bench.phase("soak")
        go_to_end(bench, first, _ROOM_RAMP_K_PER_MIN)
        bench.wait(60.0 * p.dwell_min, f"soak at {first:g} degC")

    legs = [("ramp_1", "dwell_1", second)] + ([("ramp_2", "dwell_2", first)] if p.both_directions else [])
    for number, (ramp, dwell, end) in enumerate(legs, start=3):
        with bench.step(str(number), f"Ramp to {end:g} degC at {p.ramp_k_per_min:.3g} K/min"):
            bench.phase(ramp)
            go_to_end(bench, end, p.ramp_k_per_min)
            bench.phase(dwell)
            bench.wait(60.0 * p.dwell_min, f"dwell at {end:g} degC")

    with bench.step(str(len(legs) + 3), "Close"):
        bench.phase("close")
        go_to_end(bench, p.room_c, _ROOM_RAMP_K_PER_MIN)
        bench.chamber.stop()


def go_to_end(
    bench: Bench, end_c: float, ramp_k_per_min: float, meanwhile: Callable[[], None] | None = None
) -> None:
    """Ramp to `end_c` and wait until the air is there; a ramp that stalls makes the run invalid.

    `meanwhile` is done again and again until then; by default the bench waits.
    """
    ramp = _Ramp(bench, end_c, ramp_k_per_min)
    if meanwhile is None:
        bench.wait_until(ramp.arrived, timeout_s=ramp.allowed_s, what=f"ramp to {end_c:g} degC", every_s=10.0)
    else:
        while not ramp.arrived() and not ramp.given_up:
            meanwhile()
    ramp.judge()


class _Ramp:
    """A ramp of the air that begins now.

    The air has stalled when it moved by less than `_LEAST_SHARE` of the demanded ramp over a quarter of an hour
    without having arrived. A stalled ramp is given up at twice its time.
    """

    def __init__(self, bench: Bench, end_c: float, ramp_k_per_min: float) -> None:
        self._bench, self._end_c, self._ramp_k_per_min = bench, end_c, ramp_k_per_min
        self._start_s, start_c = bench.now_s, bench.chamber.history.last["air_temp_c"]
        self._there = self._stalled = False
        self.allowed_s = 60.0 * 2.0 * abs(end_c - start_c) / ramp_k_per_min + 3600.0
        bench.chamber.go_to(end_c, ramp_k_per_min)

    @property
    def given_up(self) -> bool:
        """Whether the air has had its time."""
        return self._bench.now_s - self._start_s > self.allowed_s

    def arrived(self) -> bool:
        """Return whether the air is there; the first look at which it has stalled makes the run invalid."""
        bench, demanded = self._bench, self._ramp_k_per_min
        rows = bench.chamber.history.since(bench.now_s - _WINDOW_S)
        air = rows["air_temp_c"]
        self._there = abs(air[-1] - self._end_c) <= _AT_END_K
        moved = abs(air[-1] - air[0]) / max((rows["time_s"][-1] - rows["time_s"][0]) / 60.0, 1.0)
        since_s = bench.now_s - self._start_s
        if not self._there and not self._stalled and since_s > _WINDOW_S and moved < _LEAST_SHARE * demanded:
            self._stalled = True
            bench.invalidate(
                f"the ramp to {self._end_c:g} degC stalled at {air[-1]:.1f} degC, {since_s:.0f} s after "
                f"it began: {moved:.3f} of {demanded:.3f} K/min over the last {_WINDOW_S / 60:.0f} min",
                "ramp_stalled",
                end_c=self._end_c,
                air_temp_c=float(air[-1]),
                rate_k_per_min=float(moved),
                demanded_k_per_min=demanded,
            )
        return self._there

    def judge(self) -> None:
        """Make the run invalid if the air has not arrived at the last look."""
        if not self._there and not self._stalled:
            self._bench.invalidate(
                f"the air did not reach {self._end_c:g} degC within {self.allowed_s / 60:.0f} min",
                "end_not_reached",
                end_c=self._end_c,
                waited_s=self.allowed_s,
            )


def expected_duration_s(p: ThermalRampParameters) -> float:
    """Return the expected bench time."""
    legs = 2 if p.both_directions else 1
    first, second = p.ends()
    last = first if p.both_directions else second
    approach_s = 60.0 * (abs(first - p.room_c) + abs(last - p.room_c)) / _ROOM_RAMP_K_PER_MIN
    east_s = 4.0 * p.east_dwell_s + 200.0 if p.search_east else 0.0
    return 60.0 * p.warm_up_min + east_s + approach_s + legs * p.ramp_s() + (legs + 1) * 60.0 * p.dwell_min


def demands(p: ThermalRampParameters) -> Demands:
    """Return the extremes of the run."""
    return Demands(
        min_temp_c=min(p.low_c, p.room_c),
        max_temp_c=max(p.high_c, p.room_c),
        max_ramp_k_per_min=max(p.ramp_k_per_min, _ROOM_RAMP_K_PER_MIN),
    )


PROCEDURE = Procedure(
    name="thermal-ramp",
    title="Slow ramp over temperature in both directions, axes east, all gyros at once",
    source="ring-laser bias over -40..+65 degC; GJB 2426A temperature test",
    parameters=ThermalRampParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=demands,
)
