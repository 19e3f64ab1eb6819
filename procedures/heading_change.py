"""Heading change of a platform INS: align at a reference heading, then stay for days at each of several
headings.

Follows the heading-effect paper's test (A 110 h, B 48 h, C 34 h): the chamber holds one temperature, the
table turns the platform, its position and temperatures are recorded. `gyrobench fit heading-effect`
makes a compensation of the record.
"""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Basis, NavigationDemand

_LEAST_STAY_H = 2.0


class HeadingChangeParameters(Parameters):
    """Headings and how long to stay at each; the first is the reference."""

    headings_deg: str = parameter(
        "0, 60, 120, 180, 240, 300", "headings in order, the first is the reference", "deg"
    )
    stays_h: str = parameter("48", "hours at each heading, or one number for all", "h")
    north_deg: float = parameter(0.0, "table angle at which the heading is 0", "deg", ge=0, lt=360)
    clockwise: bool = parameter(True, "whether a growing table angle turns the heading clockwise")
    warm_up_h: float = parameter(
        96.0, "from power-on to the reference; the platform's temperature settles in 88 h", "h", ge=0, le=480
    )
    telemetry_s: float = parameter(
        10.0, "table and chamber are asked this often during a stay", "s", ge=1, le=60
    )
    room_c: float = parameter(23.0, "chamber temperature throughout", "degC", ge=10, le=35)

    @model_validator(mode="after")
    def _planned(self) -> Self:
        self.plan()
        return self

    def plan(self) -> list[tuple[float, float]]:
        """Return (heading deg, hours) in order; ValueError where the two lists do not fit together."""
        headings, stays = numbers(self.headings_deg), numbers(self.stays_h)
        if len(stays) == 1:
            stays = stays * len(headings)
        if len(stays) != len(headings):
            raise ValueError(f"{len(headings)} headings and {len(stays)} stays")
        if min(stays) < _LEAST_STAY_H:
            raise ValueError(f"a stay of {min(stays):g} h; the least is {_LEAST_STAY_H:g} h")
        return list(zip((heading % 360.0 for heading in headings), stays, strict=True))

    def table_deg(self, heading_deg: float) -> float:
        """Return the table angle of a heading."""
        return (self.north_deg + (heading_deg if self.clockwise else -heading_deg)) % 360.0


def numbers(text: str) -> list[float]:
    """Return the numbers of "0, 90, 180"; ValueError if there is anything else."""
    return [float(part) for part in text.split(",")]


def run(bench: Bench, p: HeadingChangeParameters) -> None:
    """Run the test."""
    plan = p.plan()
    reference = plan[0][0]
    judge_plan(bench, plan)
    with bench.step("H1", "Reference heading, warm up, align"):
        bench.phase("warm_up")
        bench.ask(
            f"{bench.table.mounting_text}Mount the platform INS so that its heading is {reference:g} deg "
            f"at table angle {p.table_deg(reference):g} deg. Close the chamber. Ready?",
            act="mount",
            mounting="axis_up",
        )
        bench.table.engage()
        bench.table.point(p.table_deg(reference))
        bench.chamber.go_to(p.room_c)
        bench.chamber.start()
        with bench.polling(p.telemetry_s):
            bench.wait(3600.0 * p.warm_up_h, "warming up at the reference heading")
    with bench.step("H2", "Navigate, turn and stay"):
        for platform in bench.platforms.values():
            if not platform.gone:
                bench.event(NavigationDemand(platform.name))
                platform.device.navigate()
        for number, (heading, hours) in enumerate(plan):
            if number:
                bench.table.point(p.table_deg(heading))
            bench.phase(f"heading_{number}")
            bench.note(f"heading {heading:g} deg for {hours:g} h")
            with bench.polling(p.telemetry_s):
                bench.wait(3600.0 * hours, f"heading {heading:g} deg")
            bench.measure(f"heading_{number}", heading, "deg", basis=Basis("heading"))
    with bench.step("H3", "Close"):
        bench.table.point(p.table_deg(reference))
        bench.chamber.stop()


def judge_plan(bench: Bench, plan: list[tuple[float, float]]) -> None:
    """Declare what a plan cannot give, before days are spent on it."""
    reference, others = plan[0], {round(heading / 4.0) % 90 for heading, _ in plan[1:]}
    others -= {round(reference[0] / 4.0) % 90}
    if len(others) < 3:
        bench.invalidate(
            f"{len(others)} headings beside the reference: at least three are needed for a compensation",
            "too_few_headings",
            headings=len(others),
        )
    if reference[1] < 24.0:
        bench.invalidate(
            f"{reference[1]:g} h at the reference heading: a sidereal day is needed for its temperature",
            "short_reference",
            stay_h=reference[1],
        )


def expected_duration_s(p: HeadingChangeParameters) -> float:
    """Return the expected bench time."""
    return 3600.0 * (p.warm_up_h + sum(hours for _, hours in p.plan())) + 60.0


PROCEDURE = Procedure(
    name="heading-change",
    title="Heading change of a platform INS, days at each heading",
    source="heading-effect paper (Fourier expansion of the temperature change)",
    parameters=HeadingChangeParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=lambda p: Demands(min_temp_c=p.room_c, max_temp_c=p.room_c),
    tests="platform",
)
