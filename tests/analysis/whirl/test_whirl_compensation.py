"""Compensation file, stream against batch, gauge that must be named, the strapdown integral."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.analysis.common.state_file import write_state
from bench.analysis.whirl import MEANING, WhirlCompensation, remove_slow, tilt_spectrum
from bench.analysis.whirl._attitude import carrier_tilt, oscillation, unit_attitude
from bench.analysis.whirl._direct import fit_direct
from bench.analysis.whirl._kinematics import body_to_rotating
from bench.analysis.whirl._types import TurnRecord
from benchmarks.whirl_runs import Plan, emulate
from drivers.base.errors import ConfigurationError, RecordError
from simulators.plant.wobble import PATENT_CLASS, Wobble

AS = np.radians(1.0 / 3600.0)


@pytest.fixture(scope="module")
def record() -> TurnRecord:
    return emulate(Plan([(120.0, 6.0), (120.0, -6.0)], Wobble(PATENT_CLASS, play_arcsec=5.0 - 2.0j)))[0]


@pytest.fixture(scope="module")
def compensation(record: TurnRecord) -> WhirlCompensation:
    return WhirlCompensation.from_fit(fit_direct([record]), "INS-1", {"r": "ab"}, gauge="mean")


def test_file_gives_back_the_compensation(compensation: WhirlCompensation, tmp_path: Path) -> None:
    path = tmp_path / "c.whirl"
    compensation.save(path)
    loaded = WhirlCompensation.load(path)
    assert loaded.describe() == compensation.describe()
    angle = np.linspace(0.0, 20.0, 400)
    assert np.array_equal(loaded.tilt_arcsec(angle), compensation.tilt_arcsec(angle))
    assert list(tmp_path.iterdir()) == [path]


def test_damaged_and_foreign_files_are_refused(compensation: WhirlCompensation, tmp_path: Path) -> None:
    path = tmp_path / "c.whirl"
    compensation.save(path)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(RecordError):
        WhirlCompensation.load(path)
    write_state(path, {"format": 1, "kind": "thermal"})
    with pytest.raises(RecordError, match="kind thermal"):
        WhirlCompensation.load(path)


def test_the_gauge_must_be_named_and_says_what_it_means(record: TurnRecord) -> None:
    fit = fit_direct([record])
    with pytest.raises(TypeError, match="gauge"):
        WhirlCompensation.from_fit(fit, "INS-1", {})  # type: ignore[call-arg]
    for gauge in ("mean", "start"):
        made = WhirlCompensation.from_fit(fit, "INS-1", {}, gauge=gauge)  # type: ignore[arg-type]
        assert any(text.startswith("free: the constant tilt a_0") for text in made.declared)
        assert any(MEANING[gauge] in text for text in made.declared)  # type: ignore[index]


def test_gauges_differ_by_a_constant_tilt_in_the_body(record: TurnRecord) -> None:
    fit = fit_direct([record])
    angle = np.linspace(0.0, 6.0, 50)
    mean, start = (
        WhirlCompensation.from_fit(fit, "INS-1", {}, gauge=gauge).tilt_arcsec(angle)  # type: ignore[arg-type]
        for gauge in ("mean", "start")
    )
    assert np.ptp((mean - start).real) + np.ptp((mean - start).imag) < 1e-12
    assert abs(start[0]) < 1e-12


def test_another_unit_is_refused(compensation: WhirlCompensation) -> None:
    compensation.require_unit("INS-1")
    with pytest.raises(ConfigurationError, match="of another unit"):
        compensation.require_unit("INS-2")


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=40), st.integers(0, 2**31))
def test_stream_equals_batch_with_wrapped_angles(steps: list[float], seed: int) -> None:
    plays = np.array([5.0 + 1.0j, -2.0j])
    made = WhirlCompensation(
        "U", (-1.0, 2.0), np.array([3 + 1j, -2 + 4j]), np.zeros(2), "mean", 0j, (0.5, 20.0), plays
    )
    angle = np.cumsum(np.concatenate(([0.3], steps)))
    attitude = Rotation.random(len(angle), random_state=seed).as_matrix()
    batch = made.carrier_attitude(attitude, angle)
    stream = made.stream()
    pushed = [stream.push(a, float(at % (2.0 * np.pi))) for a, at in zip(attitude, angle, strict=True)]
    assert np.allclose(np.stack(pushed), batch, atol=1e-12)


def test_strapdown_follows_a_turning_unit_on_the_turning_earth() -> None:
    """A level unit at latitude 40 that is turned about z: exact rates by scipy, attitude back to 1e-6 arcsec."""
    period, latitude = 0.01, np.radians(40.0)
    t = period * np.arange(6001)
    psi = np.radians(6.0) * t + 0.2 * np.sin(0.3 * t)
    earth = np.radians(15.041067 / 3600.0) * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    body = Rotation.from_rotvec([0.0, 0.0, -np.radians(250.0)])  # y points to azimuth 250 deg
    unit = body * Rotation.from_rotvec(psi[:, None] * [[0.0, 0.0, 1.0]])
    inertial = Rotation.from_rotvec(t[:, None] * earth) * unit
    rate = np.degrees((inertial[:-1].inv() * inertial[1:]).as_rotvec()) / period
    record = TurnRecord("r", "U", period, t, rate, psi, np.ones(6000, bool), 40.0)
    found = unit_attitude(record, 250.0)
    assert np.abs(found - unit.as_matrix()).max() / AS < 1e-6
    assert np.abs(carrier_tilt(found @ body_to_rotating(psi))).max() < 1e-6


def test_oscillation_splits_what_is_locked_from_what_is_not() -> None:
    t = np.arange(0.0, 1200.0, 0.5)
    psi = np.radians(6.0) * t
    slow = 0.05 * t + 3.0 * np.sin(2.0 * np.pi * t / 4000.0)
    locked, cage = 4.0 * np.exp(2j * psi) + 3.0j * np.exp(-1j * psi), 1.5 * np.exp(0.43j * psi)
    found = oscillation(slow + locked + cage, t, psi)
    assert found.locked_arcsec == pytest.approx(5.0 / np.sqrt(2.0), rel=0.03)
    assert found.total_arcsec == pytest.approx(np.sqrt((25.0 + 2.25) / 2.0), rel=0.03)
    moving, where = remove_slow(slow + 0j, t, psi)
    assert np.abs(moving).max() < 0.05
    assert len(t[where]) == len(moving)
    spectrum = tilt_spectrum(locked + cage, psi, np.array([2.0, -1.0, 0.43, 5.0]))
    assert np.allclose(spectrum, [4.0, 3.0, 1.5, 0.0], atol=0.1)
