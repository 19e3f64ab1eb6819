"""System-level calibration: an IMU turned through a scheme of positions, still after every turn.

The record from which all gyro and accelerometer biases, scale factors, installation angles and quadratic terms
are found at once (19- and 23-position schemes of the literature, or one searched for this table). Nothing of the
table's accuracy enters: the turns are measured by the IMU itself.
"""

from __future__ import annotations

from pydantic import field_validator

from bench.analysis.calibration import (
    Schedule,
    Site,
    Task,
    TurningPlan,
    evaluate,
    home_text,
    load_scheme,
    moves_text,
    plan_turns,
    require_closed,
    table_axes,
)
from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.session import Bench
from bench.record.events.run import Basis, Position, Scheme, Turn

_SETTLING_S = 5.0
_START_TURN_DEG = 180.0


class SystemCalibrationParameters(Parameters):
    """Scheme, dwell, rate of the turns."""

    scheme: str = parameter(
        "23-position", "19-position, 23-position (-b, -c), optimised, another name, or a scheme file"
    )
    dwell_s: float = parameter(180.0, "rest at every position", "s", ge=20, le=3600)
    rate_dps: float = parameter(10.0, "rate of the turns", "deg/s", gt=0.1, le=100)
    warm_up_min: float = parameter(10.0, "powered at rest before the first position", "min", ge=0, le=600)

    @field_validator("scheme")
    @classmethod
    def _is_a_scheme(cls, scheme: str) -> str:
        require_closed(load_scheme(scheme))
        return scheme


def run(bench: Bench, p: SystemCalibrationParameters) -> None:
    """Run the test."""
    plan = plan_turns(_schedule(p), table_axes(bench.file.table))
    schedule = plan.schedule
    _note_heading(bench, p, plan)
    for name in bench.table.axes:
        bench.table.check(p.rate_dps, name)

    with bench.step("K1", "Mount, home the table"):
        bench.phase("mount")
        names = ", ".join(bench.gyros)
        bench.ask(
            f"Table at 0 on every axis: mount {names} with body axes {plan.mount_text}, within 1 deg. Ready?",
            act="mount",
            mounting=plan.mount_text,
            attitude=plan.mount.tolist(),
        )
        home, moves = home_text(schedule.home), moves_text(schedule.moves)
        timing = (schedule.dwell_s, schedule.rate_dps)
        # The fit reads from here what is really turned.
        bench.event(Scheme(schedule.name, schedule.source, home, moves, *timing, plan.mount_text))
        bench.table.device.servo_on()
        bench.table.confine(p.rate_dps)
        bench.table.home()

    with bench.step("K2", f"Start attitude, {home}; warm-up"):
        bench.phase("warm_up")
        for name, angle_deg in plan.start_deg.items():
            bench.table.point(angle_deg, name)
        bench.wait(60.0 * p.warm_up_min, "warm-up")

    with bench.step("K3", f"{schedule.positions} positions of {schedule.name}"):
        _dwell(bench, p, 1, schedule.positions)
        for number, turn in enumerate(plan.turns, 2):
            bench.phase("turn")
            bench.event(Turn(number - 1, turn.axis, turn.by_deg, turn.to_deg))
            timeout_s = 60.0 + 2.0 * abs(turn.by_deg) / p.rate_dps
            bench.table.point(
                turn.to_deg,
                turn.axis,
                sense="positive" if turn.by_deg > 0 else "negative",
                timeout_s=timeout_s,
            )
            _dwell(bench, p, number, schedule.positions)

    with bench.step("K4", "Close"):
        bench.phase("close")
        for name, gyro in bench.gyros.items():
            temp_c = gyro.history.last.get("temp_c", float("nan"))
            bench.measure(f"{name}_temperature", temp_c, "degC", gyro=name, basis=Basis("unit_temperature"))


def _dwell(bench: Bench, p: SystemCalibrationParameters, number: int, positions: int) -> None:
    bench.phase("dwell")
    bench.event(Position(number))
    bench.wait(p.dwell_s, f"position {number} of {positions}")


def _note_heading(bench: Bench, p: SystemCalibrationParameters, plan: TurningPlan) -> None:
    """Say what another heading than the scheme's own costs, if the table forces one."""
    turned, planned = plan.schedule, _schedule(p)
    task = Task(site=Site(bench.file.bench.latitude_deg))
    here, there = (evaluate(task, schedule).merit.worst for schedule in (turned, planned))
    if here > 1.02 * there:
        bench.note(
            f"this table turns the scheme from {home_text(turned.home)} instead of {home_text(planned.home)}: "
            f"worst sigma over target {here:.2f} instead of {there:.2f} (reference noise)"
        )


def _schedule(p: SystemCalibrationParameters) -> Schedule:
    return load_scheme(p.scheme).with_(dwell_s=p.dwell_s, rate_dps=p.rate_dps, profile="constant")


def expected_duration_s(p: SystemCalibrationParameters) -> float:
    """Return the expected bench time."""
    schedule = _schedule(p)
    start_s = 2.0 * _START_TURN_DEG / p.rate_dps
    return 60.0 * p.warm_up_min + schedule.duration_s + schedule.positions * _SETTLING_S + start_s + 20.0


PROCEDURE = Procedure(
    name="system-calibration",
    title="System-level calibration of an IMU, scheme of positions",
    source="Zhang et al., full-state field calibration (19 and 23 positions); design note on calibration",
    parameters=SystemCalibrationParameters,
    run=run,
    expected_duration_s=expected_duration_s,
    demands=lambda p: Demands(max_rate_dps=p.rate_dps),  # the chamber stays as it is
    upright=False,
)
