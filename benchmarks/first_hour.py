"""The first hour, from the pages alone: every command and every line of Python of README.md, docs/guide.md and
docs/own_procedure.md is typed in a fresh copy of the checkout, in the pages' order, and must do what they say.

    python -m benchmarks.first_hour            from `make setup` on, in a copy that has no environment yet
    python -m benchmarks.first_hour --quick    with the environment that runs this, without what takes minutes

`gyrobench run` meets an emulated lab in virtual time: the ports that a user enters are the lab's.
It ends at the first block that does not do what its page says.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.base.clock import host_seconds

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "docs/guide.md", "docs/own_procedure.md")
_PROGRAMS = ("gyrobench", "make", "cp", ".", "import", "from")
_SLOW = ("make ", "demo-out", "gap exam", "gyrobench run ", "--bench lab.toml --set cold_c")
_SAID = {
    "gyrobench procedures zero-bias-cold-shock": ["soak_min", "degC"],
    "gyrobench rehearse zero-bias-cold-shock": ["completed", "time plan", "the run folder takes"],
    "gyrobench runs list": ["completed"],
    "make demo": ["chosen on the validation runs", "demo-out/compensation.gyrocomp"],
    "gyrobench gap diagnose": ["unit unit: explained", "relaxation", "of the reducible gap is gone"],
    "gyrobench run zero-bias-cold-shock": ["completed  runs/"],
    "gyrobench rehearse ./my_test.py": ["completed  runs/"],
    "gyrobench new procedure": ["my_test.py", "try it:"],
}
"""Command -> what its page says that it gives."""
_FILES = {
    "gyrobench rehearse zero-bias-cold-shock": "runs/*/report.html",
    "make demo": "demo-out/compensation.h",
    "gyrobench gap diagnose": "exam/gap.html",
}
_SERVED = """
gyrobench lab --virtual --bench {file} --write ports.toml > lab.log 2>&1 & lab=$!
until [ -s ports.toml ]; do kill -0 $lab; sleep 0.2; done
mv ports.toml {file}
yes yes | {line}
kill $lab; wait $lab || true
"""


@dataclass(frozen=True)
class Block:
    """An indented block of a page that is typed: shell, or Python."""

    page: str
    text: str

    @property
    def python(self) -> bool:
        """Whether it is Python."""
        return self.text.startswith(("import ", "from "))

    @property
    def slow(self) -> bool:
        """Whether it takes minutes."""
        return any(part in self.text for part in _SLOW)

    @property
    def lines(self) -> list[str]:
        """The commands, without their comments, continued lines joined; what they print is left out."""
        joined = re.sub(r"\\\n\s*", "", self.text)
        lines = [re.split(r"\s+#", line)[0] for line in joined.splitlines() if line]
        return lines if self.python else [line for line in lines if line.split()[0] in (*_PROGRAMS, "cd")]


def blocks(page: str) -> Iterator[Block]:
    """Yield the blocks of a page that are typed; what a command prints is an indented block, too, and is not."""
    text = re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.M | re.S)
    for found in re.finditer(r"(?:^    .*\n(?:\s*\n(?=    ))*)+", text, re.MULTILINE):
        body = re.sub(r"^    ", "", found[0], flags=re.MULTILINE).strip()
        if body.split()[0] in _PROGRAMS:
            yield Block(page, body)


def copied(folder: Path) -> Path:
    """Copy what git tracks to `folder`/gyrobench: what a clone has."""
    place = folder / "gyrobench"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)
    return place


def typed(block: Block, place: Path, programs: Path | None = None) -> str:
    """Type a block in `place`; return what is wrong with it, "" if nothing.

    `programs`: those of an environment that is ready; None: the one that `make setup` made beside.
    """
    environment = {
        key: value for key, value in os.environ.items() if key not in ("VIRTUAL_ENV", "PYTHONPATH")
    }
    environment |= {"COLUMNS": "160", "PYTHONSAFEPATH": "1"}
    if programs is not None:
        environment["PATH"] = f"{programs}{os.pathsep}{environment['PATH']}"
    if block.python:
        (place / "typed.py").write_text(block.text + "\n", encoding="utf-8")
        script = "python typed.py"
    else:
        script = "\n".join(_line(line) for line in block.lines)
    made = place.parent / "gyrobench" / ".venv" / "bin" / "activate"
    active = f". {made}\n" if made.exists() else ""
    ended = subprocess.run(
        ["bash", "-ec", active + script], cwd=place, env=environment, capture_output=True, text=True
    )
    said = " ".join((ended.stdout + ended.stderr).split())
    if ended.returncode:
        return f"exit code {ended.returncode}: {said[-1500:]}"
    for command, words in _SAID.items():
        if any(line.startswith(command) for line in block.lines):
            missing = [word for word in words if " ".join(word.split()) not in said]
            pattern = _FILES.get(command)
            if missing or (pattern and not any(place.glob(pattern))):
                return f"{command} lacks {missing or pattern}: {said[-1500:]}"
    return ""


def _line(line: str) -> str:
    """Return a line as it is typed; `gyrobench run` gets its answers, and an emulated lab behind the file."""
    if not line.startswith("gyrobench run "):
        return line
    file = re.search(r"--bench (\S+)", line)
    assert file is not None, line
    return _SERVED.format(file=file[1], line=line)


def main() -> int:
    """Type everything; return the exit code."""
    quick = "--quick" in sys.argv
    programs = Path(sys.executable).parent if quick else None
    with tempfile.TemporaryDirectory() as folder:
        clone, mine = copied(Path(folder)), Path(folder) / "mine"
        mine.mkdir()
        for block in (block for page in PAGES for block in blocks(page)):
            if quick and (block.slow or "activate" in block.text):
                continue
            began_s = host_seconds()
            wrong = typed(block, mine if "own_procedure" in block.page else clone, programs)
            took, word = f"{host_seconds() - began_s:6.1f} s", "FAILED" if wrong else "ok"
            print(f"{word:6s} {took}  {block.page}: {block.lines[0]}", flush=True)
            if wrong:
                print(block.text, wrong, sep="\n")
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
