"""The example package beside this file is installed for real, offline, and a run uses its driver and
emulator."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

PACKAGE = Path(__file__).parent / "acme_gyro"
BENCH = """
[bench]
name = "bench with a gyro nobody here has heard of"
latitude_deg = 39.10
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB2"
[[gyro]]
name = "acme_1"
driver = "acme_gy1"
port = "/dev/ttyUSB1"
baudrate = 115200
rate_hz = 50
axis = "x"
unit = "GY1-0007"
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Install the package into a folder of its own, with what is on this machine only."""
    source = (
        tmp_path_factory.mktemp("source") / "acme_gyro"
    )  # a build leaves its own files beside the sources
    shutil.copytree(PACKAGE, source)
    target = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        "--no-build-isolation",
    ]
    command += ["--disable-pip-version-check", "--target", str(target), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def gyrobench(arguments, site, cwd):
    environment = {**os.environ, "PYTHONPATH": str(site) if site else ""}
    program = [sys.executable, "-c", "from bench.present.cli import main; main()", *arguments]
    return subprocess.run(program, env=environment, cwd=cwd, capture_output=True, text=True, timeout=120)


def test_the_example_is_short():
    code = [line for line in (PACKAGE / "acme_gyro.py").read_text().splitlines() if line.strip()]
    assert len(code) <= 56  # ten of them bring a key of its own into the bench file


def test_its_driver_runs_a_procedure_by_name(installed, tmp_path):
    (tmp_path / "lab.toml").write_text(BENCH)
    arguments = ["rehearse", "constant-rotation", "--turns", "6"]
    done = gyrobench(arguments, installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["outcome"] == "completed"
    assert manifest["devices"]["acme_1"]["maker"] == "ACME"
    assert manifest["stream"]["acme_1"]["lost"] == 0
    table = pq.read_table(run / "gyro_acme_1.parquet").to_pandas()
    assert len(table) == manifest["stream"]["acme_1"]["frames"] > 1000


def test_its_driver_brings_a_key_of_its_own(installed, tmp_path):
    """A mistake in it is told as one in ours: key, found, expected; the record is decoded by it."""
    for keys, told in (
        ("gain = 9.0", ("gyro[0].gain", "9.0 (a number)", "0 to 8 (at most 8)")),
        ("gian = 2.0", ("gyro[0].gian", "an unknown key", "did you mean 'gain'?")),
        ("gain = 2.0\nrate_hz = 400", ("gyro[0].gain", "2.0", "1 above 200 Hz")),
    ):
        text = BENCH.replace("rate_hz = 50\n", "") if "rate_hz" in keys else BENCH
        (tmp_path / "lab.toml").write_text(text + keys + "\n")
        done = gyrobench(["rehearse", "constant-rotation"], installed, tmp_path)
        assert done.returncode == 2
        words = " ".join(done.stderr.split())
        assert "lab.toml" in words and all(part in words for part in told), done.stderr
    (tmp_path / "lab.toml").write_text(BENCH + "gain = 4.0\n")
    done = gyrobench(["rehearse", "constant-rotation", "--turns", "6"], installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    assert json.loads((run / "manifest.json").read_text())["bench"]["gyro"][0]["gain"] == 4.0
    sent = np.frombuffer((run / "raw" / "acme_1.bin").read_bytes(), np.uint8).reshape(-1, 12)[:, 2:6]
    rates = pq.read_table(run / "gyro_acme_1.parquet")["rate_dps"].to_numpy()
    np.testing.assert_allclose(sent.copy().view(">f4")[-len(rates) :, 0] / 4.0, rates)


BAROMETER = """
[[barometer]]
name = "baro"
driver = "acme_b1"
port = "/dev/ttyUSB5"
height_m = 1500.0
"""


def test_its_role_stands_in_the_bench_file_and_is_recorded(installed, tmp_path):
    """1500 m in the ICAO standard atmosphere: 845.6 hPa."""
    (tmp_path / "lab.toml").write_text(BENCH + BAROMETER)
    done = gyrobench(["rehearse", "constant-rotation", "--turns", "6"], installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["devices"]["baro"]["role"] == "barometer"
    assert manifest["bench"]["barometer"][0]["height_m"] == 1500.0
    pressure = pq.read_table(run / "barometer_baro.parquet")["pressure_hpa"].to_numpy()
    assert len(pressure) > 60 and np.all(np.abs(pressure - 845.6) < 0.1)
    (tmp_path / "lab.toml").write_text(BENCH + BAROMETER.replace("height_m", "hight_m"))
    done = gyrobench(["rehearse", "constant-rotation"], installed, tmp_path)
    words = " ".join(done.stderr.split())
    assert done.returncode == 2
    assert "barometer[0].hight_m" in words and "did you mean 'height_m'?" in words
    done = gyrobench(["rehearse", "constant-rotation"], None, tmp_path)
    assert "barometer" in done.stderr and "an unknown key" in done.stderr


def test_without_the_package_its_name_is_unknown_and_the_known_ones_are_listed(tmp_path):
    (tmp_path / "lab.toml").write_text(BENCH)
    done = gyrobench(["rehearse", "constant-rotation"], None, tmp_path)
    assert done.returncode == 2
    assert "gyro[0].driver" in done.stderr and "acme_gy1" in done.stderr and "kvh1750" in done.stderr


ETALON = """
format = 1
[noise]
arw_deg_per_sqrt_h = 0.003
[[effect]]
name = "acme_etalon"
parameters = { bias_dph = 0.5 }
sigma = { bias_dph = 0.1 }
shape = { period_k = 12.0 }
"""


def test_its_effect_is_a_candidate_and_a_term_of_models(installed, tmp_path):
    """sin(2 pi (28 - 25) / 12) = 1: 0.5 deg/h above Earth rate at 28 degC, by a model file."""
    (tmp_path / "etalon.toml").write_text(ETALON)
    script = """
