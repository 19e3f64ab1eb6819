"""From increments to parameters: navigation, filter, passes, options, and a record made by others."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from bench.analysis.calibration import (
    PARAMETER_NAMES,
    PARAMETERS,
    UNIT_SIZE,
    BiasWander,
    Calibration,
    CalibrationRun,
    Noise,
    Schedule,
    Site,
    Task,
    _calibrate,
    calibrate,
    load_scheme,
)
from bench.analysis.calibration._budget import parameter_budgets
from bench.analysis.calibration._conventions import pack, unpack
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._model import observability_matrix
from bench.analysis.calibration._navigation import Increments, navigate
from bench.analysis.calibration._schedule import parse_moves
from bench.analysis.common.attitude import cross_matrix
from bench.record.benchfile import Calibration as Certificate
from benchmarks._turned_imu import Rest, Turn, measure_motion
from drivers.base.constants import UG_MPS2
from drivers.base.errors import RecordError
from simulators.plant.imu import ImuErrors, ImuNoise

TASK = Task()
UNITS = UNIT_SIZE[PARAMETERS]
WHITE = ImuNoise(TASK.noise.arw, TASK.noise.vrw, vibration_mps=TASK.noise.velocity_mps)
PERFECT, QUIET = ImuErrors(), ImuNoise()
DPH = math.radians(1.0) / 3600.0
PSINS = Path("../shared/data/psins_sysclbt/imusysclbt.bin")


def scheme(name: str, dwell_s: float = 60.0) -> Schedule:
    return load_scheme(name).with_(dwell_s=dwell_s)


def record(
    schedule: Schedule,
    errors: ImuErrors = PERFECT,
    noise: ImuNoise = QUIET,
    seed: int = 0,
    *,
    axes: np.ndarray | None = None,
    home: np.ndarray | None = None,
    gravity_mps2: float = TASK.site.gravity_mps2,
) -> Increments:
    axes = np.eye(3) if axes is None else axes
    legs: list[Rest | Turn] = [Rest(schedule.dwell_s)]
    for move in schedule.moves:
        angle = math.radians(move.angle_deg)
        legs += [
            Turn(axes[move.axis], angle, schedule.turn_s(move), schedule.profile),
            Rest(schedule.dwell_s),
        ]
    home = schedule.home if home is None else home
    latitude = TASK.site.latitude_deg
    made = measure_motion(
        home, legs, errors, noise, latitude_deg=latitude, gravity_mps2=gravity_mps2, seed=seed
    )
    return Increments(made.period_s, made.angle_rad, made.velocity_mps)


def drawn(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(24) * TASK.prior_sigma[PARAMETERS]


def certificate(quantity: str, uncertainty: float, error: float = 0.0) -> Certificate:
    days = {"date": date(2026, 5, 4), "due": date(2027, 5, 4)}
    numbers = {"uncertainty": uncertainty, "error": error}
    return Certificate(quantity=quantity, instrument="x", certificate="C-7", **days, **numbers)


def errors_of(parameters: np.ndarray) -> ImuErrors:
    return ImuErrors(*unpack(parameters))


def test_a_perfect_imu_stays_at_rest_through_23_positions() -> None:
    schedule = scheme("23-position")
    track = navigate(record(schedule), schedule.home, TASK.site)
    assert np.abs(track.velocity).max() < 1e-6


def test_transition_along_a_track_is_the_one_the_scheme_was_evaluated_with() -> None:
    schedule = Schedule("t", parse_moves("+x -y180 +z"), np.eye(3), 20.0)
    track = navigate(record(schedule), schedule.home, TASK.site)
    reached, rows = np.eye(6, 30), []
    for step in track.transition[:, :, :30]:
        reached = np.hstack([np.zeros((6, 6)), step[:, 6:]]) + step[:, :6] @ reached
        rows.append(reached[3:])
    turned = np.concatenate([np.zeros(20, bool), np.ones(9, bool), np.zeros(20, bool), np.ones(18, bool)])
    resting = ~np.concatenate([turned, np.zeros(20, bool), np.ones(9, bool), np.zeros(20, bool)])
    ours = np.concatenate([np.array(rows)[resting]]).reshape(-1, 30)
    expected = observability_matrix(TASK.site, schedule)[3:]
    assert np.max(np.abs(ours - expected) / np.abs(expected).max(axis=0)) < 2e-5


@pytest.mark.parametrize("name", ["23-position", "19-position"])
def test_parameters_of_a_noise_free_imu_are_found(name: str) -> None:
    truth = drawn(1)
    found = estimate(record(scheme(name), errors_of(truth)), TASK, Options(passes=4), scheme(name))
    error = np.abs(found.parameters - truth) / UNITS
    limits = np.repeat([1.3e-4, 0.03, 0.027, 0.027, 0.035], [3, 3, 9, 6, 3]) * 3.0
    assert np.all(error < limits), dict(zip(PARAMETER_NAMES, error / limits, strict=True))
    assert len(found.course) == scheme(name).positions


def test_errors_are_as_large_as_their_sigma_says() -> None:
    squares, innovations = [], []
    for seed in range(3):
        truth = drawn(100 + seed)
        found = estimate(
            record(scheme("19-position"), errors_of(truth), WHITE, seed), TASK, Options(passes=2)
        )
        error = found.parameters - truth
        squares.append(error @ np.linalg.solve(found.covariance, error))
        innovations.append(found.innovation_rms)
    assert chi2.ppf(0.001, 72) < sum(squares) < chi2.ppf(0.999, 72)
    assert innovations == pytest.approx([1.0] * 3, abs=0.03)


def test_an_error_of_gravity_goes_into_the_accelerometer_scale_factors_only() -> None:
    twice = Options(passes=2)
    clean = estimate(record(scheme("23-position")), TASK, twice)
    shifted = estimate(
        record(scheme("23-position"), gravity_mps2=TASK.site.gravity_mps2 + 50e-5), TASK, twice
    )
    change = shifted.parameters - clean.parameters
    diagonal = [PARAMETER_NAMES.index(name) for name in ("Ka_xx", "Ka_yy", "Ka_zz")]
    # More gravity than assumed reads as larger scale factors; 50 mGal of 9.8069 m/s^2 are 50.98 ppm.
    np.testing.assert_allclose(change[diagonal] / 1e-6, 50.98, atol=0.1)
    others = np.delete(np.arange(24), diagonal)
    assert np.abs(change[others] / clean.sigma[others]).max() < 0.05


@pytest.mark.parametrize(("rates", "names"), [(True, "Kg"), (False, "Ka")], ids=["rates", "increments"])
def test_a_time_base_off_by_200_ppm_is_a_scale_factor_as_the_budgets_have_it(rates: bool, names: str) -> None:
    """Of the gyros where the unit sends rates, of the accelerometers where it sends increments."""
    data, twice = record(scheme("23-position")), Options(passes=2)
    clean = estimate(data, TASK, twice)
    scale = 1.0 + 200e-6
    kept = scale if rates else 1.0
    wrong = Increments(data.period_s * scale, data.angle_rad * kept, data.velocity_mps * kept)
    change = estimate(wrong, TASK, twice).parameters - clean.parameters
    diagonal = [PARAMETER_NAMES.index(f"{names}_{axis}{axis}") for axis in "xyz"]
    budgets = parameter_budgets(clean, TASK.site.gravity_mps2, np.zeros(24))
    for number in diagonal:
        parts = {part.source: part for part in budgets[PARAMETER_NAMES[number]].contributions}
        told = 200.0 * parts["time_base_ppm"].sensitivity
        assert abs(change[number] / UNITS[number]) == pytest.approx(told, rel=0.02)


def test_the_budgets_of_a_calibration_have_gravity_and_time_base_beside_the_noise() -> None:
    """A certificate of 1 mGal and 2 ppm, k = 2: 0.05 and 1 ppm; gravity told too high by 10 mGal is taken off."""
    clean = estimate(record(scheme("23-position")), TASK, Options(passes=2))
    told = [certificate("gravity_mps2", 1e-5, 1e-4), certificate("time_base_ppm", 2.0)]
    budgets = parameter_budgets(clean, TASK.site.gravity_mps2, np.zeros(24), told)
    assert tuple(budgets) == PARAMETER_NAMES
    scale, bias = budgets["Ka_yy"], budgets["eps_y"]
    number = PARAMETER_NAMES.index("Ka_yy")
    sigma_ppm = clean.sigma[number] / 1e-6
    gravity_ppm = 1e6 * 0.5e-5 / TASK.site.gravity_mps2
    assert scale.combined == pytest.approx(math.hypot(sigma_ppm, gravity_ppm, 1.0), rel=1e-6)
    off_ppm = 1e6 * 1e-4 / TASK.site.gravity_mps2
    assert scale.value == pytest.approx(clean.parameters[number] / 1e-6 + off_ppm, abs=1e-6)
    assert [part.source for part in bias.contributions] == ["noise", "latitude_deg"]
    off = parameter_budgets(
        clean, TASK.site.gravity_mps2, np.zeros(24), [certificate("time_base_ppm", 2.0, 40.0)]
    )
    # rates or increments is not known, so what the time base is known to be off by widens and corrects nothing
    number = PARAMETER_NAMES.index("Kg_xx")
    assert off["Kg_xx"].value == off["Kg_xx"].stated
    assert off["Kg_xx"].combined == pytest.approx(math.hypot(clean.sigma[number] / 1e-6, 1.0, 40.0), rel=1e-6)
    assumed = parameter_budgets(clean, TASK.site.gravity_mps2, np.zeros(24))["Ka_yy"]
    assert assumed.combined > 30.0 and {part.origin for part in assumed.contributions} == {
        "filter",
        "assumed",
    }


def test_a_latitude_told_wrong_is_taken_off_where_a_certificate_says_so() -> None:
    """Told 0.04 deg too far north, an IMU without errors has them; the certificate knows it to 0.001 deg."""
    schedule = scheme("23-position")
    run = CalibrationRun(
        "r", "", "imu", "U", TASK.site.latitude_deg + 0.04, record(schedule), schedule, "by-hand", "", (), None,
        (certificate("latitude_deg", 0.002, 0.04),),
    )  # fmt: skip
    told = {"gravity_mps2": TASK.site.gravity_mps2, "as_told": True}
    budgets = calibrate(run, TASK.noise, **told).budgets
    per_deg = {name: budget.contributions[1].sensitivity for name, budget in budgets.items()}
    # what docs/uncertainty.md states of 0.05 deg: deg/h of a gyro's bias
    assert max(abs(0.05 * per_deg[f"eps_{axis}"]) for axis in "xyz") == pytest.approx(0.007, rel=0.05)
    worst = max(budgets, key=lambda name: abs(budgets[name].stated) / budgets[name].contributions[0].standard)
    assert abs(budgets[worst].stated) > 1.5 * budgets[worst].contributions[0].standard
    for budget in budgets.values():
        left = abs(budget.value) / max(abs(budget.stated), 1e-12)
        assert left < 0.1 or abs(budget.value) < 0.15 * budget.contributions[0].standard


def test_what_depends_on_the_latitude_is_estimated_with_the_noise_of_the_estimate(monkeypatch) -> None:
    asked = []
    found = SimpleNamespace(parameters=np.ones(24), sigma=np.ones(24))

    def again(increments, task, options, schedule):
        asked.append((task.noise, task.site.latitude_deg, task.site.gravity, options, increments, schedule))
        return SimpleNamespace(parameters=np.zeros(24))

    monkeypatch.setattr(_calibrate, "estimate", again)
    run = SimpleNamespace(increments="data", schedule="turns", certificates=())
    shown = SimpleNamespace(found=replace(TASK.noise, arw_deg_per_sqrt_h=0.123))
    for corrected in (True, False):
        made = Calibration(
            run, found, SimpleNamespace(task=TASK), None, shown, corrected, Options(passes=7), found
        )
        # a change of one by 0.02 deg; of a gyro's bias in deg/h
        assert made.budgets["eps_x"].contributions[1].sensitivity == pytest.approx(-50.0 / UNITS[0])
        noise = shown.found if corrected else TASK.noise
        place = TASK.site.latitude_deg - 0.02, TASK.site.gravity_mps2
        assert asked[-1] == (noise, *place, Options(passes=7), "data", "turns")


def test_a_crooked_table_does_no_harm() -> None:
    schedule = scheme("23-position")
    rng = np.random.default_rng(2)
    axes = np.eye(3) + math.radians(0.2) * rng.uniform(-1, 1, (3, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    tilt, heading = math.radians(1.3), math.radians(34.0)
    c, s = math.cos(heading), math.sin(heading)
    home = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    home = home @ np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    truth = drawn(3)
    found = estimate(
        record(schedule, errors_of(truth), axes=axes, home=home), TASK, Options(passes=2), schedule
    )
    assert np.abs((found.parameters - truth) / found.sigma).max() < 1.0


def test_a_truth_in_another_gauge_is_found_after_conversion() -> None:
    rng = np.random.default_rng(4)
    kg, ka = rng.standard_normal((2, 3, 3)) * 3e-4
    eps, nabla = rng.standard_normal(3) * 0.1 * DPH, rng.standard_normal(3) * 1e3 * UG_MPS2
    found = estimate(record(scheme("23-position"), ImuErrors(eps, nabla, kg, ka), WHITE), TASK)
    turn = cross_matrix(np.array([ka[1, 2], -ka[0, 2], ka[0, 1]]))  # makes K_a lower triangular, first order
    kg, ka = kg + turn, ka + turn
    z = (found.parameters - pack(eps, nabla, kg, ka, np.zeros(3))) / found.sigma
    assert np.sqrt(np.mean(z**2)) < 1.5


def test_lever_arms_and_lag_are_found_and_matter() -> None:
    truth = drawn(6)
    lever = np.array([[0.01, 0.02, 0.03], [0.04, 0.05, 0.06], [0.0, 0.0, 0.0]])
    errors = replace(errors_of(truth), lever_m=lever, lag_s=1e-3)
    data = record(scheme("19-position"), errors)
    found = estimate(data, TASK, Options(passes=2, lever_arms=True))
    np.testing.assert_allclose(found.lever_m, lever[:2], atol=2e-4)
    assert found.lag_s == pytest.approx(1e-3, abs=5e-6)
    ignored = estimate(data, TASK, Options(passes=2))
    worst = np.abs((ignored.parameters - truth) / ignored.sigma).max()
    assert np.abs((found.parameters - truth) / found.sigma).max() < 0.2 < 2.0 < worst


def test_bias_wander_needs_its_states() -> None:
    wander = BiasWander(0.003 * DPH, 5.0 * UG_MPS2, 1000.0)
    noise = replace(WHITE, wander_rad_s=wander.gyro_rad_s, wander_mps2=wander.accelerometer_mps2)
    plain, full = 0.0, 0.0
    for seed in range(2):
        truth = drawn(20 + seed)
        data = record(scheme("19-position", 90.0), errors_of(truth), noise, seed)
        for options in (Options(passes=2), Options(passes=2, wander=wander)):
            found = estimate(data, TASK, options)
            error = found.parameters - truth
            square = float(error @ np.linalg.solve(found.covariance, error))
            if options.wander is None:
                plain += square
            else:
                full += square
    assert plain > 4.0 * 48.0
    assert chi2.ppf(0.0005, 48) < full < chi2.ppf(0.9995, 48)


@pytest.mark.skipif(not PSINS.exists(), reason=f"{PSINS} is not here")
def test_the_simulated_record_of_psins() -> None:
    raw = np.fromfile(PSINS, dtype="<f4").reshape(-1, 7)[1:].astype(float)
    data = Increments(0.01, raw[:, :3], raw[:, 3:6])
    task = Task(site=Site(latitude_deg=34.0), noise=Noise(1e-4, 1.0, 1e-3))
    options = Options(passes=5, alignment_s=20.0, lever_arms=True)
    found = estimate(data, task, options, load_scheme("19-position"))
    values = found.parameters / UNITS
    # Sizes as put in by its author. Their sign is that of a calibration: biases and diagonals are taken off.
    eps, nabla = [-0.1, -0.2, -0.3], [-10.0, -20.0, -30.0]
    kg = [-10.0, 30.0, 50.0, 10.0, -20.0, 60.0, 20.0, 40.0, -30.0]
    ka, k2 = [-10.0, 10.0, 20.0, -20.0, 30.0, -30.0], [-10.0, -20.0, -30.0]
    np.testing.assert_allclose(values[:3], eps, atol=1e-4)
    np.testing.assert_allclose(values[3:], [*nabla, *kg, *ka, *k2], atol=0.1)
    np.testing.assert_allclose(found.lever_m * 100, [[-1, -2, -3], [-4, -5, -6]], atol=0.02)
    assert found.lag_s == pytest.approx(-1e-3, abs=1e-6)


def test_unusable_records_are_named() -> None:
    schedule = scheme("o8")
    good = record(schedule, errors_of(drawn(7)), WHITE)

    def refused(data: Increments, match: str, task: Task = TASK, expected: Schedule = schedule) -> None:
        with pytest.raises(RecordError, match=match):
            estimate(data, task, Options(passes=1), expected)

    gap = replace(good, angle_rad=good.angle_rad.copy())
    gap.angle_rad[9000, 1] = np.nan
    refused(gap, "gaps")
    stuck = replace(good, velocity_mps=np.minimum(good.velocity_mps, 0.0978))
    refused(stuck, "accelerometer [xyz] is saturated")
    refused(good, r"as at latitude 45\.[78]", Task(site=Site(latitude_deg=-45.0)))
    refused(good, r"as at latitude 45\.[78]", Task(site=Site(latitude_deg=45.4)))
    refused(Increments(0.01, good.angle_rad[6200:], good.velocity_mps[6200:]), "does not start at rest")
    cut = slice(0, 30000)
    refused(Increments(0.01, good.angle_rad[cut], good.velocity_mps[cut]), "positions")
    refused(good, r"turn 3 \(\+y\) is not", expected=schedule.with_(moves=parse_moves("+x-y+y+y+z+z-x-y")))
    clipped = replace(good, angle_rad=np.clip(good.angle_rad, -math.radians(0.15), math.radians(0.15)))
    with pytest.raises(RecordError, match="saturated"):
        estimate(clipped, TASK, Options(gyro_range_dps=0.15))
    short = schedule.with_(moves=parse_moves("+x-y"))
    axes = np.eye(3)
    legs = [Rest(60.0), Turn(axes[0], math.pi / 2, 9.0), Rest(60.0), Turn(axes[1], -1.4, 9.0), Rest(60.0)]
    made = measure_motion(
        np.eye(3),
        legs,
        ImuErrors(),
        WHITE,
        latitude_deg=TASK.site.latitude_deg,
        gravity_mps2=TASK.site.gravity_mps2,
    )
    refused(Increments(0.01, made.angle_rad, made.velocity_mps), "turn 2", expected=short)


@pytest.mark.parametrize(
    ("gyros", "accelerometers", "match"),
    [
        (([1, 0, 2], [1, 1, 1]), None, r"gyros are exchanged \(left-handed\). Found: x arrives as y, y arri"),
        (([1, 2, 0], [1, 1, 1]), None, r"gyros are exchanged. Found: x arrives as z, y arrives as x"),
        (
            ([0, 1, 2], [1, -1, 1]),
            None,
            r"gyros are reversed \(left-handed\). Found: x arrives as x, y arrives as -y",
        ),
        (
            None,
            ([0, 2, 1], [1, 1, 1]),
            r"accelerometers are exchanged \(left-handed\). Found: x arrives as x, y",
        ),
        (None, ([0, 1, 2], [-1, -1, -1]), "other hemisphere may also be accelerometers"),
        (
            ([0, 1, 2], [-1, 1, 1]),
            ([0, 1, 2], [-1, 1, 1]),
            r"gyros and accelerometers are reversed \(left-handed\). Found: x arrives as -x",
        ),
        (([0, 1, 2], [-1, -1, 1]), ([0, 1, 2], [-1, -1, 1]), "mounted another way"),
    ],
)
def test_axes_that_are_not_what_they_are_taken_for_are_named(gyros, accelerometers, match) -> None:
    schedule = scheme("o8", 30.0)
    good = record(schedule, errors_of(drawn(7)), WHITE)

    def wired(values, how):
        return values if how is None else values[:, how[0]] * np.array(how[1], dtype=float)

    bad = Increments(0.01, wired(good.angle_rad, gyros), wired(good.velocity_mps, accelerometers))
    with pytest.raises(RecordError, match=match):
        estimate(bad, TASK, Options(passes=1, alignment_s=25.0), schedule)
