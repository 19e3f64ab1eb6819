"""Time constants of the temperature, the accelerometers' modulus, and a second temperature as an input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.analysis.heading import (
    HeadingCompensation,
    HeadingCompensator,
    PlatformLog,
    load_log,
    study_heading,
)
from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import choose_input, fit_lagged
from bench.analysis.heading._log import Site, WarmUp, stays
from bench.analysis.heading._modulus import modulus_test
from bench.analysis.heading._settling import TimeConstant, settling, time_constant
from bench.present.cli.fit._motion import heading_effect
from benchmarks._heading_plants import CALIBRATIONS
from benchmarks.off_class._heading_plants import FAMILIES
from benchmarks.off_class._heading_plants import fly as fly_other
from benchmarks.off_class.heading import reduction
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import RecordError
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform

Fly = Callable[..., tuple[PlatformLog, PlatformLog, SpaceStablePlatform]]
HOUR = 3600.0
LATITUDE = np.radians(40.0)


def cold(tau_h: float, hours: float, seed: int = 0, *, second_h: float = 0.0) -> WarmUp:
    """A start 15 K below: closed form, a day's swing of 0.3 K, a sensor of 3 mK and no room."""
    time_s = np.arange(0.0, hours * HOUR, 300.0)
    angle = 0.4 + EARTH_RATE_RAD_S * time_s
    temp = 45.0 + 0.3 * np.cos(angle) - 15.0 * np.exp(-time_s / (tau_h * HOUR))
    if second_h:
        temp -= 3.0 * np.exp(-time_s / (second_h * HOUR))
    return WarmUp(time_s, angle, temp + 0.003 * np.random.default_rng(seed).standard_normal(len(time_s)))


def test_a_start_up_curve_gives_its_time_constant() -> None:
    for tau_h in (3.0, 12.0, 20.0):
        found = time_constant([cold(tau_h, 96.0)])
        assert found is not None
        assert found.tau_s / HOUR == pytest.approx(tau_h, abs=4.0 * found.sigma_s / HOUR)
        assert found.sigma_s / HOUR < 0.05 and found.change_k == pytest.approx(-15.0, abs=0.2)
    steady = cold(12.0, 96.0)
    still = replace(steady, temp_c=steady.temp_c + 15.0 * np.exp(-steady.time_s / (12.0 * HOUR)))
    assert time_constant([still]) is None
    assert time_constant([cold(12.0, 20.0)]) is None  # shorter than what the sidereal angle needs


def test_start_up_and_turns_are_told_with_sigmas_that_hold(fly: Fly) -> None:
    scores, apart = [], 0
    for seed in range(14):
        parameters = replace(draw_platform(seed), start_k=-15.0)
        alignment, run, _ = fly(parameters, seed, tuple((60.0 * k, 48.0) for k in range(6)))
        begun = WarmUp(alignment.time_s[:1152], alignment.sidereal_rad[:1152], alignment.temp_c[:1152])
        found = settling(replace(run, warm_up=begun), TimeConstant(5.0 * HOUR, HOUR, 0.0))
        assert found.start_up is not None and found.turns is not None
        assert found.slowest_s == found.start_up.tau_s
        apart += bool(found.findings())
        scores += [
            (tau.tau_s - HOUR * parameters.tau_h) / tau.sigma_s for tau in (found.start_up, found.turns)
        ]
    # the start-up's sigma is on the careful side, that of the turns holds
    assert 0.3 < np.sqrt(np.mean(np.square(scores[::2]))) < 1.5
    assert 0.6 < np.sqrt(np.mean(np.square(scores[1::2]))) < 1.5
    assert apart == 0


def test_a_start_up_unlike_the_turns_is_a_finding(fly: Fly) -> None:
    parameters = draw_platform(3)
    run = fly(parameters, 3, tuple((60.0 * k, 48.0) for k in range(6)))[1]
    study = study_heading(replace(run, warm_up=cold(4.0, 96.0)), {})
    told = [finding.what for finding in study.findings if "after power-on" in finding.what]
    assert len(told) == 1 and "settled with 4.0 +- 0.0 h" in told[0]
    # stays have to outlast the slower: the drift's 5.5 h behind, not the 4 h of this start
    assert study.settling.slowest_s == study.model.tau_s > 4.0 * HOUR


def test_stays_are_held_against_the_start_up_curve_and_the_window(fly: Fly) -> None:
    run = fly(draw_platform(3), 3, tuple((60.0 * k, 48.0) for k in range(6)))[1]
    day_s = 23.93447 * HOUR
    for tau_h, short in ((20.0, False), (32.0, True)):
        study = study_heading(replace(run, warm_up=cold(tau_h, 192.0)), {}, window_s=day_s)
        told = [
            finding.what
            for finding in study.findings
            if "shorter than time constant and window" in finding.what
        ]
        assert bool(told) is short
    assert "than time constant and window, 55.9 h" in told[0] and study.nine is not None


