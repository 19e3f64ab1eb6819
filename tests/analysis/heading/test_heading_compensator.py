"""The compensation in real time: chunks, restart, gaps, limits; and what the checks name."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.heading import (
    HeadingCompensator,
    LaggedModel,
    PlatformLog,
    PositionCorrector,
    fit_reference,
    integrate,
    regressors,
    stays,
)
from bench.analysis.heading._checks import STUCK_S, check_log, check_phase, phase_offset_deg, refuse_unsound
from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import Evidence, fit_lagged
from bench.analysis.heading._log import Site, log_from_positions, settled
from bench.analysis.heading._temperature import ReferenceTemperature
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import ConfigurationError, RecordError

GOOD = Evidence(none=1e4, temperature=100.0, steps=1e3, other_share=0.0, residual=0.4)
REFERENCE = ReferenceTemperature(np.array([45.0, 0.3, 0.1, 0.0, -0.05]), 0.003, 0.0)
GAIN = np.random.default_rng(2).standard_normal((3, 5)) * 1e-3
TIME_S = 60.0 * np.arange(2000)
ANGLE = 0.7 + EARTH_RATE_RAD_S * TIME_S
TEMP = 45.0 + np.cumsum(np.random.default_rng(3).standard_normal(2000)) * 0.01


def model(form: str = "lag15") -> LaggedModel:
    count = 5 if form == "lag15" else 3
    return LaggedModel(
        form=form,  # type: ignore[arg-type]
        gain=GAIN[:, :count],
        sigma=np.full((3, count), 1e-5),
        tau_s=6.0 * 3600.0,
        reference=REFERENCE,
        reference_heading_deg=0.0,
        latitude_deg=40.0,
        largest=np.full(count, 1.0),
        swing=np.zeros((3, 4)),
        evidence=GOOD,
        headings=5,
        hours=288.0,
    )


@pytest.mark.parametrize("form", ["lag9", "lag15"])
def test_forward_equals_the_fit_s_own_regressors(form: str) -> None:
    one = HeadingCompensator(model(form)).feed(TIME_S, ANGLE, TEMP)
    drift = regressors(ANGLE, TEMP, 60.0, REFERENCE, 6.0 * 3600.0, form) @ model(form).gain.T  # type: ignore[arg-type]
    np.testing.assert_allclose(one.drift_dph, drift, atol=1e-15)
    np.testing.assert_allclose(one.phi_as, integrate(TIME_S, drift), atol=1e-10)
    assert not one.held.any()


@given(cuts=st.lists(st.integers(0, 2000), max_size=6))
@settings(max_examples=15, deadline=None)
def test_chunks_change_nothing(cuts: list[int]) -> None:
    whole = HeadingCompensator(model()).feed(TIME_S, ANGLE, TEMP)
    running = HeadingCompensator(model())
    edges = [0, *sorted(cuts), 2000]
    parts = []
    for start, stop in pairwise(edges):
        parts.append(running.feed(TIME_S[start:stop], ANGLE[start:stop], TEMP[start:stop]).phi_as)
    np.testing.assert_array_equal(np.concatenate(parts), whole.phi_as)


def test_causal() -> None:
    later = TEMP.copy()
    later[1200:] += 1.0
    one, two = (HeadingCompensator(model()).feed(TIME_S, ANGLE, each).phi_as for each in (TEMP, later))
    np.testing.assert_array_equal(one[:1200], two[:1200])
    assert not np.allclose(one[1300:], two[1300:])


def test_a_missing_temperature_is_held_two_hours_then_let_go() -> None:
    level = HeadingCompensator(model("lag9"))
    change = np.where(np.arange(2000) < 1000, 1.0, np.nan)
    done = level.feed(TIME_S, ANGLE, REFERENCE.at(ANGLE) + change)
    x = np.linalg.lstsq(GAIN[:, :3], done.drift_dph.T, rcond=None)[0][0]
    np.testing.assert_allclose(x[:1120], 1.0, atol=1e-9)
    age = TIME_S[1122:] - TIME_S[1120]
    np.testing.assert_allclose(x[1122:], np.exp(-age / (6 * 3600.0)), rtol=0.01)
    assert done.held[1000:].all() and not done.held[:1000].any()


def test_outside_the_calibrated_range_is_flagged() -> None:
    temp = REFERENCE.at(ANGLE) + np.where(np.arange(2000) < 1000, 0.5, 3.0)
    done = HeadingCompensator(model("lag9")).feed(TIME_S, ANGLE, temp)
    assert not done.outside[:1000].any()
    assert done.outside[-1]


def test_refusals_of_the_compensator() -> None:
    with pytest.raises(ConfigurationError, match=r"another latitude.*47\.00 deg"):
        HeadingCompensator(model(), 47.0)
    with pytest.raises(RecordError, match="time goes back"):
        HeadingCompensator(model()).feed(TIME_S[::-1], ANGLE, TEMP)


def test_latitude_scales_the_rectified_part() -> None:
    one, two = (HeadingCompensator(model("lag9"), at).feed(TIME_S, ANGLE, TEMP) for at in (40.0, 42.0))
    terms = regressors(ANGLE, TEMP, 60.0, REFERENCE, 6.0 * 3600.0, "lag9")
    extra = (np.cos(np.radians(42.0)) / np.cos(np.radians(40.0)) - 1.0) * terms[:, 1:] @ GAIN[:, 1:3].T
    np.testing.assert_allclose(two.drift_dph - one.drift_dph, extra, atol=1e-12)


def test_position_correction_is_late_and_chunk_free() -> None:
    phi = np.stack([TIME_S * 1e-3, TIME_S * -2e-3, np.sin(TIME_S / 9000.0)], axis=1)
    whole = PositionCorrector(40.0, 807.0).correction(TIME_S, ANGLE, phi)
    parts = PositionCorrector(40.0, 807.0)
    pieces = [
        parts.correction(TIME_S[a:b], ANGLE[a:b], phi[a:b])
        for a, b in ((0, 5), (5, 6), (6, 700), (700, 2000))
    ]
    np.testing.assert_allclose(np.concatenate([piece[0] for piece in pieces]), whole[0], atol=1e-9)
    seen = np.stack([np.interp(TIME_S - 807.0, TIME_S, column) for column in phi.T], axis=1)
    expected = position_error(seen, ANGLE - 807.0 * EARTH_RATE_RAD_S, 40.0)
    np.testing.assert_allclose(whole, expected, atol=1e-9)


# What is wrong with a log


def named(log: PlatformLog, **keywords: object) -> str:
    findings = check_log(log, **keywords)  # type: ignore[arg-type]
    with pytest.raises(RecordError) as refused:
        refuse_unsound(findings, "log.csv")
    return str(refused.value)


def test_a_sound_log_has_no_findings(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    assert check_log(calibration[1]) == []
    assert [round(stay.heading_deg) for stay in stays(calibration[1])] == [0, 60, 120, 180, 240, 300]


@pytest.mark.parametrize(
    ("row_s", "turn_dps"), [(1.0, 1.0), (0.1, 6.0), (10.0, 0.15), (1.0, 30.0), (60.0, 30.0)]
)
def test_a_slow_turn_parts_two_stays(row_s: float, turn_dps: float) -> None:
    """An hour at 350, 80, 170 and 81.5 deg, turned at a rate in between, however far apart the rows are."""
    goals, time_s, heading = (440.0, 530.0, 441.5), 3600.0, [(0.0, 350.0), (3600.0, 350.0)]
    for goal in goals:
        time_s += abs(goal - heading[-1][1]) / turn_dps
        heading += [(time_s, goal), (time_s + 3600.0, goal)]
        time_s += 3600.0
    rows_s = np.arange(0.0, time_s, row_s)
    log = PlatformLog(
        rows_s, 7.3e-5 * rows_s, 0.0 * rows_s, 0.0 * rows_s, 0.0 * rows_s + 20.0,
        np.interp(rows_s, *np.array(heading).T) % 360.0, 40.0,
    )  # fmt: skip
    found = stays(log)
    assert [round(stay.heading_deg, 3) for stay in found] == pytest.approx(
        [350.0, 80.0, 170.0, 81.5], abs=0.1
    )
    assert [stay.duration_s for stay in found] == pytest.approx([3600.0] * 4, abs=60.0 + 2.0 * row_s)
    calm = settled(log, 1200.0)
    assert calm.mean() == pytest.approx(1.0 - 3 * 1200.0 / time_s, abs=0.05)


def test_stuck_sensor(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    temp = calibration[1].temp_c.copy()
    temp[1000:2500] = temp[1000]
    text = named(replace(calibration[1], temp_c=temp))
    assert "stuck" in text and "124.9 h" in text and "no temperature change" in text


def test_a_slow_temperature_in_coarse_digits_is_not_stuck(
    calibration: tuple[PlatformLog, PlatformLog],
) -> None:
    """Where it turns, a swing of 0.1 K a day stays for hours within a digit of 0.05 K."""
    run = calibration[1]
    still = run.time_s > run.time_s[2000]
    swing = 60.0 + 0.1 * np.sin(2.0 * np.pi * run.time_s / 86_400.0)
    temp = 0.05 * np.round(np.where(still, swing, run.temp_c) / 0.05)
    changes_s = run.time_s[np.flatnonzero(np.diff(temp))]
    assert np.diff(changes_s).max() > STUCK_S
    assert not any("stuck" in finding.what for finding in check_log(replace(run, temp_c=temp)))


def test_swapped_sensors(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    run = calibration[1]
    room = 25.0 + 0.05 * np.random.default_rng(1).standard_normal(len(run.time_s))
    text = named(replace(run, temp_c=room), other_temp_c=run.temp_c)
    assert "look swapped" in text
    assert "does not change with heading" in named(replace(run, temp_c=room))
    assert check_log(run, other_temp_c=room) == []


def test_jump_of_the_position(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    east = calibration[1].east_as.copy()
    east[1700:] -= east[1700]
    text = named(replace(calibration[1], east_as=east))
    assert "longitude jumps 1 times" in text and "141.67 h" in text and "taken for drift" in text


def test_too_few_headings_and_short_reference(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    assert "2 steady headings" in named(calibration[1].part(0, 3 * 576))
    assert "no full sidereal day" in named(calibration[1].part(400, 3456))


def test_warm_up_is_declared(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    run = calibration[1]
    warming = run.temp_c - 4.0 * np.exp(-(run.time_s - run.time_s[0]) / (12 * 3600.0))
    findings = check_log(replace(run, temp_c=warming))
    assert any("still moved" in finding.what and not finding.refuse for finding in findings)


def test_missing_positions_are_declared(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    north = calibration[1].north_as.copy()
    north[100:1500] = np.nan
    findings = check_log(replace(calibration[1], north_as=north))
    assert [finding.refuse for finding in findings] == [False]
    assert "59 %" in findings[0].what


@pytest.mark.parametrize("offset_deg", [0.0, 20.0, -40.0])
def test_clock_offset_of_the_sidereal_angle(
    calibration: tuple[PlatformLog, PlatformLog], offset_deg: float
) -> None:
    alignment, run = calibration
    model_ = fit_lagged(run, reference=fit_reference(alignment.sidereal_rad, alignment.temp_c))
    at = slice(0, 576)
    angle = run.sidereal_rad[at] + np.radians(offset_deg)
    found, sigma = phase_offset_deg(model_.reference, angle, run.temp_c[at])
    assert found == pytest.approx(offset_deg, abs=max(2.0, 3.0 * sigma))
    if offset_deg:
        with pytest.raises(RecordError, match=r"clock were [+-]\d+ min wrong.*leave \d+ % of it"):
            check_phase(model_.reference, angle, run.temp_c[at])
    else:
        check_phase(model_.reference, angle, run.temp_c[at])


def test_gaps_in_the_record_do_not_move_the_fit(calibration: tuple[PlatformLog, PlatformLog]) -> None:
    alignment, run = calibration
    reference = fit_reference(alignment.sidereal_rad, alignment.temp_c)
    keep = np.random.default_rng(6).random(len(run.time_s)) > 0.1
    keep[800:860] = False
    columns = (run.time_s, run.sidereal_rad, run.north_as, run.east_as, run.temp_c, run.heading_deg)
    holed = PlatformLog(*(column[keep] for column in columns), run.latitude_deg)
    whole, less = (fit_lagged(each, reference=reference) for each in (run, holed))
    assert less.tau_s == pytest.approx(whole.tau_s, rel=0.05)
    assert np.abs(less.gain - whole.gain).max() < 0.1 * np.abs(whole.gain).max()


def test_wrong_columns_are_named() -> None:
    time_s = np.array([0.0, 60.0, 60.0])
    with pytest.raises(RecordError, match="1 steps back in time"):
        log_from_positions(time_s, *[np.zeros(3)] * 4, site=Site(40.0, 0.0))
