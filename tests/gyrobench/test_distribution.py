"""Wheel and sdist: built from the checkout, installed into an empty environment, and used there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

import gyrobench

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
UV = Path(sys.executable).with_name("uv")
NEED_ANALYSIS = {
    *("Compensation", "Diagnosis", "Look", "LookOptions", "Study"),
    *("diagnose", "foretell", "look", "procedure_budgets"),
}
ROOMS = {"bench", "drivers", "gyrobench", "procedures", "simulators"}
MAPPING = """
format = 1
unit_id = "U"
latitude_deg = 48.0
[columns]
time = { name = "time_s", unit = "s" }
output = { name = "gyro_x_dps", unit = "deg/s" }
"""
INSTALLED = """
import importlib.metadata, pathlib, gyrobench
assert "site-packages" in gyrobench.__file__, gyrobench.__file__
points = importlib.metadata.distribution("gyrobench").entry_points
# pytest is not there, nor is scipy, which models and effects' fits need.
print(len([point.load() for point in points if point.group != "pytest11"]))
for name in gyrobench.__all__:
    try:
        getattr(gyrobench, name)
    except gyrobench.ConfigurationError as error:
        assert "gyrobench[analysis]" in str(error), error
        print(name)
"""


def done(*command: Path | str, cwd: Path) -> str:
    """Run a command as a user's shell would; return what it printed."""
    inherited = {
        key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "COVERAGE"))
    }
    environment = inherited | {"PYTHONDONTWRITEBYTECODE": "1"}
    if "PIP_FIND_LINKS" in environment:
        environment.setdefault("UV_FIND_LINKS", environment["PIP_FIND_LINKS"])
    # What `make setup` installed is in uv's cache; only where the cache is gone the index is asked.
    for more in ({"UV_OFFLINE": "1"}, {}):
        ended = subprocess.run(
            list(map(str, command)), cwd=cwd, env=environment | more, capture_output=True, text=True
        )
        if ended.returncode == 0 or command[0] != UV:
            break
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with sdist and wheel; the wheel is made of the sdist, which must then be whole."""
    source, out = tmp_path_factory.mktemp("source") / "gyrobench", tmp_path_factory.mktemp("dist")
    unbuilt = shutil.ignore_patterns(".*", "*.egg-info", "__pycache__", "build", "dist", "runs", "demo-out")
    shutil.copytree(ROOT, source, ignore=unbuilt)
    done(UV, "build", "--no-build-isolation", "--python", sys.executable, "--out-dir", out, cwd=source)
    return out


@pytest.fixture(scope="module")
def environment(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the programs of an environment that holds the wheel and what it says it needs, nothing else."""
    place = tmp_path_factory.mktemp("env") / "venv"
    done(UV, "venv", "--python", sys.executable, place, cwd=built)
    (wheel,) = built.glob("*.whl")
    pins = ROOT / "constraints.txt"
    done(UV, "pip", "install", "--python", place / "bin" / "python", "--constraint", pins, wheel, cwd=built)
    return place / "bin"


def test_the_wheel_holds_the_rooms_only(built: Path) -> None:
    (sdist,), (wheel,) = built.glob("*.tar.gz"), built.glob("*.whl")
    unpacked = built / "unpacked"
    shutil.unpack_archive(wheel, unpacked, "zip")
    folders = {place.name for place in unpacked.iterdir() if not place.name.endswith(".dist-info")}
    assert folders == ROOMS
    with tarfile.open(sdist) as archive:
        tops = {name.split("/")[1] for name in archive.getnames() if "/" in name}
    assert {"LICENSE", "README.md", "pyproject.toml"} | ROOMS <= tops and not {"tests", "benchmarks"} & tops
    tracked = done("git", "ls-files", *ROOMS, cwd=ROOT).split()
    missing = [file for file in tracked if not (unpacked / file).is_file() and not file.endswith(".md")]
    assert not missing


def test_every_entry_point_and_public_name_is_there(environment: Path, tmp_path: Path) -> None:
    points, *names = done(environment / "python", "-c", INSTALLED, cwd=tmp_path).split()
    groups = {**PROJECT["entry-points"], "console_scripts": PROJECT["scripts"], "pytest11": {}}
    assert int(points) == sum(map(len, groups.values()))
    assert {name for name in names if not name.startswith("fit_")} == NEED_ANALYSIS


def test_the_small_install_is_under_350_megabytes(environment: Path) -> None:
    files = [file for file in (environment.parent / "lib").rglob("*") if file.suffix != ".pyc"]
    assert sum(file.lstat().st_size for file in files) < 350e6


DEVICE = """
import os
from bench.analysis.common.device import compute_device
from drivers.base.errors import ConfigurationError
os.environ["GYROBENCH_DEVICE"] = "cuda"
try:
    compute_device()
except ConfigurationError as error:
    print(error.remedy)
import gyrobench
try:
    gyrobench.diagnose
except ConfigurationError as error:
    print(error.remedy)
"""


def test_what_needs_an_extra_that_is_not_installed_names_it(environment: Path, tmp_path: Path) -> None:
    assert done(environment / "python", "-c", DEVICE, cwd=tmp_path).splitlines() == [
        "pip install 'gyrobench[torch]'",
        "pip install 'gyrobench[analysis]'",
    ]
    (tmp_path / "log.csv").write_text("time_s,gyro_x_dps\n0,1\n1,2\n")
    (tmp_path / "map.toml").write_text(MAPPING)
    (tmp_path / "lab.toml").write_text((ROOT / "examples" / "demo.toml").read_text(encoding="utf-8"))
    for words, extra in (
        (["look", "log.csv"], "analysis"),
        (["import", "log.csv", "--mapping", "map.toml"], "analysis"),
        (["fit", "whirl", "runs/one"], "analysis"),
        (["foretell", "standard-test", "--noise", "angle_random_walk=0.01"], "analysis"),
        (["panel"], "panel"),
    ):
        ended = subprocess.run(
            [environment / "gyrobench", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={"PATH": "/bin"},
        )
        assert ended.returncode == 2 and f"gyrobench[{extra}]" in " ".join(ended.stderr.split()), ended.stderr


def test_an_lstm_without_torch_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    from bench.analysis.thermal import LstmModel

    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(gyrobench.ConfigurationError, match=r"gyrobench\[torch\]"):
        LstmModel().fit([], [])


def test_import_takes_less_than_a_quarter_of_a_second_of_processor(environment: Path, tmp_path: Path) -> None:
    program = "import time, gyrobench; print(time.process_time())"
    assert min(float(done(environment / "python", "-c", program, cwd=tmp_path)) for _ in range(3)) < 0.25


def test_the_command_says_its_version_and_rehearses(environment: Path, tmp_path: Path) -> None:
    assert done(environment / "gyrobench", "--version", cwd=tmp_path) == f"gyrobench {PROJECT['version']}\n"
    shutil.copy(ROOT / "examples" / "demo.toml", tmp_path)
    done(environment / "gyrobench", "rehearse", "known-state", "--bench", "demo.toml", cwd=tmp_path)
    (run,) = (tmp_path / "runs").iterdir()
    assert "<svg" in (run / "report.html").read_text(encoding="utf-8")
    shown = done(environment / "gyrobench", "runs", "list", cwd=tmp_path)
    assert run.name in shown and "completed" in shown