def test_the_warm_up_of_a_record_is_its_start_up_curve(tmp_path: Path) -> None:
    begun = cold(12.0, 200.0)
    columns = {
        "time_s": begun.time_s,
        "latitude_deg": np.zeros(len(begun.time_s)),
        "longitude_deg": np.zeros(len(begun.time_s)),
        "temp_c": begun.temp_c,
        "heading_deg": np.where(begun.time_s < 150.0 * HOUR, 0.0, 90.0),
        "valid": (begun.time_s >= 100.0 * HOUR).astype(np.float64),
    }
    pq.write_table(
        pa.table({name: pa.array(values) for name, values in columns.items()}), tmp_path / "log.parquet"
    )
    log = load_log(tmp_path / "log.parquet", Site(0.0, 0.0))[0]
    assert log.warm_up is not None
    assert log.warm_up.time_s[0] == 0.0 and log.warm_up.time_s[-1] == pytest.approx(150.0 * HOUR, abs=301.0)
    found = settling(log, TimeConstant(HOUR, HOUR, 0.0)).start_up
    assert found is not None and found.tau_s / HOUR == pytest.approx(12.0, abs=0.05)


def with_force(
    log: PlatformLog, seed: int, bias_ug: dict[float, tuple[float, float, float]], tilt_as: float = 0.0
) -> PlatformLog:
    """Specific force from rotation of the vertical through the axes; biases by heading, all wandering by 2 ug."""
    random = np.random.default_rng(seed)
    level, up = np.cos(LATITUDE), np.sin(LATITUDE)
    count = len(log.time_s)
    force = 9.80 * np.stack(
        [level * np.cos(log.sidereal_rad), level * np.sin(log.sidereal_rad), np.full(count, up)], axis=1
    )
    turn = tilt_as * np.pi / 648000.0 * (log.heading_deg != 0.0)
    turned = np.stack([np.zeros(count), force[:, 2], -force[:, 1]], axis=1)  # about x
    force = force * np.cos(turn)[:, None] + turned * np.sin(turn)[:, None]
    force[:, 0] = force[:, 0] / np.cos(turn)
    keep = np.exp(-300.0 / (20.0 * HOUR))
    wander = np.zeros((count, 3))
    steps = np.sqrt(1.0 - keep**2) * random.standard_normal((count, 3))
    wander[0] = random.standard_normal(3)
    for k in range(1, count):
        wander[k] = keep * wander[k - 1] + steps[k]
    own = np.array([bias_ug.get(heading, (0.0, 0.0, 0.0)) for heading in log.heading_deg])
    ug = np.array([30.0, -20.0, 10.0]) + 2.0 * wander + 5.0 * random.standard_normal((count, 3)) + own
    return replace(log, force_mps2=force + 9.7803267715e-6 * ug)


def test_the_modulus_finds_the_accelerometers_and_no_tilt(fly: Fly) -> None:
    log = fly(draw_platform(3), 3, tuple((60.0 * k, 48.0) for k in range(6)))[1]
    found = modulus_test(with_force(log, 1, {120.0: (40.0, -25.0, 10.0)}))
    assert found is not None and found.changed
    at = found.headings_deg.index(120.0)
    level, up = np.cos(LATITUDE), np.sin(LATITUDE)
    expected = np.array([10.0 * up, 40.0 * level, -25.0 * level])
    assert (np.abs(found.change_ug[at] - expected) < 4.0 * found.sigma_ug[at]).all()
    assert (found.sigma_ug < 4.0).all()
    others = np.delete(found.p_value, at)
    assert others.min() > 0.01 / 5
    (finding,) = found.findings()
    assert (
        "at 120 deg" in finding.what and "no tilt can do that" in finding.consequence and not finding.refuse
    )
    # A tilt of a degree with heading turns the specific force and leaves its modulus.
    tilted = modulus_test(with_force(log, 1, {}, tilt_as=3600.0))
    assert tilted is not None and not tilted.changed
    # A scale factor of one axis that goes with heading shows twice a turn too, and in the mean.
    scaled = with_force(log, 1, {})
    assert scaled.force_mps2 is not None
    bent = np.where((log.heading_deg == 60.0)[:, None], [1.0, 1.0, 1.0 + 60e-6], 1.0)
    third = modulus_test(replace(scaled, force_mps2=scaled.force_mps2 * bent))
    assert third is not None and third.changed
    assert third.change_ug[0, 0] == pytest.approx(
        60.0 * up**2 * 9.80 / 9.7803267715, abs=4.0 * third.sigma_ug[0, 0]
    )


