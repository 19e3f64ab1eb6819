"""Scale-factor test through a low-temperature shock: CN115855016B, steps S121 to S127.

Axis vertical; the same chamber profile at +W, -W and 0 deg/s. The scale factor at every time point is the slope
of output over rate through the three sections, aligned on the chamber's slope.
"""

from __future__ import annotations

from bench.control.procedure import Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Section
from procedures._cold_shock import (
    ColdShockParameters,
    reference_window,
    return_to_room,
    shock,
    wait_for_equilibrium,
)
from procedures._mounting import begin_axis_up


class ScaleFactorParameters(ColdShockParameters):
    """The profile, and the rates."""

    rate_dps: float = parameter(20.0, "table rate of the + and - sections", "deg/s", gt=0, le=1000)
    repeats: int = parameter(1, "groups of +, -, 0 in this run (S127)", "", ge=1, le=20)


_SECTIONS = (("S122", +1.0), ("S124", -1.0), ("S126", 0.0))


def run(bench: Bench, p: ScaleFactorParameters) -> None:
    """Run the test."""
    with bench.step("S121", "Axis vertical, power on, acquire"):
        bench.phase("warm_up")
        begin_axis_up(bench, p.room_c)

    for repeat in range(1, p.repeats + 1):
        for code, sense in _SECTIONS:
            rate_dps = sense * p.rate_dps
            with bench.step(code, f"Shock at {rate_dps:+g} deg/s, group {repeat} of {p.repeats}"):
                bench.event(Section(repeat, rate_dps))  # ends the last one before its rate goes
                bench.table.spin(rate_dps)
                wait_for_equilibrium(bench, p, phase="equilibrium")
                reference_window(bench, p)
                shock(bench, p)
                return_to_room(bench, p)

    with bench.step("S127", "Close"):
        bench.phase("close")
        bench.table.stop()
        bench.chamber.stop()


def expected_duration_s(p: ScaleFactorParameters) -> float:
    """Return the expected bench time."""
    section = 60.0 * p.hold_min + p.shock_duration_s()
    return 60.0 * p.warm_up_min + len(_SECTIONS) * p.repeats * section


PROCEDURE = Procedure(
    name="scale-factor-cold-shock",
    title="Scale factor through a low-temperature shock, axis vertical, +W, -W, 0",
    source="CN115855016B S121..S127",
    parameters=ScaleFactorParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=lambda p: p.demands(max_rate_dps=p.rate_dps),
)
