"""Without termios, fcntl, tty, pty and resource, as on Windows: what only reads and works out still works.

Only our modules are kept from them: the libraries underneath have their own ways on Windows.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HIDDEN = """
import importlib, pkgutil, sys
import can, joblib, matplotlib.pyplot, multiprocessing, pandas, pymodbus, pytest, rich.live
import serial, serial.tools.list_ports, torch
for library in ("asammdf", "distributed", "nicegui", "uvicorn"):
    importlib.import_module(library)

class Hides:
    def find_spec(self, name, path=None, target=None):
        if name in ("termios", "fcntl", "tty", "pty", "resource"):
            raise ModuleNotFoundError(name, name=name)

for name in ("termios", "fcntl", "tty", "pty", "resource"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hides())
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
NEEDS_POSIX = {
    *("bench.campaign", "bench.control.lease", "bench.control.recover", "bench.control.runner"),
    *("bench.control.watchdog", "bench.lab.rehearsal", "bench.lab.testing", "bench.present.cli._shown_run"),
    *("gyrobench._operate", "simulators.lab._build", "simulators.lab._core", "simulators.lab._ports"),
    *("simulators.lab._service", "simulators.lab._lock_step", "simulators.lab.in_process"),
    "bench.present.panel",
}
"""What takes a lease or looks for one, locks a campaign, or serves an emulated lab on ptys."""


def said(code: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_everything_but_running_a_bench_is_imported(tmp_path: Path) -> None:
    assert set(said(HIDDEN + IMPORTS, tmp_path).split()) == NEEDS_POSIX


def test_a_look_has_the_same_figures(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{0.001 * ((7919 * k) % 101 - 50):.6f}" for k in range(2000)]
    (tmp_path / "log.csv").write_text("time_s,gyro_x_dps\n" + "\n".join(rows) + "\n")
    assert said(HIDDEN + LOOK, tmp_path) == said(LOOK, tmp_path) != "[]\n"
