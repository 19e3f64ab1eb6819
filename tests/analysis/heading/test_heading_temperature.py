"""Reference temperature, Fourier terms and the lag: closed forms (checks C8, C9)."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.heading import fit_reference
from bench.analysis.heading._temperature import fourier_terms, lagged
from drivers.base.constants import EARTH_RATE_RAD_S, SIDEREAL_DAY_S
from drivers.base.errors import RecordError

STEP_S = 300.0


def course(days: float) -> tuple[np.ndarray, np.ndarray]:
    angle = 1.1 + EARTH_RATE_RAD_S * np.arange(0.0, days * SIDEREAL_DAY_S, STEP_S)
    return angle, 45.0 + 0.3 * np.cos(angle) - 0.2 * np.sin(2.0 * angle)


def test_reference_and_change() -> None:
    angle, temp = course(6.0)
    turn = angle > angle[0] + 6.0 * np.pi
    reference = fit_reference(angle[~turn], temp[~turn])
    assert reference.residual_k < 1e-9
    np.testing.assert_allclose(reference.coefficients[:5], [45.0, 0.3, 0.0, 0.0, -0.2], atol=1e-9)
    change = 0.11 + 0.07 * np.cos(angle) - 0.05 * np.sin(angle) + 0.02 * np.cos(3.0 * angle)
    terms = fourier_terms(angle, temp + turn * change - reference.at(angle))
    np.testing.assert_allclose(terms[-1], [0.11, 0.07, -0.05], atol=1e-3)
    assert np.nanmax(np.abs(terms[~turn])) < 1e-3
    assert np.isnan(terms[: round(0.9 * SIDEREAL_DAY_S / STEP_S)]).all()


def test_reference_needs_a_full_turn_and_leaves_a_trend_out() -> None:
    angle, temp = course(0.9)
    with pytest.raises(RecordError, match=r"no full sidereal day.*21\.5 h"):
        fit_reference(angle, temp)
    angle, temp = course(1.5)
    reference = fit_reference(angle, temp + 0.05 * (angle - angle[-1]) / (2.0 * np.pi))
    assert reference.closure_k == pytest.approx(0.05, abs=1e-6)
    np.testing.assert_allclose(reference.at(angle), temp, atol=1e-3)
    temp[200:240] = np.nan
    with pytest.raises(RecordError, match=r"longest gap 3\.4 h"):
        fit_reference(angle, temp)


def test_terms_leave_missing_samples_out() -> None:
    angle, _ = course(3.0)
    change = 0.11 + 0.07 * np.cos(angle) - 0.05 * np.sin(angle)
    change[np.random.default_rng(1).random(len(angle)) < 0.3] = np.nan
    np.testing.assert_allclose(fourier_terms(angle, change)[-1], [0.11, 0.07, -0.05], atol=1e-12)


def test_rectified_means() -> None:
    angle, _ = course(20.0)
    x = 0.11 + 0.07 * np.cos(angle) - 0.05 * np.sin(angle) + 0.02 * np.cos(3.0 * angle)
    assert np.mean(x * np.cos(angle)) == pytest.approx(0.035, abs=2e-4)
    assert np.mean(x * np.sin(angle)) == pytest.approx(-0.025, abs=2e-4)


def test_lag_has_gain_and_phase_of_a_first_order() -> None:
    """6 h: gain 0.5360, phase 57.59 deg at one turn a sidereal day."""
    angle, _ = course(10.0)
    out = lagged(np.cos(angle), STEP_S / (6.0 * 3600.0))
    late = angle > angle[-1] - 2.0 * np.pi
    rows = np.stack([np.cos(angle), np.sin(angle)], axis=1)[late]
    a, b = np.linalg.lstsq(rows, out[late], rcond=None)[0]
    assert np.hypot(a, b) == pytest.approx(0.5360, abs=0.001)
    assert np.degrees(np.arctan2(b, a)) == pytest.approx(57.59, abs=0.1)


def test_lag_of_a_ramp() -> None:
    """A ramp comes out late by tau exactly, whatever the step; from rest, r t - r tau (1 - e^(-t/tau))."""
    time_s = 900.0 * np.arange(50)
    out = lagged(2e-4 * time_s, 900.0 / 7200.0)
    np.testing.assert_allclose(out, 2e-4 * (time_s - 7200.0 * -np.expm1(-time_s / 7200.0)), atol=1e-12)
