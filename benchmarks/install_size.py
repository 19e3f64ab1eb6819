"""Size of an installation and time of its import, of gyrobench and of the packages in docs/beside_others.md.

    python -m benchmarks.install_size            builds an environment for each; needs a package index
    python -m benchmarks.install_size gyrobench  only this one

Megabytes are 10^6 bytes of all files but compiled Python; seconds are processor time, the best of three.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
UV = Path(sys.executable).with_name("uv")
PACKAGES = {
    "gyrobench": (str(ROOT), "gyrobench"),
    "gyrobench[analysis]": (f"{ROOT}[analysis]", "gyrobench"),
    "hardpy": ("hardpy==0.25.2", "hardpy"),
    "labgrid": ("labgrid==26.0", "labgrid"),
    "ophyd-async": ("ophyd-async==0.21.3", "ophyd_async.core"),
    "allantools": ("allantools==2024.6", "allantools"),
}
"""Name -> what is installed, what is imported."""


def measured(requirement: str, module: str) -> tuple[float, float]:
    """Return size (MB) and import time (s) of an installation with its dependencies."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    if "PIP_FIND_LINKS" in environment:
        environment.setdefault("UV_FIND_LINKS", environment["PIP_FIND_LINKS"])
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "venv"
        python = place / "bin" / "python"
        install = [UV, "pip", "install", "--quiet", "--python", python]
        if requirement.startswith(str(ROOT)):
            install += ["--constraint", ROOT / "constraints.txt"]
        made = [UV, "venv", "--quiet", "--python", sys.executable, place]
        for command in (made, [*install, requirement]):
            subprocess.run(list(map(str, command)), check=True, cwd=folder, env=environment)
        files = [file for file in (place / "lib").rglob("*") if file.suffix != ".pyc"]
        size_mb = sum(file.lstat().st_size for file in files) / 1e6
        code = f"import time; import {module}; print(time.process_time())"
        times = [
            float(subprocess.run([python, "-c", code], check=True, capture_output=True, cwd=folder).stdout)
            for _ in range(4)  # the first one compiles
        ]
    return size_mb, min(times)


def main() -> None:
    """Print a row for each package."""
    asked = sys.argv[1:] or list(PACKAGES)
    for name in asked:
        size_mb, import_s = measured(*PACKAGES[name])
        print(f"{name:20s} {size_mb:6.0f} MB  {import_s:5.2f} s", flush=True)


if __name__ == "__main__":
    main()
