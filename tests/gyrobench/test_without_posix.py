"""Without termios, fcntl, ptys, Unix sockets and more that Windows lacks: what reads and works out works.

Only our modules are kept from them: the libraries underneath have their own ways on Windows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gyrobench
from bench.analysis.gap._case_folder import write_case
from bench.analysis.gap._exam import make_case, nominal_model
from bench.analysis.gap._model_file import model_text
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform
from tests.gyrobench.hidden_posix import HIDDEN, LOCKING, PAIRS, PROCESSES, said

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "examples" / "demo.toml"
MAPPING = """
format = 1
unit_id = "SN1"
gyro = "fog_1"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/s" }
"""
LIBRARIES = """
import importlib
for library in ("asammdf", "distributed", "matplotlib.pyplot", "nicegui", "pymodbus", "torch", "uvicorn"):
    importlib.import_module(library)
"""
IMPORTS = """
import bench, drivers, gyrobench, procedures, simulators
for room in (bench, drivers, gyrobench, procedures, simulators):
    for module in pkgutil.walk_packages(room.__path__, room.__name__ + "."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError:
                print(module.name)
"""
LOOK = """
import gyrobench
found = gyrobench.look("log.csv")
print([(axis.channel.name, axis.figures.mean, axis.figures.sigma) for axis in found.axes])
"""
WORK = """
import re, sys
from pathlib import Path
import gyrobench
from bench.present.report import report_run

run = gyrobench.open_run(next(Path("runs").iterdir()))
print(run, run.seal, run.gyro("fog_1")["rate_dps"].mean())
made = gyrobench.import_log(Path("log.csv"), Path("map.toml"), Path(sys.argv[1]))
print(gyrobench.open_run(made).gyro("fog_1")["rate_dps"].sum())
report = report_run(run.place, Path(sys.argv[1]) / "report.html").read_text(encoding="utf-8")
print(len(report), re.sub(r"20\\d\\d-\\d\\d-\\d\\d.\\d\\d:\\d\\d(:\\d\\d)?", "", report))
found = gyrobench.diagnose(["case/runs.toml"], "nominal.toml")
print(found)
print([(cause.effect, cause.values) for channel in found.channels for cause in getattr(channel, "causes", ())])
"""
FIT = """
import gyrobench
[study] = gyrobench.fit_stepwise(["ramps/up"], ["ramps/down"]).values()
print(study, study.equation.result.steps[-1], [row.after_dph for row in study.chosen.judged])
study = gyrobench.fit_heading_effect("heading.csv", latitude_deg=0.0, longitude_deg=100.0)
print(study, study.model.tau_s, study.nine)
"""
RING_LASER = """
[bench]
name = "ring laser"
latitude_deg = 39.1
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB9"
[[gyro]]
name = "rlg_1"
driver = "rlg2t"
port = "/dev/ttyUSB1"
baudrate = 115200
rate_hz = 2
axes = "x"
axis = "x"
unit = "RLG-001"
"""
REHEARSE = """
import sys
import gyrobench
for number in range(2):  # the second finds no lease of the first
    result = gyrobench.rehearse("known-state", sys.argv[1], "ran", seed=3)
    assert result.outcome == "completed", result.reason
run = gyrobench.open_run(result.folder)
print({name: entry.sha256 for name, entry in run.manifest.files.items() if name.startswith("raw/")})
"""
RUN = """
import sys
import gyrobench
try:
    gyrobench.run("known-state", sys.argv[1], yes=True)
except gyrobench.ConfigurationError as error:
    print(error.remedy)
"""
KNOWN = """
del os.kill
from bench.control.live._files import _runs
from drivers.base.windows import end_process, hold_process, process_runs
child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
known = [[process_runs(child.pid)], [_runs(child.pid, 0)]]
end_process(hold_process(child.pid), 10.0)
child.wait()
known[0].append(process_runs(child.pid))
known[1].append(_runs(child.pid, 0))
print(*known)
"""
LACKED = """
import logging
logging.disable()
from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError
from drivers.slcan import open_can

clock = WallClock()
for interface in sorted(can.VALID_INTERFACES - {"virtual", "gyrobench_slcan"}):
    try:
        open_can(interface, "0", 500_000, clock, "fog_1")
    except ConfigurationError as error:
        print(f"{interface}: {error}")
_, link = open_can("virtual", "bench", 500_000, clock, "fog_1")
other = can.Bus(interface="virtual", channel="bench")
other.send(can.Message(arbitration_id=0x11, data=bytes.fromhex("1122334455667788")))
print(link.read_exactly(27, 20.0), end=" ")
for number in range(60_000):  # more than the sockets hold: closing does not wait for who reads
    other.send(can.Message(arbitration_id=number, data=bytes(8)))
link.close()
print("left")
"""
HELD = """
import sys
from bench.control.lease import lease_holder, take_lease
bench = gyrobench.load_bench(sys.argv[1])
with take_lease(bench, "one"):
    print(lease_holder(bench).purpose)
    try:
        take_lease(bench, "two")
    except gyrobench.BenchInUse as error:
        print("in use:", "one" in str(error))
print(lease_holder(bench))
with take_lease(bench, "three") as lease:
    print(lease.stale)
"""


def test_a_can_interface_that_the_machine_lacks_is_refused_in_words(tmp_path: Path) -> None:
    lines = said(HIDDEN + PAIRS + LACKED, tmp_path).splitlines()
    refused = dict(line.split(": ", 1) for line in lines[:-1])
    assert {"kvaser", "neovi", "pcan", "vector", "ixxat", "nixnet", "socketcan"} <= set(refused)
    for interface, text in refused.items():
        assert text.startswith(f"fog_1 ({interface}, 0): the CAN bus cannot be opened. Found: "), text
        assert "Expected: " in text and "Remedy: " in text
    assert lines[-1] == "b'T0000001181122334455667788\\r' left"


def test_a_process_is_known_to_run_without_asking_it(tmp_path: Path) -> None:
    """`os.kill(pid, 0)` would be Ctrl-C there."""
    shown = said(PROCESSES + HIDDEN + KNOWN, tmp_path)
    assert shown == "[True, False] [True, False]\n"


def test_everything_is_imported(tmp_path: Path) -> None:
    assert said(LIBRARIES + HIDDEN + IMPORTS, tmp_path) == ""


def test_a_bench_is_leased_to_one(tmp_path: Path) -> None:
    shown = said(HIDDEN + LOCKING + "import gyrobench" + HELD, tmp_path, str(DEMO)).splitlines()
    assert shown == ["one", "in use: True", "None", "()"]


@pytest.mark.slow
def test_a_rehearsal_over_tcp_records_the_same_bytes(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    hidden = said(HIDDEN + LOCKING + PAIRS + REHEARSE, there, str(DEMO))
    assert hidden == said(REHEARSE, here, str(DEMO)) and "raw/fog_1.idx" in hidden


def test_a_run_where_no_watchdog_can_be_is_asked_for(tmp_path: Path) -> None:
    refused = HIDDEN + LOCKING + PAIRS + RUN
    assert "`watchdog = false` in [safe]" in said(refused, tmp_path, str(DEMO))
    assert not (tmp_path / "runs").exists()


def test_a_look_has_the_same_figures(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{0.001 * ((7919 * k) % 101 - 50):.6f}" for k in range(2000)]
    (tmp_path / "log.csv").write_text("time_s,gyro_x_dps\n" + "\n".join(rows) + "\n")
    assert said(HIDDEN + LOOK, tmp_path) == said(LOOK, tmp_path) != "[]\n"


def write_heading_log(path: Path) -> None:
    """Six stays of 48 h at the equator, after ten days at heading 0."""
    platform = SpaceStablePlatform(draw_platform(11, latitude_deg=0.0), 1, 300.0)
    platform.advance(np.zeros(240 * 12))
    platform.align()
    flown = platform.advance(np.repeat(60.0 * np.arange(6), 48 * 12))
    position = (flown.north_as / 3600.0, 100.0 + flown.east_as / 3600.0)
    rows = np.column_stack((flown.time_s, *position, flown.temp_c, flown.heading_deg))
    names = "time_s,latitude_deg,longitude_deg,temp_c,heading_deg"
    np.savetxt(path, rows, "%.12g", ",", header=names, comments="")


@pytest.mark.slow
def test_fits_have_the_same_figures(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(RING_LASER)
    profile = {"low_c": 15, "high_c": 45, "ramp_k_per_min": 1.5, "dwell_min": 8, "warm_up_min": 0}
    for seed, name in enumerate(("up", "down")):
        ramp = gyrobench.rehearse(
            "thermal-ramp", tmp_path / "bench.toml", tmp_path, seed=seed, **profile, downwards=name == "down"
        )
        (tmp_path / "ramps").mkdir(exist_ok=True)
        ramp.folder.rename(tmp_path / "ramps" / name)
    write_heading_log(tmp_path / "heading.csv")
    figures = said(FIT, tmp_path)
    assert said(HIDDEN + FIT, tmp_path) == figures
    assert "RLG-001" in figures and "NineCoefficients(" in figures


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_runs_imports_reports_and_the_gap_have_the_same_figures(tmp_path: Path) -> None:
    gyrobench.rehearse("known-state", ROOT / "examples" / "demo.toml", tmp_path / "runs", seed=3)
    _, given, *_ = make_case(300_000, "single")
    write_case(tmp_path / "case", given[2:4])
    (tmp_path / "nominal.toml").write_text(model_text(nominal_model()))
    rows = [f"{0.01 * k:.2f},{0.001 * ((7919 * k) % 101 - 50):.6f}" for k in range(2000)]
    (tmp_path / "log.csv").write_text("t,rate\n" + "\n".join(rows) + "\n")
    (tmp_path / "map.toml").write_text(MAPPING)
    said_here, said_hidden = (
        said(code, tmp_path, out) for code, out in ((WORK, "here"), (HIDDEN + WORK, "there"))
    )
    assert said_hidden == said_here and "<svg" in said_here