def test_the_modulus_gives_few_false_alarms(fly: Fly) -> None:
    log = fly(draw_platform(4), 4, tuple((60.0 * k, 48.0) for k in range(6)))[1]
    tests = [modulus_test(with_force(log, seed, {})) for seed in range(100, 112)]
    assert sum(bool(test and test.changed) for test in tests) <= 1  # 1 % asked of each
    squares = np.concatenate([(test.change_ug / test.sigma_ug).ravel() ** 2 for test in tests if test])
    assert 0.7 < squares.mean() < 1.4


def test_no_modulus_from_what_is_none(fly: Fly) -> None:
    log = fly(draw_platform(4), 4, tuple((60.0 * k, 48.0) for k in range(6)))[1]
    assert modulus_test(log) is None
    forced = with_force(log, 1, {})
    with pytest.raises(RecordError, match=r"not gravity's.*1\.0000 m/s.*their unit"):
        modulus_test(replace(forced, force_mps2=forced.force_mps2 / 9.80))
    with pytest.raises(RecordError, match="cannot be compared between headings"):
        modulus_test(forced.part(0, 500))


@pytest.mark.parametrize(
    ("family", "used", "cause"),
    [
        ("sensor elsewhere", True, "temperature"),
        ("hidden gradient", True, "temperature"),
        ("convection", False, "temperature"),
        ("friction and magnet", True, "unexplained"),
    ],
)
def test_a_second_sensor_is_used_where_stays_left_out_say_so(family: str, used: bool, cause: str) -> None:
    log = fly_other(FAMILIES[family], 0, 10_000, CALIBRATIONS["5+1"]).log
    choice = choose_input(log)
    assert choice is not None and (choice.kind is not None) is used
    assert {len(left) for left in choice.left_out_as.values()} == {5}
    model = fit_lagged(log, second=choice.kind)
    assert model.evidence.cause == cause
    assert len(model.terms) == model.gain.shape[1] == (6 if used else 3)
    if used and cause == "temperature":
        alone = fit_lagged(log)
        assert alone.evidence.cause != "temperature"
        reached = [reduction(FAMILIES[family], model, 0, test)[0] for test in (0, 1)]
        assert min(reached) > 80.0


def test_a_random_second_sensor_is_not_used() -> None:
    log = fly_other(FAMILIES["convection"], 1, 10_001, CALIBRATIONS["5+1"]).log
    random = np.random.default_rng(5)
    walk = np.cumsum(random.standard_normal(len(log.time_s))) * 0.02
    choice = choose_input(replace(log, second_c=20.0 + walk))
    assert choice is not None and choice.kind is None
    # Three stays beside the reference: none can be left out and still leave three.
    few = log.part(0, 4 * 48 * 12)
    short = choose_input(few)
    assert short is not None and short.kind is None and not short.left_out_as


def test_a_model_of_two_sensors_runs_in_pieces_and_from_its_file(tmp_path: Path) -> None:
    flight = fly_other(FAMILIES["hidden gradient"], 0, 10_000, CALIBRATIONS["5+1"]).log
    model = fit_lagged(flight, second="gradient")
    HeadingCompensation.from_fit(model, "PINS-1", {}).save(tmp_path / "two.gyrocomp")
    restored = HeadingCompensation.load(tmp_path / "two.gyrocomp").model
    assert flight.second_c is not None
    whole = HeadingCompensator(model).feed(flight.time_s, flight.sidereal_rad, flight.temp_c, flight.second_c)
    pieces = HeadingCompensator(restored)
    cuts = np.split(np.arange(len(flight.time_s)), [1, 7, 1000])
    made = [
        pieces.feed(
            flight.time_s[rows], flight.sidereal_rad[rows], flight.temp_c[rows], flight.second_c[rows]
        )
        for rows in cuts
    ]
    np.testing.assert_allclose(np.concatenate([part.phi_as for part in made]), whole.phi_as, atol=1e-12)
    # The same drift by the regressors' own formula, lag by an explicit recursion.
    assert model.second is not None
    signal = flight.second_c - flight.temp_c - model.second.reference.at(flight.sidereal_rad)
    ratio = 300.0 / model.second.tau_s
    x, decay = np.empty_like(signal), np.exp(-ratio)
    x[0] = signal[0]
    for k in range(1, len(x)):
        slope = (signal[k] - signal[k - 1]) / ratio
        x[k] = signal[k] - slope + (x[k - 1] - signal[k - 1] + slope) * decay
    rows = np.stack([x, x * np.cos(flight.sidereal_rad), x * np.sin(flight.sidereal_rad)], axis=1)
    alone = HeadingCompensator(
        replace(model, gain=model.gain[:, :3], largest=model.largest[:3], second=None)
    ).feed(flight.time_s, flight.sidereal_rad, flight.temp_c)
    np.testing.assert_allclose(whole.drift_dph - alone.drift_dph, rows @ model.gain[:, 3:].T, atol=1e-12)
    with pytest.raises(RecordError, match=r"needs a second temperature.*--column"):
        HeadingCompensator(model).feed(flight.time_s, flight.sidereal_rad, flight.temp_c)


