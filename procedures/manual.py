"""By hand: the bench does what it is told, one order at a time, recorded as any run.

Lease, limits, watchdog and record are those of every run. Orders come from the panel's buttons or from the
console.
"""

from __future__ import annotations

from bench.control.by_hand import Bounds, next_order, obey
from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench


class ManualParameters(Parameters):
    """What may be ordered, within the bench's own limits, and when the bench is given back by itself."""

    max_rate_dps: float = parameter(10.0, "fastest rate that may be ordered", "deg/s", gt=0, le=1000)
    low_c: float = parameter(10.0, "lowest set point that may be ordered", "degC", ge=-70, le=125)
    high_c: float = parameter(40.0, "highest set point that may be ordered", "degC", ge=-70, le=125)
    ramp_k_per_min: float = parameter(2.0, "ramp to every set point", "K/min", gt=0, le=10)
    idle_min: float = parameter(60.0, "ends when nobody orders anything for so long", "min", gt=0, le=1440)


def run(bench: Bench, p: ManualParameters) -> None:
    """Run it."""
    with bench.step("H1", "By hand"):
        bench.phase("by_hand")
        bench.table.engage()
        if len(bench.table.axes) == 1:  # turns to an angle are no faster; other axes have limits of their own
            bench.table.confine(p.max_rate_dps)
        bounds = Bounds(p.max_rate_dps, p.low_c, p.high_c, p.ramp_k_per_min)
        while (order := next_order(bench, p.idle_min)).verb != "done":
            obey(bench, order, bounds)


def expected_duration_s(p: ManualParameters) -> float:
    """Return how long it takes if nobody orders anything."""
    return 60.0 * p.idle_min


def demands(p: ManualParameters) -> Demands:
    """Return the extremes that may be ordered."""
    return Demands(p.max_rate_dps, p.low_c, p.high_c, p.ramp_k_per_min)


PROCEDURE = Procedure(
    name="manual",
    title="By hand: point, spin, stop, go to a temperature, as ordered",
    source="this project",
    parameters=ManualParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=demands,
    upright=False,
)
