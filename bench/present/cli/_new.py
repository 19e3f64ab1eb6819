"""`gyrobench new ...`: writes something of the user's own that runs at once, and says by which commands."""

from __future__ import annotations

import keyword
import re
import sys
from pathlib import Path
from string import Template
from typing import Annotated

from typer import Argument, Typer

from bench.present.cli._console import Terminal
from bench.present.cli._options import DEFAULT_BENCH, Json
from drivers.base.errors import ConfigurationError

app = Typer(name="new", no_args_is_help=True)

_TEMPLATES = Path(__file__).with_name("templates")
_OURS = ("bench", "drivers", "gyrobench", "procedures", "simulators")
Name = Annotated[str, Argument(help="letters, digits, - and _; a letter first")]


@app.command()
def procedure(name: Name, as_json: Json = False) -> None:
    """Write NAME.py, a procedure that measures a scale factor."""
    module, dashed = _names(name)
    console = Terminal(as_json=as_json)
    files = _write(console, {Path(f"{module}.py"): "procedure.py"}, name=module, dashed=dashed)
    bench = [] if DEFAULT_BENCH.exists() else [f"gyrobench new bench {DEFAULT_BENCH.stem}"]
    _say_next(
        console, files, *bench, f"gyrobench procedures ./{module}.py", f"gyrobench rehearse ./{module}.py"
    )


@app.command()
def bench(name: Name, as_json: Json = False) -> None:
    """Write NAME.toml, a bench of table, chamber and one gyro."""
    console = Terminal(as_json=as_json)
    files = _write(console, {Path(f"{name}.toml"): "bench.toml"}, name=_names(name) and name)
    _say_next(console, files, f"gyrobench rehearse constant-rotation --bench {name}.toml --turns 10")


@app.command()
def campaign(name: Name, as_json: Json = False) -> None:
    """Write NAME.toml, a campaign of three short runs."""
    console = Terminal(as_json=as_json)
    files = _write(console, {Path(f"{name}.toml"): "campaign.toml"}, name=_names(name) and name)
    needed = [] if DEFAULT_BENCH.exists() else [f"gyrobench new bench {DEFAULT_BENCH.stem}"]
    _say_next(
        console,
        files,
        *needed,
        f"gyrobench campaign plan {name}.toml --quick",
        f"gyrobench campaign rehearse {name}.toml --out {name}-rehearsed",
    )


@app.command()
def driver(name: Name, as_json: Json = False) -> None:
    """Write the package NAME, the driver of a gyro.

    The gyro sends binary frames. Its emulator and a bench that has it come along.
    """
    module, dashed = _names(name)
    renamed = {"module.py": f"{module}.py", "module_emulator.py": f"{module}_emulator.py"}
    console = Terminal(as_json=as_json)
    files = _write(console, _package(name, "driver", renamed), name=module, dashed=dashed)
    _say_next(
        console,
        files,
        f"pip install ./{name}",
        f"gyrobench rehearse constant-rotation --turns 6 --bench {name}/bench.toml",
    )


@app.command()
def effect(name: Name, as_json: Json = False) -> None:
    """Write the package NAME, an effect for the gap diagnosis.

    An emulated unit that has the effect and a model that lacks it come along.
    """
    module, dashed = _names(name)
    console = Terminal(as_json=as_json)
    files = _write(
        console, _package(name, "effect", {"module.py": f"{module}.py"}), name=module, dashed=dashed
    )
    turning = (
        f"constant-rotation --rate-dps 20 --turns 40 --bench {name}/bench.toml --plant {name}/plant.toml"
    )
    _say_next(
        console,
        files,
        f"pip install ./{name}",
        f"gyrobench rehearse {turning} --runs {name}/runs",
        f"gyrobench gap diagnose {name}/runs/* --model {name}/nominal.toml",
    )


def _names(name: str) -> tuple[str, str]:
    """Return a name as a Python module and as a command writes it; ConfigurationError if it cannot be one."""
    module = name.replace("-", "_")
    if not re.fullmatch(r"[A-Za-z]\w{0,47}", module, re.ASCII) or keyword.iskeyword(module):
        raise ConfigurationError(
            "a name that cannot be used",
            found=repr(name),
            expected="a letter, then letters, digits, - and _, 48 at most, and no word of the Python language",
        )
    for whose, taken in (("Python", sys.stdlib_module_names), ("gyrobench", _OURS)):
        if module in taken:
            raise ConfigurationError(
                f"a name that hides a module of {whose}", found=repr(name), expected="another name"
            )
    return module, module.replace("_", "-").lower()


def _package(name: str, kind: str, renamed: dict[str, str]) -> dict[Path, str]:
    """Return the files of a package in a folder -> their templates."""
    files = (path.name.removesuffix(".txt") for path in sorted((_TEMPLATES / kind).iterdir()))
    return {Path(name) / renamed.get(file, file): f"{kind}/{file}" for file in files}


def _write(console: Terminal, files: dict[Path, str], **words: str) -> list[Path]:
    """Write files from templates, none of them over one that is there; return them."""
    folders = {path.parent for path in files} - {Path()}
    taken = next((place for place in (*folders, *files) if place.exists()), None)
    if taken is not None:
        raise ConfigurationError(
            "it is there already", where=str(taken), expected="a name that is not taken in this folder"
        )
    for path, template in files.items():
        text = (_TEMPLATES / f"{template}.txt").read_text(encoding="utf-8")
        path.parent.mkdir(exist_ok=True)
        path.write_text(Template(text).substitute(words), encoding="utf-8")
        console.say(f"{path}")
    return list(files)


def _say_next(console: Terminal, files: list[Path], *commands: str) -> None:
    console.say("try it:")
    console.say_all((f"    {command}" for command in commands), soft_wrap=True)
    console.say_json("result", files=files, next=commands)
