"""Kinematics against rotation matrices, matching against closed forms, what is free (checks C15 to C19)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.analysis.common.attitude import rotations
from bench.analysis.whirl import WhirlCompensation
from bench.analysis.whirl._direct import fit_direct
from bench.analysis.whirl._gauge import gauge_tilt
from bench.analysis.whirl._integral import body_lines, match_coefficients
from bench.analysis.whirl._kinematics import (
    body_to_rotating,
    body_to_true,
    harmonic_matrix,
)
from bench.analysis.whirl._types import TurnRecord

AS = np.radians(1.0 / 3600.0)
LINES = (-2.0, -1.0, 1.0, 2.0, 3.0)
AMPLITUDES = np.array([0.9 - 0.6j, 5.0 - 3.0j, 3.0 + 2.0j, -9.0 + 8.0j, 4.0 + 4.4j])


def tilt(psi: np.ndarray, free: complex = 0.0) -> np.ndarray:
    """Body tilt in arcsec, written out."""
    total = np.full(len(psi), complex(free))
    for line, amplitude in zip(LINES, AMPLITUDES, strict=True):
        total += amplitude * (np.cos(line * psi) + 1j * np.sin(line * psi))
    return total


def true_frame(psi: np.ndarray, tilt_as: np.ndarray) -> Rotation:
    """C_b^s' from scipy: coordinates are turned back by the tilt, then by psi about z."""
    tilted = Rotation.from_rotvec(-AS * np.stack([tilt_as.real, tilt_as.imag, 0.0 * psi], axis=1))
    return Rotation.from_rotvec(np.stack([0.0 * psi, 0.0 * psi, -psi], axis=1)) * tilted


@pytest.mark.parametrize("motion", ["forward", "backward", "uneven"])
def test_whirl_rate_is_that_of_exact_matrices(motion: str) -> None:
    t, h, w = np.linspace(0.0, 60.0, 61), 1e-3, np.radians(6.0)

    def angle(at: np.ndarray) -> np.ndarray:
        uneven = 0.3 * np.sin(0.7 * at)
        return {"forward": w * at, "backward": -w * at, "uneven": w * at + uneven}[motion]

    def frame(at: np.ndarray) -> Rotation:
        return true_frame(angle(at), tilt(angle(at)))

    # seven-point derivative of the turn since t: the rate of s' in s'
    weights = {1: 3.0 / 4.0, 2: -3.0 / 20.0, 3: 1.0 / 60.0}
    turned = sum(
        k
        * ((frame(t) * frame(t + n * h).inv()).as_rotvec() - (frame(t) * frame(t - n * h).inv()).as_rotvec())
        for n, k in weights.items()
    )
    exact = (turned[:, 0] + 1j * turned[:, 1]) / h / AS
    psi, rate = angle(t), (angle(t + h) - angle(t - h)) / (2.0 * h)
    theta = tilt(psi) * np.exp(-1j * psi)
    theta_rate = sum(
        1j * (m - 1.0) * rate * a * np.exp(1j * (m - 1.0) * psi)
        for m, a in zip(LINES, AMPLITUDES, strict=True)
    )
    assert np.abs(theta_rate + 1j * rate * theta - exact).max() < 1e-6 + 1e-9 / h


