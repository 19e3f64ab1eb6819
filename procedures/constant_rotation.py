"""Constant rotation: turn the table, or an INS on its own mechanism, at a set rate, both senses if asked.

The run that a whirl compensation is fitted on (patent on whirl compensation of a rotating INS, the measurement
part). It begins and ends at rest, which shows how late the table's angles are stamped and whether the clocks run
apart; a reversal separates gyro drift from a constant tilt of the unit against the spin axis.
"""

from __future__ import annotations

from pydantic import field_validator

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Basis

_SETTLING_S = 10.0


class ConstantRotationParameters(Parameters):
    """Rate, turns, reversals."""

    rate_dps: float = parameter(6.0, "table rate; negative begins clockwise", "deg/s", ge=-1000, le=1000)
    turns: float = parameter(60.0, "turns in all, both senses together", "", ge=1, le=100_000)
    reversals: int = parameter(
        0, "changes of the sense, evenly spaced (1: half of the turns each way)", "", ge=0, le=10_000
    )
    rest_s: float = parameter(60.0, "rest before and after, for the clocks", "s", ge=10, le=3600)

    rate_tolerance_percent: float = parameter(
        0.1, "the table is at its rate when within this; more where its rate ripples", "%", ge=0.01, le=20
    )

    @field_validator("rate_dps")
    @classmethod
    def _turns_at_all(cls, rate_dps: float) -> float:
        if abs(rate_dps) < 0.1:
            raise ValueError("a rate of at least 0.1 deg/s is needed")
        return rate_dps


def run(bench: Bench, p: ConstantRotationParameters) -> None:
    """Run the test."""

    with bench.step("R1", "Mount, acquire at rest"):
        bench.phase("rest")
        bench.ask(
            f"{bench.table.mounting_text}Mount {bench.judge.name} with z up along the table's axis and "
            "the cable through the slip ring, level within 0.1 deg. Ready?",
            act="mount",
            mounting="z_up",
        )
        bench.table.engage()
        bench.table.point(0.0)
        bench.wait(p.rest_s, "rest before")

    stretch_s = _stretch_s(p)
    for number in range(p.reversals + 1):
        rate_dps = p.rate_dps * (-1.0) ** number
        title = f"Rotation at {rate_dps:+g} deg/s, {p.turns / (p.reversals + 1):g} turns"
        with bench.step("R2", title):
            bench.phase("settle")
            # z is up: of an IMU all axes are looked at, whichever is under test
            bench.table.spin(rate_dps, tolerance_share=0.01 * p.rate_tolerance_percent, across=True)
            bench.phase("turn_forward" if rate_dps > 0 else "turn_reverse")
            bench.wait(stretch_s, title.lower())

    with bench.step("R3", "Stop, rest"):
        bench.phase("settle")
        bench.table.stop()
        bench.phase("rest")
        start = bench.now_s
        bench.wait(p.rest_s, "rest after")
        gyro = bench.judge
        at_rest_dph, basis = 3600.0 * gyro.mean_rate_dps(start), Basis("gyro_output", since_s=start)
        bench.measure("output_at_rest", at_rest_dph, "deg/h", gyro=gyro.name, basis=basis)


def _stretch_s(p: ConstantRotationParameters) -> float:
    """Time of one sense."""
    return 360.0 * p.turns / abs(p.rate_dps) / (p.reversals + 1)


def expected_duration_s(p: ConstantRotationParameters) -> float:
    """Return the expected bench time."""
    return 2.0 * p.rest_s + (p.reversals + 1) * (_stretch_s(p) + _SETTLING_S) + 3.0 * _SETTLING_S


PROCEDURE = Procedure(
    name="constant-rotation",
    title="Constant rotation for the whirl of a rotating INS",
    source="patent on whirl compensation of a rotating INS, measurement",
    parameters=ConstantRotationParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=lambda p: Demands(max_rate_dps=abs(p.rate_dps)),  # the chamber stays as it is
)
