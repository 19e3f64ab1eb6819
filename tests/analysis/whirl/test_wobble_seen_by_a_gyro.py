"""What a wobbling bearing adds to a level gyro's rate: rotation matrices against the linear formula."""

import numpy as np
import pytest

from benchmarks._without import without
from benchmarks.whirl_runs import LATITUDE_DEG, QUIET, STILL
from simulators.plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.wobble import Wobble

LINES = (-2, -1, 1, 2, 3)


def moved_arcsec_per_s(line: int, amplitude_arcsec: complex, angle_deg: np.ndarray) -> np.ndarray:
    """Real part of j m w a_m exp(j (m - 1) psi): patent on whirl compensation of a rotating INS, (8)."""
    angle = np.radians(angle_deg)
    middle = 0.5 * (angle[1:] + angle[:-1])
    return (amplitude_arcsec * np.diff(np.exp(1j * line * angle)) * np.exp(-1j * middle)).real / 0.01


def increments(wobble: Wobble) -> tuple[np.ndarray, np.ndarray]:
    unit = UnitConfig("ins", model="ins_triad", change=without(*QUIET), wobble=wobble)
    plant = LabPlant(PlantConfig(latitude_deg=LATITUDE_DEG, table=STILL, units=(unit,)))
    plant.table.servo(0.0, True)
    plant.table.demand_rate(0.0, 6.0)
    plant.advance(130.0)
    edges = np.array([plant.table.total_angle_deg(5.0 + 0.01 * k) for k in range(12001)])
    return plant.unit("ins").measure(5.0, 12000, 0.01).angle_increment_rad[:, 0], edges


@pytest.mark.parametrize("line", LINES)
def test_the_plant_adds_the_formulas_rate(line: int) -> None:
    amplitude = 3.0 - 4.0j
    with_whirl, angle_deg = increments(Wobble({float(line): amplitude}))
    without, _ = increments(Wobble())
    seen_dph = np.degrees(with_whirl - without) * 3600.0 / 0.01
    expected = moved_arcsec_per_s(line, amplitude, angle_deg)
    # left over: Earth rate on the tilted gyro, 15 deg/h x 5 arcsec
    assert np.abs(seen_dph - expected).max() < 1e-3 * np.abs(expected).max() + 4e-4
