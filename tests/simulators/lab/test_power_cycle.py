"""A unit switched off and on: silence, a counter and a bias begun anew, heat sources cold meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from bench.lab.emulated import Plant, lab_config
from bench.record.benchfile import load_bench_file
from benchmarks._without import without
from drivers.base.errors import ConfigurationError
from drivers.frames import FrameDecoder, load_family
from simulators.emulators.frames import FrameEmulator
from simulators.lab._build import build_lab
from simulators.lab._power import Since, Switched
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig, unit_model

BENCH = """
[bench]
name = "b"
latitude_deg = 39.1
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB1"
[[gyro]]
name = "g"
driver = "rlg2t"
port = "/dev/ttyUSB2"
baudrate = 115200
rate_hz = 10
axes = "x"
axis = "x"
unit = "R"
"""


def off_and_on(plant: LabPlant, off_s: float) -> None:
    plant.switch("g", False, plant.now_s)
    plant.switch("g", True, plant.now_s + off_s)


def test_the_stream_stops_and_begins_with_frame_0() -> None:
    plant = LabPlant(PlantConfig(units=(UnitConfig("g", "rlg", 3),)))
    unit, ring = plant.unit("g"), load_family("rlg2t")
    before = FrameEmulator(unit, ring, axes="x", rate_hz=10, baudrate=115200)
    plant.advance(100.25)
    after = FrameEmulator(Since(unit, 160.25), ring, axes="x", rate_hz=10, baudrate=115200)
    cycled = Switched(before)
    cycled.off(100.25)
    cycled.on(after, 160.25)
    off_and_on(plant, 60.0)
    counter, arrival = [], []
    for now_s in (50.0, 120.0, 150.0, 200.0):
        plant.advance(now_s)
        block = cycled.stream(now_s)
        if block is None:
            continue
        counter += FrameDecoder(ring, rate_hz=10.0, axes="x").feed(block.data).columns["counter"].tolist()
        arrival += (block.marks[:, 1] * 1e-9).tolist()
        assert block.marks[-1, 0] == len(block.data)
    assert counter == [*range(1002), *range(397)]
    quiet = int(np.argmax(np.diff(arrival)))
    # the frame of 100.2 s is the last before; the first mark after is half a second into the new life
    assert arrival[quiet] == pytest.approx(100.2, abs=0.01)
    assert arrival[quiet + 1] == pytest.approx(160.75, abs=0.01)


def test_every_power_on_draws_its_turn_on_bias() -> None:
    quiet = ("angle_random_walk", "bias_instability", "quantisation")
    config = UnitConfig("g", "fog_mid", 0, change=without(*quiet))
    plant = LabPlant(PlantConfig(seed=4, units=(config,)))
    marks = []
    for cycle in range(60):
        plant.advance(20.0 * cycle + 5.0)
        off_and_on(plant, 2.0)
        marks.append(20 * cycle + 7)
    plant.advance(1210.0)
    bias = plant.true_drift("g")["bias_dph"]
    steps = np.array([bias[at + 1] - bias[at - 1] for at in marks])
    sigma = unit_model(config).axis_models[0].turn_on_bias_dph
    # a step is the difference of two draws; 59 of them tell sigma to 13 % (neighbours share a draw)
    assert np.std(steps) == pytest.approx(np.sqrt(2.0) * sigma, rel=0.4)
    assert len(set(np.round(steps, 9))) == 60


def test_a_unit_without_power_cools() -> None:
    plant = LabPlant(PlantConfig(units=(UnitConfig("g", "rlg", 3),)))
    plant.advance(7200.0)
    off_and_on(plant, 7200.0)
    plant.advance(21600.0)
    block = plant.true_drift("g")["block_c"] - plant.chamber.record()["air_temp_c"]
    # 2 W over 0.30 W/K to the case and 1.2 W/K to the air
    warm_k = 2.0 / 0.30 + 2.0 / 1.2
    assert block[7199] == pytest.approx(warm_k, abs=1.0) and block[21599] == pytest.approx(warm_k, abs=1.0)
    assert abs(block[14399]) < 0.2 * warm_k


def test_the_act_says_what_it_cannot_do(tmp_path) -> None:
    path = tmp_path / "b.toml"
    path.write_text(BENCH)
    lab, acts = build_lab(lab_config(load_bench_file(path), Plant()))
    try:
        with pytest.raises(ConfigurationError, match="no gyro 'h'"):
            acts["power_cycle"]({"unit": "h"})
        with pytest.raises(ConfigurationError, match="off for that long"):
            acts["power_cycle"]({"off_s": 0})
        acts["power_cycle"]({"off_s": 60})
        with pytest.raises(ConfigurationError, match="switched already"):
            acts["power_cycle"]({})
    finally:
        for port in lab.ports:
            port.close()
