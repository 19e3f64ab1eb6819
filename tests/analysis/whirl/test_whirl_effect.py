"""The catalogue's whirl effect against the plant that moves by rotation matrices."""

import numpy as np
import pytest

from benchmarks.whirl_runs import LATITUDE_DEG, QUIET, STILL
from simulators.effects import Stimulus
from simulators.plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.whirl_effect import LINES, WHIRL
from simulators.plant.wobble import Wobble


def increments(wobble: Wobble) -> tuple[np.ndarray, np.ndarray]:
    unit = UnitConfig("ins", model="ins_triad", without=QUIET, wobble=wobble)
    plant = LabPlant(PlantConfig(latitude_deg=LATITUDE_DEG, table=STILL, units=(unit,)))
    plant.table.servo(0.0, True)
    plant.table.demand_rate(0.0, 6.0)
    plant.advance(130.0)
    edges = np.array([plant.table.total_angle_deg(5.0 + 0.01 * k) for k in range(12001)])
    return plant.unit("ins").measure(5.0, 12000, 0.01).angle_increment_rad[:, 0], edges


@pytest.mark.parametrize("line", LINES)
def test_columns_are_what_the_plant_adds_to_the_rate(line: int) -> None:
    amplitude = 3.0 - 4.0j
    with_whirl, angle_deg = increments(Wobble({float(line): amplitude}))
    without, _ = increments(Wobble())
    seen_dph = np.degrees(with_whirl - without) * 3600.0 / 0.01
    none = np.zeros(12000)
    columns = WHIRL.columns(
        Stimulus(0.01 * np.arange(1, 12001), none, none, angle_deg, none, LATITUDE_DEG, 0.01), {}
    )
    at = 2 * LINES.index(line)
    expected = amplitude.real * columns[at] + amplitude.imag * columns[at + 1]
    # left over: Earth rate on the tilted gyro, 15 deg/h x 5 arcsec
    assert np.abs(seen_dph - expected).max() < 1e-3 * np.abs(expected).max() + 4e-4
    assert len(WHIRL.parameters) == len(columns) == 10
