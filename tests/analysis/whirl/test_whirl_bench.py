"""The whole way: wobbling bearing, emulated table and gyro, bytes, angle, fit, attitude (checks C22 and C23)."""

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.whirl import WhirlCompensation
from bench.analysis.whirl._attitude import (
    Oscillation,
    carrier_tilt,
    oscillation,
    uncompensated,
    unit_attitude,
)
from bench.analysis.whirl._direct import DirectFit, fit_direct
from bench.analysis.whirl._integral import body_lines, fit_integral, match_coefficients
from bench.analysis.whirl._residual import heading_from_body_rate
from bench.analysis.whirl._runs import corrected
from bench.analysis.whirl._study import judge
from bench.analysis.whirl._types import TurnRecord
from benchmarks.whirl_runs import QUIET, STILL, TABLE, Plan, emulate, nominal_angle, reversing
from simulators.plant import TableParameters
from simulators.plant.wobble import BACKWARD_LINE, CONSTANT_TILT, PATENT_CLASS, Wobble

# A gyro at 25 Hz and a table asked every 5 s keep the tests short; the walk uses 100 Hz and 1 s.
FULL = {**PATENT_CLASS, **CONSTANT_TILT, **BACKWARD_LINE}
TEN_TURNS = [(600.0, 6.0)]
HALF_HOUR = [(1800.0, 6.0)]


def compensate(fit: DirectFit) -> WhirlCompensation:
    return WhirlCompensation.from_fit(fit, "INS-1", {}, gauge="mean")


def without_compensation(record: TurnRecord, fit: DirectFit) -> Oscillation:
    attitude = unit_attitude(record, heading_from_body_rate(fit.body_rate_dph[0].value))
    return oscillation(
        carrier_tilt(uncompensated(attitude, record.angle_rad)), record.time_s, record.angle_rad
    )


def test_ideal_sensors_leave_nothing() -> None:
    plan = Plan(TEN_TURNS, Wobble(FULL), without=QUIET, table=STILL)
    record, _ = emulate(plan)
    fit = fit_direct([record])
    for line, truth in FULL.items():
        assert fit.amplitude(line).value == pytest.approx(truth, abs=1e-3)
    assert heading_from_body_rate(fit.body_rate_dph[0].value) == pytest.approx(269.7, abs=0.01)
    judgement = judge(record, compensate(fit), fit)
    assert judgement.before.locked_arcsec == pytest.approx(10.7, abs=0.2)
    assert judgement.after.locked_arcsec <= 0.006


@pytest.mark.parametrize(
    ("lines", "stretches", "ripple"),
    [
        (PATENT_CLASS, HALF_HOUR, 0.0),
        (FULL, HALF_HOUR, 0.0),
        (FULL, reversing(32, 4, 6.0), 0.0),
        (FULL, HALF_HOUR, 0.05),
    ],
)
def test_locked_oscillation_of_another_run_falls_a_hundred_times(
    lines: dict[float, complex], stretches: list[tuple[float, float]], ripple: float
) -> None:
    table = replace(TABLE, ripple_once_ppm=1e6 * ripple)
    fitted, judged, twin = (
        emulate(Plan(stretches, Wobble(content), seed=seed, table=table, rate_hz=25, poll_s=5.0))[0]
        for content, seed in ((lines, 1), (lines, 2), ({}, 2))
    )
    fit = fit_direct([fitted])
    judgement = judge(judged, compensate(fit), fit)
    floor = without_compensation(twin, fit)
    assert judgement.before.locked_arcsec > 10.0
    assert judgement.locked_factor >= 100.0
    # the whirl-free twin: drift modulation 0.1 and what ARW leaves in half an hour
    assert judgement.after.locked_arcsec <= 1.15 * max(floor.locked_arcsec, 0.095)
    assert judgement.after.total_arcsec <= 1.05 * floor.total_arcsec


def test_the_patents_fit_holds_its_own_class_only() -> None:
    factors = []
    for lines in (PATENT_CLASS, FULL):
        fitted, judged = (
            emulate(Plan(HALF_HOUR, Wobble(lines), seed=seed, rate_hz=25, poll_s=5.0))[0] for seed in (1, 2)
        )
        fit = fit_direct([fitted])
        patent = fit_integral(fitted, 2, body_rate_dph=fit.body_rate_dph[0].value)
        judgement = judge(judged, compensate(fit), fit, patent)
        assert judgement.patent is not None
        factors.append(judgement.before.locked_arcsec / judgement.patent.locked_arcsec)
    assert factors[0] > 50.0
    assert 3.0 < factors[1] < 6.0  # the constant tilt stays