import sys
from pathlib import Path
import numpy as np
from bench.analysis.gap import read_model
from simulators.effects import Stimulus, catalogue
n = 300
warm = np.full(n, 28.0)
s = Stimulus(np.arange(1.0, n + 1.0), warm, warm, np.zeros(n + 1), np.full(n, 90.0), 0.0)
print(catalogue()["acme_etalon"].source)
print(round(float(read_model(Path(sys.argv[1])).predict(s).mean()), 9))
"""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-c", script, str(tmp_path / "etalon.toml")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:2] == ["acme, application note 12", "0.5"]


def test_its_effects_are_found_by_a_diagnosis(installed):
    """Hidden: 0.3 deg/h times sin(2 pi (T - 25) / 12), and a sensor that reads 1.5 K ((T - 25) / 50)^2 high."""
    script = """
from dataclasses import replace
from pathlib import Path
import numpy as np
from bench.analysis.gap import closed_model, diagnose, parse_model, read_model
from tests.analysis.gap.channel_lab import recorded
from tests.analysis.gap.conftest import made_run, stimulus
rng = np.random.default_rng(4)
s = stimulus(4000)
hidden = 0.3 * np.sin(2.0 * np.pi * (s.t_in_c - 25.0) / 12.0)
model = parse_model("format = 1\\n[noise]\\narw_deg_per_sqrt_h = 0.004\\n", "here")
found = diagnose([made_run(name, s, rng, hidden) for name in "ab"], model)
print(*(cause.name for cause in found.causes))
nominal = read_model(Path("examples/nominal/fog_cold_shock.toml"))
fitted = closed_model(diagnose(recorded(1), nominal))
series = [each for each in recorded(2) if each.channel == "gyro_temperature"]
(own,) = series
series = [replace(own, values=own.values + 1.5 * ((own.values - 25.0) / 50.0) ** 2)]
print(*(cause.name for cause in diagnose(series, fitted).causes))
"""
    root = PACKAGE.parents[2]
    environment = {**os.environ, "PYTHONPATH": f"{installed}{os.pathsep}{root}"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd=root
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:2] == ["acme_etalon", "acme_thermistor"]


MODEL = """
format = 1
[noise]
arw_deg_per_sqrt_h = 0.003
"""
ITS_OWN = """
[[effect]]
name = "acme_etalon"
parameters = { bias_dph = 0.5 }
sigma = { bias_dph = 0.1 }
shape = { period_k = 12.0 }
[[effect]]
name = "acme_gear"
parameters = { bias_dph_cos = 1.5, bias_dph_sin = -1.0 }
sigma = { bias_dph_cos = 0.1, bias_dph_sin = 0.1 }
[[effect]]
name = "acme_self_test"
parameters = { offset_dph = 4.0 }
sigma = { offset_dph = 0.1 }
"""
PLANT = """
seed = 3
mount_azimuth_error_deg = 0.0
[gap_model]
GY1-0007 = "true.toml"
"""


def test_its_effect_and_its_disturbance_are_rehearsed_diagnosed_and_closed(installed, tmp_path):
    for name, text in (
        ("lab.toml", BENCH),
        ("true.toml", MODEL + ITS_OWN),
        ("nominal.toml", MODEL),
        ("plant.toml", PLANT),
    ):
        (tmp_path / name).write_text(text)
    turning = ["-s", "rate_dps=20", "-s", "turns=40"]
    done = gyrobench(
        ["rehearse", "constant-rotation", "--plant", "plant.toml", *turning], installed, tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    asked = [str(run), "--model", "nominal.toml"]
    done = gyrobench(["gap", "diagnose", *asked, "--json"], installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    facts = json.loads(done.stdout)
    (cause,) = [each for each in facts["causes"] if each["name"] == "acme_gear"]
    assert cause["parameters"]["bias_dph_cos"] == pytest.approx(1.5, abs=0.1)
    assert cause["parameters"]["bias_dph_sin"] == pytest.approx(-1.0, abs=0.1)
    (found,) = facts["disturbances"]
    assert found["name"] == "acme_self_test"
    assert found["parameters"]["offset_dph"] == pytest.approx(4.0, abs=0.2)
    done = gyrobench(["gap", "close", *asked, "--out", "closed.toml"], installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    closed = tomllib.loads((tmp_path / "closed.toml").read_text())
    assert {"acme_gear", "acme_self_test"} <= {each["name"] for each in closed["effect"]}


HEAT = """
[accuracy]
gyro_temperature = 0.1
[[effect]]
name = "case_to_gyro_conductance"
parameters = { conductance_w_per_k = 0.25 }
sigma = { conductance_w_per_k = 0.001 }
[[effect]]
name = "gyro_heat_capacity"
parameters = { gyro_j_per_k = 105.0 }
sigma = { gyro_j_per_k = 0.5 }
[[effect]]
name = "gyro_core_heat"
parameters = { core_j_per_k = 35.0, core_w_per_k = 0.12 }
sigma = { core_j_per_k = 0.2, core_w_per_k = 0.001 }
"""
THERMISTOR = """
[[effect]]
name = "acme_thermistor"
parameters = { curvature_k = 3.0 }
sigma = { curvature_k = 0.1 }
"""


def test_its_effect_of_a_temperature_sensor_is_rehearsed_diagnosed_and_closed(installed, tmp_path):
    """The sensor reads 3 K ((T - 25) / 50)^2 high: the diagnosis finds that in what was rehearsed with it."""
    on_case = BENCH.replace("rate_hz = 50", "rate_hz = 2").replace(
        '/dev/ttyUSB2"', '/dev/ttyUSB2"\nauxiliary = { 1 = "acme_1 case" }'
    )
    for name, text in (
        ("lab.toml", on_case + "case_sensor = 1\n"),
        ("true.toml", MODEL + HEAT + THERMISTOR),
        ("nominal.toml", MODEL + HEAT),
        ("plant.toml", PLANT),
    ):
        (tmp_path / name).write_text(text)
    quick = "soak_min=20 hold_min=10 warm_up_min=0 drift_k_per_10min=2 east_after_min=0 east_dwell_s=60"
    shock = [part for setting in quick.split() for part in ("-s", setting)]
    done = gyrobench(
        ["rehearse", "zero-bias-cold-shock", "--plant", "plant.toml", *shock], installed, tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    asked = [str(run), "--model", "nominal.toml", "--out", "closed.toml"]
    done = gyrobench(["gap", "close", *asked], installed, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    closed = tomllib.loads((tmp_path / "closed.toml").read_text())
    (found,) = [effect for effect in closed["effect"] if effect["name"] == "acme_thermistor"]
    assert found["parameters"]["curvature_k"] == pytest.approx(3.0, abs=0.2)


def test_its_effect_runs_in_a_plant_by_the_second_and_one_read_off_the_record_is_tried(installed):
    """Etalon: 0.5 deg/h sin(2 pi (T - 25) / 12) at every second; knee: 40 ppm of what is beyond 30 deg/s."""
    script = """
