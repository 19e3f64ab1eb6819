"""Recordings that cannot carry a fit, or could mislead: each is named with what follows from it."""

import dataclasses

import numpy as np
import pytest

from bench.analysis.whirl._angle import align_angle
from bench.analysis.whirl._checks import (
    alignment_findings,
    earth_rate_findings,
    require_fit_for_whirl,
    rotation_findings,
)
from bench.analysis.whirl._direct import fit_direct
from bench.analysis.whirl._types import TurnRecord, UnfitRotation
from benchmarks.whirl_runs import Plan, emulate
from simulators.plant.wobble import PATENT_CLASS, Wobble

PERIOD = 0.05


@pytest.fixture(scope="module")
def record() -> TurnRecord:
    return emulate(Plan([(600.0, 6.0)], Wobble(PATENT_CLASS)))[0]


def motion(rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges, z rates, true angle in deg at the edges."""
    edges = PERIOD * np.arange(len(rates) + 1)
    return edges, rates, np.concatenate(([0.0], np.cumsum(rates * PERIOD)))


def rest_turn_rest(rate_dps: float = 6.0) -> np.ndarray:
    return np.concatenate([np.zeros(1200), np.full(12000, rate_dps), np.zeros(1200)])


def polls(
    edges: np.ndarray, angle: np.ndarray, late_s: float = 0.0, ppm: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    at = np.arange(1.0, edges[-1] - 1.0)
    return at, np.interp(at - late_s - ppm * 1e-6 * at, edges, angle) % 360.0


def test_less_than_a_turn(record: TurnRecord) -> None:
    part = dataclasses.replace(
        record,
        time_s=record.time_s[:5001],
        angle_rad=record.angle_rad[:5001],
        rate_dps=record.rate_dps[:5000],
        usable=record.usable[:5000],
    )
    with pytest.raises(UnfitRotation, match=r"0\.8[0-9] turns.*arbitrary"):
        require_fit_for_whirl(part)
    require_fit_for_whirl(record)


@pytest.mark.parametrize("what", ["railed", "stuck"])
def test_saturated_gyro(record: TurnRecord, what: str) -> None:
    rates = record.rate_dps.copy()
    if what == "railed":
        rates[1000:1010, 0] = -490.0
    else:
        rates[1000:1300, 1] = 0.0123
    with pytest.raises(UnfitRotation, match=r"saturated or stuck.*look like whirl"):
        require_fit_for_whirl(dataclasses.replace(record, rate_dps=rates))


def test_saturated_z_gyro_does_not_follow_the_table() -> None:
    edges, rates, angle = motion(rest_turn_rest())
    with pytest.raises(UnfitRotation, match=r"does not follow the table"):
        align_angle(edges, np.minimum(rates, 4.0), *polls(edges, angle))


@pytest.mark.parametrize("rate_dps", [6.0, 200.0])
def test_wrong_sign_of_the_table_axis(rate_dps: float) -> None:
    edges, rates, angle = motion(rest_turn_rest(rate_dps))
    if rate_dps < 150.0:
        with pytest.raises(UnfitRotation, match=r"opposite senses.*whirl doubles"):
            align_angle(edges, -rates, *polls(edges, angle))
    else:  # steps above half a turn are counted by the gyro
        found, _ = align_angle(edges, rates, *polls(edges, angle))
        assert np.abs(np.degrees(found) - angle).max() < 1e-6


def test_wrong_sign_of_a_horizontal_gyro(record: TurnRecord) -> None:
    assert not [*earth_rate_findings(fit_direct([record]), record)]
    for axis in (0, 1):
        rates = record.rate_dps.copy()
        rates[:, axis] *= -1.0
        wrong = dataclasses.replace(record, rate_dps=rates)
        with pytest.raises(UnfitRotation, match="wrong sign"):
            next(earth_rate_findings(fit_direct([wrong]), wrong))
    tilted = dataclasses.replace(record, latitude_deg=60.0)
    (finding,) = earth_rate_findings(fit_direct([tilted]), tilted)
    assert finding.code == "level"


def test_clocks_that_drift_apart_are_found_and_taken_out() -> None:
    edges, rates, angle = motion(rest_turn_rest())
    found, alignment = align_angle(edges, rates, *polls(edges, angle, late_s=0.03, ppm=120.0))
    assert alignment.clock_error_ppm == pytest.approx(120.0, rel=0.01)
    assert alignment.latency_s == pytest.approx(0.03, abs=2e-3)
    assert np.abs(np.degrees(found) - angle).max() < 0.02
    (finding,) = alignment_findings(alignment, 6.0, 3600.0)
    assert finding.code == "clock_drift"
    assert "2.592 deg off" in finding.text  # 120e-6 x 3600 s x 6 deg/s
    assert "0.452 arcsec would stay" in finding.text  # 10 arcsec x 2.592 deg in rad


def test_without_rest_clocks_and_latency_are_declared_unknown() -> None:
    edges, rates, angle = motion(np.full(12000, 6.0))
    _, alignment = align_angle(edges, rates, *polls(edges, angle, ppm=120.0))
    assert {finding.code for finding in alignment_findings(alignment, 6.0, 600.0)} == {
        "clock_unknown",
        "latency_unknown",
    }


def test_emulated_gyro_clock_that_is_slow_is_found() -> None:
    _, turns = emulate(Plan([(300.0, 6.0)], Wobble(), clock_error_ppm=200.0))
    assert turns.alignment.clock_error_ppm == pytest.approx(-200.0, abs=10.0)


def test_rotation_that_stops_or_reverses_unannounced() -> None:
    rates = np.full(12000, 6.0)
    rates[4000:4400] = 0.0
    rates[8000:8100] = -6.0
    edges, z, angle = motion(rates)
    record = TurnRecord(
        "r", "U", PERIOD, edges, np.stack([z, z, z], axis=1), np.radians(angle), np.ones(12000, bool), 40.0
    )
    back, stop = rotation_findings(record, [(0.0, 600.0, 6.0)])
    assert "turned backwards unannounced at 400 s" in back.text
    assert "stopped or slowed down unannounced at 200 s, for 20 s" in stop.text
    assert "nominal angle" in stop.text
    announced = [(0.0, 199.0, 6.0), (221.0, 399.0, 6.0), (401.0, 404.0, -6.0)]
    assert not [*rotation_findings(record, announced)]


def test_too_few_table_angles() -> None:
    edges, rates, angle = motion(np.full(400, 6.0))
    with pytest.raises(UnfitRotation, match="too few table angles"):
        align_angle(edges, rates, np.arange(5.0), np.interp(np.arange(5.0), edges, angle))