def test_rotation_matrices_agree_with_scipy() -> None:
    rng = np.random.default_rng(0)
    vectors = np.concatenate([rng.normal(size=(50, 3)), 1e-9 * rng.normal(size=(50, 3)), np.zeros((1, 3))])
    vectors[:50] *= 0.4 / np.linalg.norm(vectors[:50], axis=1).max()
    assert np.allclose(rotations(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15)
    psi, tilt_as = rng.uniform(-9.0, 9.0, 40), rng.normal(size=40) + 1j * rng.normal(size=40)
    assert np.allclose(body_to_true(psi, AS * tilt_as), true_frame(psi, tilt_as).as_matrix(), atol=1e-14)


@pytest.mark.parametrize(("n", "values"), [(1, (2, 2, 0, 0)), (2, (3, 3, 1, 1)), (3, (4, 4, 2, 2))])
def test_ranks_of_the_matching_equations(n: int, values: tuple[float, ...]) -> None:
    assert np.allclose(np.linalg.svd(harmonic_matrix(n), compute_uv=False), values, atol=1e-12)
    psi = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    x_c, x_s, y_c, y_s = 1.0, -2.0, 0.5, 3.0
    theta = (y_c * np.cos(n * psi) + y_s * np.sin(n * psi)) + 1j * (
        x_c * np.cos(n * psi) + x_s * np.sin(n * psi)
    )
    slope = n * (
        (y_s * np.cos(n * psi) - y_c * np.sin(n * psi)) + 1j * (x_s * np.cos(n * psi) - x_c * np.sin(n * psi))
    )
    rate = slope + 1j * theta
    c, s, c2, s2 = harmonic_matrix(n) @ [x_c, x_s, y_c, y_s]
    assert np.allclose(rate.real, c * np.cos(n * psi) + s * np.sin(n * psi))
    assert np.allclose(rate.imag, c2 * np.cos(n * psi) + s2 * np.sin(n * psi))


def series(coefficients: np.ndarray) -> np.ndarray:
    """The integrated rates of whirl coefficients by the closed forms for n = 1 and 2."""
    (x1, x2, y1, y2), (x3, x4, y3, y4) = coefficients
    cosine = np.array([[y1 + x2, -(y2 - x1)], [(2 * y3 + x4) / 2, (2 * x3 - y4) / 2]])
    sine = np.array([[y2 - x1, y1 + x2], [(2 * y4 - x3) / 2, (2 * x4 + y3) / 2]])
    return np.hstack([cosine, sine])


whirls = st.lists(st.floats(-20, 20), min_size=8, max_size=8).map(
    lambda values: np.array(values).reshape(2, 4)
)


@settings(max_examples=60, deadline=None)
@given(whirls)
def test_closed_forms_are_recovered_up_to_the_free_part(truth: np.ndarray) -> None:
    fit = series(truth)
    found = match_coefficients(fit)
    assert np.allclose(found[1], truth[1], atol=1e-10)
    d, s = truth[0, 3] - truth[0, 0], truth[0, 1] + truth[0, 2]
    assert np.allclose(found[0], [-d / 2, s / 2, s / 2, d / 2], atol=1e-10)
    # what is left of the tilt stands still in the body, at the stated place
    psi = np.linspace(0.0, 6.0, 50)

    def body(values: np.ndarray) -> np.ndarray:
        theta = sum(
            (y_c + 1j * x_c) * np.cos(n * psi) + (y_s + 1j * x_s) * np.sin(n * psi)
            for n, (x_c, x_s, y_c, y_s) in enumerate(values, start=1)
        )
        return np.asarray(theta * np.exp(1j * psi))

    left = body(truth) - body(found)
    expected = (truth[0, 2] - truth[0, 1]) / 2 + 1j * (truth[0, 0] + truth[0, 3]) / 2
    assert np.abs(left - expected).max() < 1e-5
    lines, amplitudes = body_lines(found)
    assert lines == (2.0, -1.0, 3.0) if 0.0 in lines else set(lines) == {2.0, -1.0, 3.0}
    direct = sum(a * np.exp(1j * m * psi) for m, a in zip(lines, amplitudes, strict=True))
    assert np.abs(direct - body(found)).max() < 1e-9


def exact_record(turns: int = 6, free: complex = 0.0, earth: complex = 0.0, sense: float = 1.0) -> TurnRecord:
    """Mean rates over 10 ms of the exact frame, turning at 6 deg/s over a body that turns by `earth` deg/h."""
    period = 0.01
    t = period * np.arange(int(60 * turns / period) + 1)
    psi = sense * np.radians(6.0) * t
    frames = true_frame(psi, tilt(psi, free))
    still = Rotation.from_rotvec(-AS * t[:, None] * [[earth.real, earth.imag, 0.0]])
    frames = frames * still
    rate = (frames[:-1] * frames[1:].inv()).as_rotvec() / period
    return TurnRecord("exact", "U", period, t, np.degrees(rate), psi, np.ones(len(rate), bool), 0.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_right_sign_removes_the_whirl_and_wrong_sign_doubles_it(sense: float) -> None:
    record = exact_record(sense=sense)
    psi = record.angle_rad
    unit = true_frame(psi, tilt(psi)).inv().as_matrix()  # C_s'^b, the body at rest in n
    fit = fit_direct([record], LINES)
    right = WhirlCompensation.from_fit(fit, "U", {}, gauge="mean")

    def error(attitude: np.ndarray) -> float:
        return float(np.abs(Rotation.from_matrix(attitude).as_rotvec()).max() / AS)

    raw = error(unit @ body_to_rotating(psi))
    assert raw > 15.0
    assert error(right.carrier_attitude(unit, psi)) < 1e-3
    wrong = error(unit @ body_to_true(psi, -AS * right.tilt_arcsec(psi)))
    assert wrong == pytest.approx(2.0 * raw, rel=1e-3)


def test_a_free_tilt_is_not_seen_and_leaves_a_constant() -> None:
    with_free, without = exact_record(free=7.0 - 4.0j), exact_record()
    assert np.abs(with_free.rate_dps - without.rate_dps).max() * 3600.0 < 1e-4
    assert np.allclose(
        fit_direct([with_free], LINES).amplitudes_arcsec, AMPLITUDES, atol=1e-4
    )  # no trace of the 7 - 4j


def test_start_gauge_is_the_locked_strapdown_attitude() -> None:
    psi = np.linspace(0.0, 5.0, 40)
    constant = gauge_tilt("start", LINES, AMPLITUDES)
    assert abs(constant + AMPLITUDES.sum()) < 1e-12
    compensation = WhirlCompensation("U", LINES, AMPLITUDES, np.zeros(5), "start", constant)
    unit = true_frame(psi, tilt(psi)).inv().as_matrix()
    locked = unit[0]  # locked at angle zero the unit's frame is taken for the body
    carrier = compensation.carrier_attitude(unit, psi)
    apart = Rotation.from_matrix(locked.T @ carrier).as_rotvec() / AS
    assert np.abs(apart[:, :2]).max() < 1e-6
    assert (
        np.abs(apart[:, 2]).max() < 1e-3
    )  # turning about two axes is not turning about their sum: tilt squared
    assert gauge_tilt("mean", LINES, AMPLITUDES) == 0