import numpy as np
from bench.analysis.gap import diagnose, parse_model
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.modelled_unit import ModelledErrors, ModelledTerm
from simulators.plant.noise import NoiseParameters
from tests.analysis.gap.test_gap_record_effects import _rates_runs, _steps
term = ModelledTerm("acme_etalon", (0.5,), {"period_k": 12.0})
errors = ModelledErrors((term,), NoiseParameters(0.0, 0.0, 0.0))
lab = LabPlant(PlantConfig(units=(UnitConfig("u", errors=errors),)))
lab.chamber.demand(0.0, set_point_c=0.0, ramp_up=0.0, ramp_down=0.0, running=True)
lab.advance(2000.0)
truth = lab.true_drift("u")
expected = 0.5 * np.sin(2.0 * np.pi * (truth["sensor_temp_c"] - 25.0) / 12.0)
print(np.ptp(truth["bias_dph"]) > 0.9, np.abs(truth["bias_dph"] - expected).max() < 0.02)
knee = 30.0 * 3600.0
s = _steps((0.0, 10.0, -10.0, 25.0, -25.0, 35.0, -35.0, 45.0, -45.0, 60.0, -60.0))
def response(rate):
    return rate + 1e-6 * 40.0 * np.sign(rate) * max(abs(rate) - knee, 0.0)
model = parse_model("format = 1\\n[noise]\\narw_deg_per_sqrt_h = 0.004\\n", "here")
found = diagnose(_rates_runs(6, response, s=s), model)
print(*((cause.name, abs(cause.term.variant.shape["knee_dps"] - 30.0) < 1.0) for cause in found.causes))
"""
    root = PACKAGE.parents[2]
    environment = {**os.environ, "PYTHONPATH": f"{installed}{os.pathsep}{root}"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd=root
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["True True", "('acme_knee', True)"]