def left_by(record: TurnRecord, patent: np.ndarray, at: np.ndarray, tilt: np.ndarray) -> float:
    lines, amplitudes = body_lines(match_coefficients(patent))
    corrected = tilt - sum(a * np.exp(1j * m * at) for m, a in zip(lines, amplitudes, strict=True))
    return oscillation(corrected, record.time_s, record.angle_rad).locked_arcsec


def test_with_ripple_the_nominal_angle_is_worse_than_the_measured_one() -> None:
    table = TableParameters(ripple_once_ppm=5e4, encoder_noise_arcsec=2.0)
    record, _ = emulate(Plan(HALF_HOUR, Wobble(PATENT_CLASS), table=table, rate_hz=25, poll_s=5.0))
    fit = fit_direct([record])
    earth = fit.body_rate_dph[0].value
    tilt = judge(record, compensate(fit), fit).tilt_before
    nominal = nominal_angle(record)
    measured = left_by(record, fit_integral(record, 2, body_rate_dph=earth), record.angle_rad, tilt)
    at_nominal = left_by(
        record, fit_integral(record, 2, body_rate_dph=earth, angle_rad=nominal), nominal, tilt
    )
    assert at_nominal > 2.0 * measured


def test_play_is_a_jump_that_is_fitted() -> None:
    wobble = Wobble(FULL, play_arcsec=5.0)
    fitted, judged = (
        emulate(Plan(reversing(32, 4, 6.0), wobble, seed=seed, rate_hz=25, poll_s=5.0))[0] for seed in (1, 2)
    )
    fit = fit_direct([fitted])
    assert fit.play_arcsec is not None
    assert fit.play_arcsec.value == pytest.approx(5.0, abs=4.0 * fit.play_arcsec.sd)
    ignoring = fit_direct([fitted], play=False)
    assert judge(judged, compensate(fit), fit).after.total_arcsec <= 0.43
    assert 0.6 <= judge(judged, compensate(ignoring), ignoring).after.total_arcsec <= 1.0


def test_angle_between_polls_comes_from_the_z_gyro() -> None:
    """Telemetry once a second, a table that ripples by 5 %: the angle with the gyro and without."""
    table = TableParameters(ripple_once_ppm=5e4, encoder_error_arcsec=0.0)
    plan = Plan(TEN_TURNS, Wobble(), table=table)
    record, turns = emulate(plan)
    truth = _true_angle(plan, record.time_s)
    error = np.degrees(record.angle_rad - truth) * 3600.0
    assert np.abs(error).max() < 20.0  # 1e-4 rad: 0.001 arcsec of a tilt of 10
    assert turns.alignment.latency_s == pytest.approx(0.002, abs=1e-4)
    assert turns.alignment.scale_error_ppm == pytest.approx(20.0, abs=5.0)
    assert abs(turns.alignment.clock_error_ppm or 99.0) < 1.0
    poll_s = np.arange(32.0, 629.0)
    linear = np.interp(record.time_s[300:-300], poll_s, _true_angle(plan, poll_s))
    assert np.abs(linear - truth[300:-300]).max() * 206265.0 > 10.0


def _true_angle(plan: Plan, time_s: np.ndarray) -> np.ndarray:
    from simulators.plant import TableAxis

    axis = TableAxis(plan.table)
    axis.servo(0.0, True)
    axis.demand_rate(plan.rest_s, 6.0)
    return np.radians([axis.total_angle_deg(float(t)) for t in time_s])


def test_installation_angles_that_are_known_are_taken_out_of_line_one() -> None:
    """Of a unit whose x and y gyros lie 2 and -1 arcsec towards z the constant tilt is found, not its sum."""
    plan = Plan(TEN_TURNS, Wobble(FULL, misalignment_arcsec=(2.0, -1.0)), without=QUIET, table=STILL)
    record, _ = emulate(plan)
    known = corrected(record, (2.0, -1.0))
    assert fit_direct([known]).amplitude(1.0).value == pytest.approx(FULL[1.0], abs=1e-3)
    assert abs(fit_direct([record]).amplitude(1.0).value - FULL[1.0]) == pytest.approx(np.sqrt(5.0), abs=1e-2)
