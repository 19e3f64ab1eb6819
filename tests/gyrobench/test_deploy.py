"""What deploy/ has for a bench computer: pins with hashes, a systemd unit, an image."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
import typer.main
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from bench.present.cli._app import app

DEPLOY = Path(__file__).parents[2] / "deploy"
UNIT = DEPLOY / "gyrobench-panel.service"
EXTRAS = ("analysis", "exchange", "panel", "postgres", "scale", "bluesky")
needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None,
    reason="systemd-analyze is not installed: the unit is not checked",
)


def pins(file: Path) -> dict[str, str]:
    found = re.findall(
        r"^([\w.-]+)(?:\[[\w,]+\])?==([^\s;\\]+)", file.read_text(encoding="utf-8"), re.MULTILINE
    )
    return {canonicalize_name(name): version for name, version in found}


def needed(name: str, extras: tuple[str, ...], seen: set[tuple[str, tuple[str, ...]]]) -> set[str]:
    """Return what a distribution needs here, and what that needs, as far as it is installed."""
    if (name, extras) in seen:
        return set()
    seen.add((name, extras))
    found = set()
    try:
        lines = requires(name) or []
    except PackageNotFoundError:
        return set()
    for line in map(Requirement, lines):
        if line.marker is None or any(line.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            other = canonicalize_name(line.name)
            found |= {other} | needed(other, tuple(sorted(line.extras)), seen)
    return found


def test_every_pin_has_a_hash_and_is_that_of_the_constraints() -> None:
    file = DEPLOY / "requirements.txt"
    pinned, constraints = pins(file), pins(DEPLOY.parent / "constraints.txt")
    assert pinned == {name: constraints[name] for name in pinned}
    blocks = re.split(r"\n(?=\S)", file.read_text(encoding="utf-8").strip())
    assert all("--hash=sha256:" in block for block in blocks) and len(blocks) == len(pinned)
    assert needed("gyrobench", EXTRAS, set()) - {"gyrobench"} <= pinned.keys(), "make pins"
    assert "torch" not in pinned


def test_the_image_installs_the_pins_and_starts_the_command() -> None:
    text = (DEPLOY / "Containerfile").read_text(encoding="utf-8")
    assert "--require-hashes -r /build/requirements.txt" in text and "--no-deps /build/source" in text
    sources = [
        line.split()[1] for line in text.splitlines() if line.startswith("COPY ") and "--from" not in line
    ]
    assert all((DEPLOY.parent / source).exists() for source in sources)


def test_the_unit_starts_a_panel_with_options_that_there_are() -> None:
    (line,) = re.findall(r"^ExecStart=(.+)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)
    words = shlex.split(line)
    command = typer.main.get_command(app).get_command(None, words[1])  # type: ignore[attr-defined]
    known = {name for part in command.params for name in part.opts}
    assert words[1] == "panel" and {word for word in words if word.startswith("--")} <= known
    assert "\nKillMode=process\n" in UNIT.read_text(encoding="utf-8")  # runs outlive their panel


@needs_systemd
def test_systemd_accepts_the_unit_and_finds_it_hardened(tmp_path: Path) -> None:
    here = tmp_path / UNIT.name
    here.write_text(UNIT.read_text(encoding="utf-8").replace("/opt/gyrobench/bin/gyrobench", sys.executable))
    verified = subprocess.run(["systemd-analyze", "verify", here], capture_output=True, text=True)
    assert verified.returncode == 0 and not verified.stderr, verified.stderr
    # 10 is a service without any protection; 2.5 is what remains with a network and serial ports
    hardened = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--threshold=30", here],
        capture_output=True,
        text=True,
    )
    assert hardened.returncode == 0, hardened.stdout[-300:]
