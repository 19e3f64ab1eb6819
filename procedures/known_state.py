"""Bring the bench to a known state: table at rest at an angle, chamber and units at a temperature, read back.

What a campaign does before it goes on after an interruption, since nobody knows what the bench did meanwhile.
"""

from __future__ import annotations

import math

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Basis
from procedures._cold_shock import temperature_steady

_POSITION_DEG = 0.01
_REST_DPS = 0.01
_ROOM_C = 25.0
_ANGLE, _RATE, _AIR = Basis("table_angle"), Basis("table_rate"), Basis("air_temperature")
_NEAR_S = 960.0
"""For a bench that is there already: `temperature_steady` compares 1 min means 10 min apart."""
_FAR_S = 3600.0
"""What units need beyond the ramp to follow the air, to a drift of 0.5 K in 10 min."""


class KnownStateParameters(Parameters):
    """Where to bring the bench, and when it counts as being there."""

    air_c: float = parameter(25.0, "chamber set point", "degC", ge=-40, le=85)
    ramp_k_per_min: float = parameter(2.0, "ramp to it: the chamber may be far away", "K/min", gt=0, le=10)
    angle_deg: float = parameter(0.0, "table angle", "deg", ge=0, lt=360)
    air_tolerance_k: float = parameter(1.0, "air counts as there within", "K", gt=0, le=10)
    drift_k_per_10min: float = parameter(
        0.5, "units count as steady below this drift in 10 min", "K", gt=0, le=5
    )
    timeout_min: float = parameter(240.0, "longest wait for the temperatures", "min", gt=0, le=1440)


def run(bench: Bench, p: KnownStateParameters) -> None:
    """Run it."""
    with bench.step("K1", "Table to a known angle"):
        bench.phase("table")
        found = bench.table.history.last
        bench.measure("found_angle", found["angle_deg"], "deg", basis=_ANGLE)
        bench.measure("found_rate", found["rate_dps"], "deg/s", basis=_RATE)
        bench.measure("found_air", bench.chamber.history.last["air_temp_c"], "degC", basis=_AIR)
        bench.table.engage()
        bench.table.point(p.angle_deg)
        bench.wait(5.0, "reading back")
        there = bench.table.history.last
        error_deg = (there["angle_deg"] - p.angle_deg + 180.0) % 360.0 - 180.0
        limit_deg = _POSITION_DEG
        if not bench.measure("angle_error", error_deg, "deg", low=-limit_deg, high=limit_deg, basis=_ANGLE):
            text = f"the table is {error_deg:+.4f} deg off the angle it was sent to"
            bench.invalidate(text, "table_off_angle", error_deg=error_deg)
        rate_dps = there["rate_dps"]
        if not bench.measure("rate", rate_dps, "deg/s", low=-_REST_DPS, high=_REST_DPS, basis=_RATE):
            text = f"the table turns at {rate_dps:+.4f} deg/s where it should rest"
            bench.invalidate(text, "table_turns", rate_dps=rate_dps)

    with bench.step("K2", f"Chamber and units to {p.air_c:g} degC"):
        bench.phase("temperature")
        bench.chamber.go_to(p.air_c, p.ramp_k_per_min)
        bench.chamber.start()

        def reached() -> bool:
            now = bench.now_s
            near = abs(bench.chamber.history.last["air_temp_c"] - p.air_c) <= p.air_tolerance_k
            return near and all(
                temperature_steady(gyro, now, p.drift_k_per_10min)
                for gyro in bench.gyros.values()
                if not gyro.gone
            )

        what = f"chamber and units to {p.air_c:g} degC"
        if not bench.wait_until(reached, timeout_s=60.0 * p.timeout_min, what=what, every_s=10.0):
            air = bench.chamber.history.last["air_temp_c"]
            bench.invalidate(
                f"chamber and units were not at {p.air_c:g} degC within {p.timeout_min:g} min: "
                f"air {air:.1f} degC",
                "not_at_temperature",
                demanded_c=p.air_c,
                air_temp_c=air,
                waited_s=60.0 * p.timeout_min,
            )
        air_c = bench.chamber.history.last["air_temp_c"]
        low, high = p.air_c - p.air_tolerance_k, p.air_c + p.air_tolerance_k
        bench.measure("air", air_c, "degC", low=low, high=high, basis=_AIR)
        for name, gyro in bench.gyros.items():
            temp_c = gyro.history.last.get("temp_c", math.nan)
            bench.measure(f"{name}_temperature", temp_c, "degC", gyro=name, basis=Basis("unit_temperature"))
        bench.chamber.stop()


def expected_duration_s(p: KnownStateParameters) -> float:
    """Return the bench time on a bench that comes from room temperature."""
    far_k = abs(p.air_c - _ROOM_C)
    return _NEAR_S + (60.0 * far_k / p.ramp_k_per_min + _FAR_S if far_k > p.air_tolerance_k else 0.0)


def demands(p: KnownStateParameters) -> Demands:
    """Return the extremes of the run."""
    return Demands(min_temp_c=p.air_c, max_temp_c=p.air_c, max_ramp_k_per_min=p.ramp_k_per_min)


PROCEDURE = Procedure(
    name="known-state",
    title="Table at rest at an angle, chamber and units at one temperature",
    source="this project: resumption of a campaign",
    parameters=KnownStateParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=demands,
    upright=False,
)
