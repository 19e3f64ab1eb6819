"""`import gyrobench`: every name is explained; it loads nothing; nobody hides a room."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import gyrobench
from bench.analysis.calibration import Calibration
from bench.analysis.common.compensation import FittedCompensation
from bench.analysis.figures import Figure, StandardFigures
from bench.analysis.heading import HeadingStudy
from bench.analysis.rlg import RlgStudy
from bench.present.report import render_page
from bench.record.benchfile import load_bench_file
from bench.record.shown import Shown
from benchmarks.public_names import listed

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", sorted(listed()))
def test_every_name_has_a_docstring(name: str) -> None:
    assert inspect.getdoc(getattr(gyrobench, name))


def test_type_checkers_are_told_the_names_that_there_are() -> None:
    tree = ast.parse((ROOT / "gyrobench" / "__init__.py").read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    told = {
        alias.asname: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert told == gyrobench._HOME_OF


def test_version_is_that_of_the_distribution() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert gyrobench.__version__ == project["version"]


def test_an_unknown_name_is_told() -> None:
    with pytest.raises(AttributeError, match=r"no 'open_ran'; docs/api.md"):
        _ = gyrobench.open_ran  # type: ignore[attr-defined]


def test_import_loads_no_room() -> None:
    code = "import sys, gyrobench; print(sorted({'bench', 'drivers', 'numpy', 'torch'} & set(sys.modules)))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"


@pytest.mark.parametrize("room", ["bench", "drivers", "procedures", "simulators"])
def test_a_folder_of_the_users_that_hides_a_room_is_named(
    tmp_path: Path, room: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(
        "PYTHONSAFEPATH", raising=False
    )  # the command line sets it, in other tests' process too
    (tmp_path / room).mkdir()
    (tmp_path / room / "__init__.py").touch()
    (tmp_path / "mine.py").write_text("import gyrobench\ngyrobench.open_run('runs/x')\n")
    script = subprocess.run([sys.executable, "mine.py"], cwd=tmp_path, capture_output=True, text=True)
    said = script.stderr.splitlines()[-1]
    assert said.startswith(f"ImportError: {tmp_path / room} hides the package {room!r}"), script.stderr
    command = subprocess.run(
        [sys.executable, "-m", "gyrobench", "runs", "list"], cwd=tmp_path, capture_output=True, text=True
    )
    assert command.returncode == 2
    assert command.stderr.startswith(f"error: {tmp_path / room} hides the package {room!r}")
    assert len(command.stderr.splitlines()) == 1


def test_a_dataclass_that_shows_itself_does_not_bring_a_repr_of_its_own() -> None:
    loud = []
    for path in (ROOT / "bench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and "Shown" in map(ast.unparse, node.bases):
                made = [
                    text for text in map(ast.unparse, node.decorator_list) if text.startswith("dataclass")
                ]
                loud += [f"{path.name}: {node.name}" for text in made if "repr=False" not in text]
    assert loud == []


def test_a_bench_file_shows_itself_in_a_line_and_as_html() -> None:
    bench = gyrobench.load_bench(ROOT / "examples" / "demo.toml")
    assert bench == load_bench_file(ROOT / "examples" / "demo.toml")
    assert repr(bench) == (
        "<BenchFile: bench demo bench, table acutrol3000, chamber weiss, fog_1, kvh1750 FOG-001, "
        "ellipse_1, sbg_ellipse ELL-001>"
    )
    assert "<td style='text-align:left'>weiss</td>" in bench._repr_html_()


@pytest.mark.slow
def test_a_rehearsal_from_python_is_read_back(tmp_path: Path) -> None:
    result = gyrobench.rehearse("known-state", ROOT / "examples" / "demo.toml", tmp_path, seed=3)
    run = gyrobench.open_run(result.folder)
    assert result.outcome == run.manifest.outcome == "completed"
    assert run.manifest.emulated is not None and run.manifest.emulated.seed == 3
    for shown in (run, run.manifest, result, gyrobench.find_procedure("known-state")):
        assert len(repr(shown)) < 400
    assert "<table>" in run.manifest._repr_html_()
    assert "procedure known-state, outcome completed" in repr(run)
    rate_dps = run.gyro("fog_1", ["rate_dps"])["rate_dps"]
    assert rate_dps.ndim == 1
    frame = run.to_pandas("fog_1", ["rate_dps"])
    np.testing.assert_array_equal(frame["rate_dps"].to_numpy(), rate_dps)
    assert run.to_arrow("chamber", ["air_temp_c"], 0, 5).num_rows == len(
        run.chamber(["air_temp_c"], 0, 5)["air_temp_c"]
    )
    with pytest.raises(gyrobench.RecordError, match="no table of 'fog_2'"):
        run.to_arrow("fog_2")
    plots = gyrobench.plot(run)
    assert repr(plots).startswith(f"<Plots: Run {run.manifest.run_id}, ") and " 0 plots" not in repr(plots)
    assert plots._repr_html_().startswith('<iframe srcdoc="')
    assert "<svg" in plots.save(tmp_path / "plots.html").read_text(encoding="utf-8")
    with pytest.raises(gyrobench.ConfigurationError, match="not a parameter"):
        gyrobench.rehearse("known-state", ROOT / "examples" / "demo.toml", tmp_path, air=20)


def test_a_look_is_plotted_without_its_tables(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{0.001 * ((7919 * k) % 101 - 50):.6f}" for k in range(2000)]
    (tmp_path / "log.csv").write_text("time_s,gyro_x_dps\n" + "\n".join(rows) + "\n")
    plots = gyrobench.plot(gyrobench.look(tmp_path / "log.csv"))
    assert "<svg" in plots.save(tmp_path / "look.html").read_text(encoding="utf-8")
    assert "<table" not in render_page(plots._page)


def test_what_fits_return_shows_itself_in_a_line() -> None:
    figure = Figure("bias", 1.23456789, "deg/h", "IEEE Std 952", 1.1, 1.3)
    assert repr(figure) == "<Figure: bias 1.23457 deg/h, 95 % 1.1 .. 1.3>"
    for kind in (Calibration, FittedCompensation, HeadingStudy, RlgStudy, StandardFigures, gyrobench.Study):
        assert issubclass(kind, Shown) and kind.__repr__ is Shown.__repr__, kind
    for kind in FittedCompensation.__subclasses__():
        assert kind.__repr__ is Shown.__repr__, kind