def test_the_lag_behind_a_second_sensor_is_found() -> None:
    """The family's own physics: the drift follows the second sensor by a lag that it draws first."""
    log = fly_other(FAMILIES["sensor elsewhere"], 2, 10_002, CALIBRATIONS["5+1"]).log
    drawn_h = np.random.default_rng((2, 2)).uniform(2.0, 5.0)
    model = fit_lagged(log, second="temperature")
    assert model.second is not None
    assert model.second.tau_s / HOUR == pytest.approx(drawn_h, rel=0.15)


def test_what_comes_after_a_stay_left_out_does_not_tell_of_it() -> None:
    log = fly_other(FAMILIES["hidden gradient"], 0, 10_000, CALIBRATIONS["5+1"]).log
    turned = stays(log)[2]
    north, east = position_error(np.array([[40.0, -30.0, 20.0]]), log.sidereal_rad, log.latitude_deg)
    later = np.arange(len(log.time_s)) >= turned.stop
    moved = replace(log, north_as=log.north_as + north * later, east_as=log.east_as + east * later)
    before, after = (choose_input(each) for each in (log, moved))
    assert before is not None and after is not None
    for kind, left in before.left_out_as.items():
        # a step of 54 arcsec after the stay; with what follows fixed to it, it would show in the stay
        assert after.left_out_as[kind][1] == pytest.approx(left[1], abs=1.0)


def test_a_second_sensor_that_dies_is_held_and_let_go() -> None:
    flight = fly_other(FAMILIES["hidden gradient"], 0, 10_000, CALIBRATIONS["5+1"]).log
    model = fit_lagged(flight, second="temperature")
    assert flight.second_c is not None

    def drift(missing: int) -> np.ndarray:
        assert flight.second_c is not None
        dead = flight.second_c.copy()
        dead[2000 : 2000 + missing] = np.nan
        done = HeadingCompensator(model).feed(flight.time_s, flight.sidereal_rad, flight.temp_c, dead)
        assert done.held.sum() == missing and np.isfinite(done.phi_as).all()
        return done.drift_dph

    whole = drift(0)
    size = float(np.abs(whole).max())
    # for two hours, 24 samples, the last change is held; then it is let go with the lag of 1 h
    assert np.abs(drift(24) - whole).max() < 0.1 * size
    assert np.abs(drift(100) - whole)[2060:2100].max() > 0.2 * size


def test_the_command_tells_sensors_and_time_constants(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = fly_other(FAMILIES["hidden gradient"], 0, 10_000, CALIBRATIONS["5+1"]).log
    log = with_force(flight, 1, {300.0: (60.0, 0.0, 0.0)})
    assert log.second_c is not None and log.force_mps2 is not None
    level = np.cos(np.radians(log.latitude_deg))
    columns = {
        "time_s": log.time_s,
        "latitude_deg": log.north_as / 3600.0,
        "longitude_deg": 100.0 + log.east_as / 3600.0 / level,
        "temp_c": log.temp_c,
        "flange_c": log.second_c,
        "heading_deg": log.heading_deg,
        **{f"accelerometer_{axis}_mps2": log.force_mps2[:, k] for k, axis in enumerate("xyz")},
    }
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)
    loaded = load_log(path, Site(0.0, 100.0), {"second_temp_c": "flange_c"})[0]
    np.testing.assert_array_equal(loaded.second_c, log.second_c)
    np.testing.assert_array_equal(loaded.force_mps2, log.force_mps2)
    out = tmp_path / "fit"
    with pytest.raises(
        SystemExit
    ):  # the latitude is not the one that it was flown at: the fit finds no cause
        heading_effect(path, 0.0, 100.0, [], out, ["second_temp_c=flange_c"], window_h=23.93447)
    told = capsys.readouterr().err + (out / "report.html").read_text(encoding="utf-8")
    assert "Second temperature" in told and "goes with heading: at 300 deg" in told
    assert "Temperature, after turns" in told
    incomplete = pq.read_table(path).drop_columns(["accelerometer_y_mps2"])
    pq.write_table(incomplete, path)
    with pytest.raises(RecordError, match=r"lacks columns.*accelerometer_y_mps2"):
        load_log(path, Site(0.0, 100.0))
