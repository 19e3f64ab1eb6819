"""Loading a module of other people's from a file, converted from Python 2 where it is that."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any


def load(name: str, path: Path) -> Any:
    """Return the module in a file; SystemExit where there is none."""
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise SystemExit(f"{path} is not there")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def to_python_3(path: Path) -> None:
    """Convert a file or a package in place."""
    convert = [sys.executable, "-W", "ignore", "-m", "lib2to3", "-w", "-n", str(path)]
    subprocess.run(convert, check=True, capture_output=True)
