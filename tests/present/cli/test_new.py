"""`gyrobench new ...`: what it writes does at once what the commands say that it prints."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.control.run_record import decode_run
from bench.record.events.run import Series
from bench.record.recording import Run, verify
from gyrobench._rooms import ROOMS

PROGRAMS = Path(sys.executable).parent


def shell() -> dict[str, str]:
    """Return the environment of a shell in which gyrobench is installed."""
    return os.environ | {"PATH": f"{PROGRAMS}{os.pathsep}{os.environ['PATH']}"}


def typed(command: str, folder: Path) -> str:
    """Type a command in a shell in `folder`; packages are installed beside it, from what is on this machine."""
    site = folder.parent / "site"
    environment = shell() | {
        "PYTHONPATH": str(site),
        "PIP_TARGET": str(site),
        "PIP_NO_INDEX": "1",
        "PIP_NO_DEPS": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # pip's way to say that there is none
        "COLUMNS": "200",
    }
    ended = subprocess.run(command, shell=True, cwd=folder, env=environment, capture_output=True, text=True)
    assert ended.returncode == 0, f"{command}\n{ended.stdout}{ended.stderr}"
    return ended.stdout


def tried(what: str, folder: Path) -> list[str]:
    """Write a new thing, type every command it prints; return what each of them printed."""
    folder.mkdir(exist_ok=True)
    printed = typed(f"gyrobench new {what}", folder)
    commands = printed.split("try it:\n")[1].splitlines()
    assert commands and all(line.startswith("    ") for line in commands)
    return [typed(command.strip(), folder) for command in commands]


def run_of(runs: Path) -> Run:
    (run,) = runs.iterdir()
    return Run.open(run)


def refused(command: str, folder: Path) -> str:
    ended = subprocess.run(
        [PROGRAMS / "gyrobench", *command.split()], cwd=folder, capture_output=True, text=True
    )
    assert ended.returncode == 2 and "Traceback" not in ended.stderr, ended.stderr
    return " ".join(ended.stderr.split())


@pytest.mark.slow
def test_a_procedure_measures_the_scale_factor_of_the_emulated_unit(tmp_path: Path) -> None:
    place = tmp_path / "mine"
    shown = tried("procedure my-test", place)
    assert "limit_ppm" in shown[1] and re.search(r"scale_factor_error .* -2000 .* inside", shown[2])
    assert "`gyrobench procedures ./my_test.py` shows" in refused(
        "rehearse ./my_test.py --rate-dps -1", place
    )
    run = run_of(place / "runs")
    assert run.manifest.outcome == "completed" and run.manifest.procedure == "my-test"
    value = {row["name"]: row["value"] for row in run.manifest.measurements}
    true_ppm = run.truth("fog_1")["sf_error_ppm"][15:]
    assert value["scale_factor_error"] == pytest.approx(true_ppm.mean(), abs=5.0)
    up_dph = 15.041067 * math.sin(math.radians(39.98))  # Earth rate along the vertical
    assert value["mean_output"] == pytest.approx(up_dph, abs=0.3)
    assert (run.place / "procedure.py").read_text() == (place / "my_test.py").read_text()
    report = (run.place / "report.html").read_text(encoding="utf-8")
    assert "Worked out by the procedure" in report and "Output over rate." in report
    ((_, series),) = run.of(Series)
    assert series.columns["rate [deg/s]"] == [10.0, -10.0]
    assert all(f">{value:#.6g}<" in report.replace("−", "-") for value in series.columns["output [deg/s]"])
    for high, code in ((2000, 0), (1, 4)):
        (place / "limits.toml").write_text(
            f'[limits."my-test.scale_factor_error"]\nunit = "ppm"\nlow = -2000\nhigh = {high}\n'
        )
        # The second time `runs/*` names the first certificate, too.
        command = "gyrobench report runs/* --limits limits.toml --atml --json"
        ended = subprocess.run(
            ["bash", "-c", command], cwd=place, env=shell(), capture_output=True, text=True
        )
        assert ended.returncode == code
        told = Path(json.loads(ended.stdout.splitlines()[-1])["atml"])
        outcome = "Passed" if code == 0 else "Failed"
        assert f'<tr:Outcome value="{outcome}" />' in (place / told).read_text(encoding="utf-8")
    assert verify(run.place, decode_run).passed
    (run.place / "procedure.py").write_text("# another\n")
    assert [problem.path for problem in verify(run.place, decode_run).problems] == ["procedure.py"]


@pytest.mark.slow
def test_a_bench_and_a_campaign_are_rehearsed(tmp_path: Path) -> None:
    place = tmp_path / "mine"
    tried("bench lab", place)
    assert run_of(place / "runs").manifest.outcome == "completed"
    tried("campaign week", place)
    runs = place / "week-rehearsed" / "runs"
    outcomes = {path.name: Run.open(path).manifest.outcome for path in runs.iterdir()}
    assert outcomes == dict.fromkeys(("warm", "turn-1", "turn-2"), "completed")


@pytest.mark.slow
def test_a_driver_streams_what_its_emulator_sends(tmp_path: Path) -> None:
    tried("driver acme-g1", tmp_path / "mine")
    run = run_of(tmp_path / "mine" / "runs")
    assert run.manifest.outcome == "completed"
    assert run.manifest.devices["gyro_1"].kind == "acme_g1"
    stream = run.manifest.stream["gyro_1"]
    assert stream["lost"] == 0 and not any(stream["rejected"].values())
    turning = run.phase_at(run.gyro("gyro_1")["time_ns"] * 1e-9) == "turn_forward"
    assert run.gyro("gyro_1")["rate_dps"][turning].mean() == pytest.approx(6.0, abs=0.01)


@pytest.mark.slow
def test_an_effect_is_found_in_the_emulated_unit_that_has_it(tmp_path: Path) -> None:
    diagnosis = tried("effect gear", tmp_path / "mine")[-1]
    found = re.search(r"gear .*bias_dph_cos = (\S+).*bias_dph_sin = (\S+)", " ".join(diagnosis.split()))
    assert found is not None, diagnosis
    assert [float(value) for value in found.groups()] == pytest.approx([1.5, -1.0], abs=0.1)


def test_what_is_there_is_kept_and_a_name_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("# precious\n")
    assert "mine.py: it is there already" in refused("new procedure mine", tmp_path)
    assert (tmp_path / "mine.py").read_text() == "# precious\n"
    (tmp_path / "acme").mkdir()
    assert "acme: it is there already" in refused("new driver acme", tmp_path)
    for name in ("../mine", "class", "2nd", "ü"):
        assert "a name that cannot be used" in refused(f"new procedure {name}", tmp_path)
    assert "hides a module of Python" in refused("new driver json", tmp_path)
    for room in ("gyrobench", *ROOMS):
        assert "hides a module of gyrobench" in refused(f"new procedure {room}", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["acme", "mine.py"]
