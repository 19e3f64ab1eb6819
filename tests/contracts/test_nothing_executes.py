"""Files are data: no source of ours runs text as code or loads pickles; the servers stay on this machine."""

import ast
import inspect
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from bench.lab._process import LabProcess
from bench.present.panel import PanelSettings
from drivers.base.errors import BenchError

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path for room in ("bench", "drivers", "simulators", "procedures") for path in (ROOT / room).rglob("*.py")
)
MODULES = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "marshal", "shelve", "yaml"}
CALLS = {
    "eval",
    "exec",
    "compile",
    "__import__",
    "os.system",
    "os.popen",
    "pd.eval",
    "pandas.eval",
    "joblib.load",
    "run_path",
    "runpy.run_path",
    "run_module",
    "runpy.run_module",
}
METHODS = {"read_pickle", "to_pickle"}
SERVERS = {"create_server", "start_server"}


@cache
def tree(path: Path) -> ast.AST:
    """Return a source file, parsed."""
    return ast.parse(path.read_text(encoding="utf-8"))


def wrong(tree: ast.AST) -> Iterator[str]:
    """Yield what could run the content of a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (f"imports {each.name}" for each in node.names if each.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom):
            if (node.module or "").split(".")[0] in MODULES:
                yield f"imports {node.module}"
            yield from (
                f"imports {node.module}.load" for each in node.names if f"{node.module}.{each.name}" in CALLS
            )
        elif isinstance(node, ast.Call):
            name, given = ast.unparse(node.func), {each.arg: each.value for each in node.keywords}
            if name in CALLS or name.split(".")[-1] in METHODS:
                yield name
            if name == "torch.load" and not _is(given.get("weights_only"), True):
                yield "torch.load without weights_only=True"
            if name in ("np.load", "numpy.load") and not _is(given.get("allow_pickle"), False):
                yield "np.load without allow_pickle=False"
            if "allow_pickle" in given and not _is(given["allow_pickle"], False):
                yield "allow_pickle"
            if "shell" in given and not _is(given["shell"], False):
                yield "a shell"
            if "autoescape" in given and _is(given["autoescape"], False) and name.endswith("Environment"):
                yield "autoescape off"


def _is(node: ast.AST | None, value: object) -> bool:
    return isinstance(node, ast.Constant) and node.value is value


def test_no_source_runs_a_files_content() -> None:
    found = [f"{path.relative_to(ROOT)}: {each}" for path in SOURCES for each in wrong(tree(path))]
    assert found == [
        "bench/analysis/export/_c_header.py: autoescape off",  # C is no HTML; its names are checked there
        "drivers/base/plugins.py: runpy.run_path",  # of a file that the command line names, never data
    ]


@pytest.mark.parametrize(
    "code",
    [
        "eval(text)",
        "import pickle",
        "from pickle import loads",
        "import torch\ntorch.load(path)",
        "torch.load(path, weights_only=False)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "np.save(path, x, allow_pickle=flag)",
        "subprocess.run(text, shell=True)",
        "pd.read_pickle(path)",
        "from joblib import load",
        "run_path(file)",
        "import yaml",
    ],
)
def test_the_check_finds(code: str) -> None:
    assert list(wrong(ast.parse(code)))


def test_the_panel_listens_on_this_machine_unless_told_otherwise() -> None:
    assert inspect.signature(PanelSettings).parameters["host"].default == "127.0.0.1"


def test_every_server_of_the_lab_listens_on_loopback() -> None:
    """Nothing in the lab can be told to listen elsewhere: the address is written in the call."""
    calls = [
        ast.unparse(node)
        for path in SOURCES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).split(".")[-1] in SERVERS
        and path.is_relative_to(ROOT / "simulators")
    ]
    assert calls and all("'127.0.0.1'" in call for call in calls), calls


def test_tokens_are_compared_in_constant_time() -> None:
    """`==` ends at the first letter that differs, and how soon it ends can be measured from outside."""
    compared = [
        f"{path.relative_to(ROOT)}: {ast.unparse(node)}"
        for path in SOURCES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Compare)
        and any(isinstance(each, ast.Eq | ast.NotEq | ast.In) for each in node.ops)
        and any("token" in ast.unparse(side).lower() for side in (node.left, *node.comparators))
    ]
    assert compared == []
    access = ast.parse((ROOT / "bench/present/panel/_access.py").read_text(encoding="utf-8"))
    equal = next(n for n in ast.walk(access) if isinstance(n, ast.FunctionDef) and n.name == "_equal")
    assert "hmac.compare_digest" in ast.unparse(equal)


def test_processes_of_ours_import_nothing_from_the_folder_they_are_started_in() -> None:
    """`python -m` puts the current folder first, where a stranger's `struct.py` may lie; `-P` keeps it out."""
    started = [
        [ast.unparse(each) for each in node.elts]
        for path in SOURCES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.List) and node.elts and ast.unparse(node.elts[0]) == "sys.executable"
    ]
    assert started and all(command[1] == "'-P'" for command in started), started


def test_a_module_in_the_current_folder_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("simulators", "struct", "numpy"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BenchError, match="the emulated lab ended"):
        LabProcess(b"{}")  # no configuration: it ends by itself
    assert not (tmp_path / "ran").exists()


def test_workers_of_a_command_run_no_module_of_the_current_folder(tmp_path: Path) -> None:
    """joblib starts its processes by `python -m`, too."""
    (tmp_path / "struct.py").write_text("open('ran', 'w').close()", encoding="utf-8")
    code = (
        "import bench.present.cli._app as command; from bench.analysis.common.fan_out import fan_out\n"
        "def work():\n"
        "    with fan_out(2) as fan: print(fan.map(abs, [-1, -2]))\n"
        "command.app = work; command.main()"
    )
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "[1, 2]\n", done.stderr
    assert not (tmp_path / "ran").exists()
