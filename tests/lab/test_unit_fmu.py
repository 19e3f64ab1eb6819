"""An emulated unit as an FMU: valid for FMPy, and run by it the unit of the lab, sample by sample."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gyrobench
from bench.lab.emulated import Plant, lab_config
from bench.lab.unit_fmu import write_unit_fmu
from bench.present.cli._app import app
from bench.record.benchfile import BenchFile, load_bench_file
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.lab._build import plant_config
from simulators.lab.unit_alone import UnitAlone
from simulators.plant.lab_plant import LabPlant

fmpy = pytest.importorskip("fmpy", reason="an FMU needs the extra fmu, which is not installed here")
validation = pytest.importorskip(
    "fmpy.validation", reason="an FMU needs the extra fmu, which is not installed here"
)
pytest.importorskip("pythonfmu", reason="writing an FMU needs the extra fmu, which is not installed here")

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
RATE_HZ, SECONDS = 10.0, 240
AXES = {"fog_1": [""], "ellipse_1": ["_x", "_y", "_z"]}
SHOCKED = """format = 1
[noise]
arw_deg_per_sqrt_h = 0.004
bias_instability_dph = 0.01
rate_random_walk_dph_per_sqrt_h = 0.05
[[effect]]
name = "shupe"
parameters = { bias_dph_per_k_per_min = 0.5, gradient_dph_per_k_per_min = -0.25 }
sigma = { bias_dph_per_k_per_min = 0.1, gradient_dph_per_k_per_min = 0.1 }
"""
TILTED = """format = 1
[noise]
arw_deg_per_sqrt_h = 0.004
[[effect]]
name = "azimuth_error"
parameters = { azimuth_error_deg = 0.3 }
sigma = { azimuth_error_deg = 0.1 }
"""


def bench() -> BenchFile:
    return load_bench_file(DEMO)


def in_the_lab(plant: Plant, gyro: str) -> tuple[Array, Array, Array, Array, Array]:
    """Turn the table and cool the chamber: true rates and air by sample, then output, temperature and case."""
    lab = LabPlant(plant_config(lab_config(bench(), plant)))
    air: list[float] = [plant.room_temp_c]
    tick = lab.chamber.tick

    def noted() -> float:
        air.append(tick())
        return air[-1]

    lab.chamber.tick = noted  # type: ignore[method-assign]
    lab.table.servo(0.0, True)
    lab.table.demand_rate(0.0, 12.0)
    lab.table.demand_rate(100.0, -3.0)
    lab.chamber.demand(0.0, set_point_c=-40.0, ramp_up=10.0, ramp_down=10.0, running=True)
    lab.advance(float(SECONDS))
    unit = lab.unit(gyro)
    signal = unit.measure(0.0, int(SECONDS * RATE_HZ), 1.0 / RATE_HZ)
    assert signal.turned_rad is not None
    own = ["xyz".index(axis) for axis in signal.axes]
    begun = np.arange(len(signal.temp_c)) // int(RATE_HZ)
    case = [unit.case_reading_c(at + 1e-9) for at in (np.arange(len(signal.temp_c)) + 1) / RATE_HZ]
    return (
        np.degrees(signal.turned_rad[:, own]) * RATE_HZ,
        np.array(air)[begun + 1],
        np.degrees(signal.angle_increment_rad) * RATE_HZ,
        signal.temp_c,
        np.array(case),
    )


def simulated(file: Path, gyro: str, rates_dps: Array, air_c: Array, step_s: float = 1.0 / RATE_HZ) -> Array:
    """Return FMPy's result, with these inputs from each sample's begin on."""
    names = [f"rate{axis}_dps" for axis in AXES[gyro]]
    signals = np.zeros(len(air_c), dtype=[(name, np.float64) for name in ("time", *names, "air_temp_c")])
    signals["time"], signals["air_temp_c"] = np.arange(len(air_c)) / RATE_HZ, air_c
    for name, rate_dps in zip(names, rates_dps.T, strict=True):
        signals[name] = rate_dps
    outputs = [*(f"output{axis}_dps" for axis in AXES[gyro]), "temp_c", "case_temp_c"]
    return np.asarray(
        fmpy.simulate_fmu(
            str(file), stop_time=len(air_c) / RATE_HZ, output_interval=step_s, input=signals, output=outputs
        )
    )


PLANT = Plant(seed=7, mounting={"fog_1": "axis_up"})
KINDS = {
    "fibre-optic": ("fog_1", PLANT),
    "ring laser": ("fog_1", PLANT.model_copy(update={"models": {"FOG-001": "rlg"}})),
    "three axes": ("ellipse_1", PLANT),
    "of a model file": ("fog_1", PLANT),
}


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_the_unit_of_the_lab(tmp_path: Path, kind: str) -> None:
    gyro, plant = KINDS[kind]
    if kind == "of a model file":
        (tmp_path / "nominal.toml").write_text(SHOCKED, encoding="utf-8")
        plant = plant.model_copy(update={"gap_model": {"FOG-001": tmp_path / "nominal.toml"}})
    file = tmp_path / "unit.fmu"
    write_unit_fmu(file, bench(), plant, gyro)
    assert validation.validate_fmu(str(file)) == []
    rates_dps, air_c, output_dps, temp_c, case_c = in_the_lab(plant, gyro)
    found = simulated(file, gyro, rates_dps, air_c)[1:]
    assert np.ptp(rates_dps) > 14.0 and np.ptp(air_c) > 20.0 and np.ptp(case_c) > 4.0
    for axis, expected in zip(AXES[gyro], output_dps.T, strict=True):
        assert found[f"output{axis}_dps"] == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert found["temp_c"] == pytest.approx(temp_c, rel=1e-12)
    assert found["case_temp_c"] == pytest.approx(case_c, rel=1e-12)


def still(file: Path, seconds: int, step_s: float) -> Array:
    samples = round(seconds * RATE_HZ)
    return simulated(file, "fog_1", np.full((samples, 1), 5.0), np.full(samples, 25.0), step_s)[1:]


def test_a_step_of_many_samples_is_their_mean_and_a_seed_is_its_own(tmp_path: Path) -> None:
    file, other = tmp_path / "unit.fmu", tmp_path / "other.fmu"
    write_unit_fmu(file, bench(), PLANT)
    assert gyrobench.write_unit_fmu(DEMO, other, plant=PLANT, seed=8) == other
    fine, coarse = still(file, 20, 0.1)["output_dps"], still(file, 20, 2.5)["output_dps"]
    assert coarse == pytest.approx(fine.reshape(-1, 25).mean(axis=1), rel=1e-9)
    assert np.abs(fine - 5.0).max() < 0.1
    assert not np.allclose(fine, still(other, 20, 0.1)["output_dps"], rtol=1e-9)


def test_a_step_that_cuts_a_sample_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "unit.fmu"
    write_unit_fmu(file, bench(), PLANT)
    with pytest.raises(fmpy.fmi1.FMICallException):
        still(file, 2, 0.04)
    alone = UnitAlone(json.loads(lab_config(bench(), PLANT).to_line()), tmp_path)
    with pytest.raises(ConfigurationError, match=r"a step of 0\.04 s.*0\.1 s, or a multiple"):
        alone.step(0.0, 0.04, {"rate_dps": 0.0, "air_temp_c": 25.0})


def test_the_command_writes_it_and_says_what_it_needs(tmp_path: Path) -> None:
    file = tmp_path / "2 ellipse.fmu"
    command = [
        "lab",
        "--bench",
        str(DEMO),
        "--seed",
        "3",
        "--fmu",
        str(file),
        "--gyro",
        "ellipse_1",
        "--json",
    ]
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    described = fmpy.read_model_description(str(file))
    assert "gyrobench must be importable" in described.description and "seed 3" in described.description
    assert [v.name for v in described.modelVariables if v.causality == "input"] == [
        "rate_x_dps", "rate_y_dps", "rate_z_dps", "air_temp_c",
    ]  # fmt: skip
    assert described.defaultExperiment.stepSize == "0.1"
    with zipfile.ZipFile(file) as parts:
        given = parts.read("resources/gyrobench_fmu.json").decode()
    assert "ELL-001" in given and not any(place in given for place in ("/dev/", "192.168."))


def test_what_cannot_be_is_refused_in_words(tmp_path: Path) -> None:
    tilted = tmp_path / "tilted.toml"
    tilted.write_text(TILTED, encoding="utf-8")
    for plant, gyro, name, words in (
        (PLANT, "fog_9", "unit.fmu", "no such gyro.*fog_9.*fog_1, ellipse_1"),
        (PLANT, "fog_1", "unit.zip", "ends in .fmu"),
        (PLANT, "fog_1", "none/unit.fmu", "cannot be written"),
        (PLANT.model_copy(update={"models": {"FOG-001": "imu"}}), "fog_1", "unit.fmu", "an IMU"),
        (PLANT.model_copy(update={"gap_model": {"FOG-001": tilted}}), "fog_1", "unit.fmu", "azimuth_error"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            write_unit_fmu(tmp_path / name, bench(), plant, gyro)
    assert list(tmp_path.iterdir()) == [tilted]


@pytest.mark.parametrize(
    ("words", "found"), [(["--gyro", "fog_1"], "--fmu"), (["--fmu", "a.fmu", "--virtual"], "none")]
)
def test_options_that_do_not_go_together_are_refused(words: list[str], found: str) -> None:
    said = CliRunner().invoke(app, ["lab", "--bench", str(DEMO), *words])
    assert said.exit_code == 2 and found in said.output
