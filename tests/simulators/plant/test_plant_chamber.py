"""The chamber against the figures of the thermal design notes (checks 6 and 7), and its own limits."""

import numpy as np
import pytest

from simulators.plant.chamber import WEAK_CHAMBER, ChamberAir, ChamberDemand, ChamberParameters
from simulators.plant.noise import NoiseSource, TickNoise

COLD_C, ROOM_C = -45.0, 25.0


def shock(parameters: ChamberParameters, seconds: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Air at the unit and set point, 1 s, from the demand of -45 degC at 12 K/min on a chamber at room."""
    air = ChamberAir(parameters, ROOM_C, NoiseSource(1, "chamber"))
    air.apply(ChamberDemand(0.0, COLD_C, 12.0, 12.0, True))
    unit_air, set_point = [], []
    for tick in range(seconds):
        air.tick()
        unit_air.append(air.unit_air_c(tick))
        set_point.append(air.set_point_c)
    return np.array(unit_air), np.array(set_point)


def mean_rate_k_per_min(unit_air: np.ndarray) -> float:
    span = ROOM_C - COLD_C
    t10 = np.argmax(unit_air < ROOM_C - 0.1 * span)
    t90 = np.argmax(unit_air < ROOM_C - 0.9 * span)
    return 0.8 * span / (t90 - t10) * 60.0


def test_nominal_chamber_passes_the_shock_gate_with_the_design_figures() -> None:
    unit_air, _ = shock(ChamberParameters())
    assert mean_rate_k_per_min(unit_air) == pytest.approx(11.79, abs=0.15)
    assert (unit_air[:-60] - unit_air[60:]).max() == pytest.approx(12.08, abs=0.3)
    assert COLD_C - unit_air.min() == pytest.approx(0.66, abs=0.3)
    assert np.argmax(unit_air < -40.0) + 1 == pytest.approx(363, abs=10)


def test_weak_chamber_fails_the_rate_gate() -> None:
    rate = mean_rate_k_per_min(shock(WEAK_CHAMBER)[0])
    assert rate < 10.0
    assert rate == pytest.approx(5.96, abs=0.15)


def test_set_point_ramps_at_the_demanded_rate_then_stays() -> None:
    _, set_point = shock(ChamberParameters(), 600)
    expected = np.maximum(COLD_C, ROOM_C - 0.2 * np.arange(1, 601))
    np.testing.assert_allclose(set_point, expected, atol=1e-9)


def test_refrigeration_limit_bounds_the_fall_of_a_step_without_ramp() -> None:
    air = ChamberAir(ChamberParameters(), ROOM_C, NoiseSource(0, "chamber"))
    air.apply(ChamberDemand(0.0, -70.0, 0.0, 0.0, True))
    before = air.air_c
    falls = []
    for _ in range(200):
        air.tick()
        falls.append(before - air.air_c)
        before = air.air_c
    assert falls[0] == pytest.approx(2.0, abs=1e-12)
    assert max(falls) == falls[0]


def test_chamber_settles_on_its_set_point() -> None:
    air = ChamberAir(ChamberParameters(air_noise_k=0.0), ROOM_C, NoiseSource(0, "chamber"))
    air.apply(ChamberDemand(0.0, 60.0, 3.0, 3.0, True))
    for _ in range(8000):
        air.tick()
    assert air.air_c == pytest.approx(60.0, abs=0.02)
    assert air.unit_air_c(8000) == pytest.approx(60.0, abs=0.02)


def test_stopped_chamber_drifts_back_towards_the_room() -> None:
    air = ChamberAir(ChamberParameters(), ROOM_C, NoiseSource(0, "chamber"))
    air.apply(ChamberDemand(0.0, COLD_C, 12.0, 12.0, True))
    for _ in range(3000):
        air.tick()
    cold = air.air_c
    air.apply(ChamberDemand(3000.0, COLD_C, 12.0, 12.0, False))
    for _ in range(7200):
        air.tick()
    assert cold + 5.0 < air.air_c < ROOM_C


def test_a_chamber_started_again_ramps_from_its_present_temperature() -> None:
    air = ChamberAir(ChamberParameters(), ROOM_C, NoiseSource(0, "chamber"))
    air.apply(ChamberDemand(0.0, 80.0, 0.0, 0.0, False))
    air.tick()
    assert air.set_point_c == 80.0
    air.apply(ChamberDemand(1.0, 80.0, 6.0, 6.0, True))
    air.tick()
    assert air.set_point_c == pytest.approx(ROOM_C + 0.1, abs=1e-6)


def test_air_noise_has_its_sigma_and_time() -> None:
    parameters = ChamberParameters()
    noise = TickNoise(NoiseSource(5, "chamber"), (parameters.air_noise_time_s,), parameters.air_noise_k)
    values = np.array([noise.value(tick) for tick in range(200_000)])
    assert values.std() == pytest.approx(0.05, rel=0.05)
    lagged = np.corrcoef(values[:-60], values[60:])[0, 1]
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.06)
