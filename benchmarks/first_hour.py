"""The first hour, from the pages alone: every command and line of Python of README.md, docs/guide.md and the
tutorials is typed and must do what they say. The former are typed in a fresh copy of the checkout, every tutorial
in a folder of its own that has the examples. A TOML block that begins with a file's name is written to that file.

    python -m benchmarks.first_hour            from `make setup` on, in a copy that has no environment yet
    python -m benchmarks.first_hour --quick    with the environment that runs this, without what takes minutes
    python -m benchmarks.first_hour docs/own_procedure.md    `make setup`, then this page only; or several pages

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
CLONE = ("README.md", "docs/guide.md")
PAGES = (
    *CLONE,
    *("docs/tutorials/first_rehearsal.md", "docs/tutorials/bench_file.md", "docs/tutorials/own_gyro.md"),
    *("docs/own_procedure.md", "docs/tutorials/campaign_overnight.md", "docs/tutorials/gap.md"),
    "docs/tutorials/own_log.md",
)
_PROGRAMS = ("gyrobench", "make", "cp", "cat", ".", "import", "from")
_SLOW = (
    "make ",
    "demo-out",
    "gap exam",
    "gap diagnose",
    "gyrobench run ",
    "campaign rehearse",
    "campaign run",
)
_SAID = {
    "gyrobench procedures zero-bias-cold-shock": ["soak_min", "degC"],
    "gyrobench rehearse zero-bias-cold-shock": ["completed", "time plan", "the run folder takes"],
    "gyrobench runs list": ["completed"],
    "make demo": ["chosen on the validation runs", "demo-out/compensation.gyrocomp"],
    "gyrobench gap diagnose cases": ["unit unit: explained", "relaxation", "of the reducible gap is gone"],
    "gyrobench run zero-bias-cold-shock": ["completed  runs/"],
    "gyrobench rehearse ./my_test.py": ["completed runs/", "scale_factor_error", "inside"],
    "gyrobench report runs/* --limits": ["passed", "1 of 1"],
    "gyrobench new procedure": ["my_test.py", "try it:"],
    "gyrobench runs verify first": ["verified", "checksums", "tables rebuilt"],
    "gyrobench frames check my_gyro.toml": ["1 right"],
    "gyrobench look log.csv --write": ["out/log_x.toml", "out/log_x_nominal.toml"],
    "gyrobench gap diagnose out/log_x.toml": ["nothing to identify"],
    "gyrobench campaign rehearse night.toml": ["turn-2"],
    "gyrobench campaign status night": ["turn-2"],
}
"""Command -> what its page says that it gives."""
_FILES = {
    "gyrobench rehearse zero-bias-cold-shock": "runs/*/report.html",
    "make demo": "demo-out/compensation.h",
    "gyrobench gap diagnose cases": "exam/gap.html",
    "gyrobench report first": "first.html",
    "gyrobench campaign run": "night/certificate.html",
    "gyrobench report runs/*": "runs/certificate.html",
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
    def file(self) -> str:
        """Name of the file that it is the content of, "" for what is typed."""
        named = re.match(r"# (\S+\.toml)\n", self.text)
        return named[1] if named else ""

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
    text = (ROOT / page).read_text(encoding="utf-8")
    for found in re.finditer(
        r"^```(.*)\n((?:.*\n)*?)```$|(?:^    .*\n(?:\s*\n(?=    ))*)+", text, re.MULTILINE
    ):
        body = found[2] or re.sub(r"^    ", "", found[0], flags=re.MULTILINE).strip()
        if found[1] == "toml" or (found[1] is None and body.split()[0] in _PROGRAMS):
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
    if block.file:
        (place / block.file).write_text(block.text, encoding="utf-8")
        return ""
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
    if not line.startswith(("gyrobench run ", "gyrobench campaign run ")):
        return line
    file = re.search(r"--bench (\S+)", line)
    return _SERVED.format(file=file[1] if file else "lab.toml", line=line)


def place_of(page: str, clone: Path) -> Path:
    """Return the folder in which a page is typed: the clone, or one beside it with the examples."""
    if page in CLONE:
        return clone
    place = clone.parent / Path(page).stem
    if not place.exists():
        shutil.copytree(clone / "examples", place / "examples")
    return place


def main() -> int:
    """Type everything; return the exit code."""
    quick = "--quick" in sys.argv
    asked = [name for name in sys.argv[1:] if name.endswith(".md")]
    set_up = (
        []
        if quick or not asked
        else [next(block for block in blocks("README.md") if "make setup" in block.text)]
    )
    everything = [*set_up, *(block for page in asked or PAGES for block in blocks(page))]
    programs = Path(sys.executable).parent if quick else None
    start_s = host_seconds()
    with tempfile.TemporaryDirectory() as folder:
        clone = copied(Path(folder))
        for block in everything:
            if quick and (block.slow or "activate" in block.text):
                continue
            began_s, used_s = host_seconds(), _processor_s()
            wrong = typed(block, place_of(block.page, clone), programs)
            took = f"{host_seconds() - began_s:6.1f} s, {_processor_s() - used_s:6.1f} s of processor"
            word = "FAILED" if wrong else "ok"
            print(f"{word:6s} {took}  {block.page}: {block.file or block.lines[0]}", flush=True)
            if wrong:
                print(block.text, wrong, sep="\n")
                return 1
        print(f"all of it: {host_seconds() - start_s:.0f} s, {_processor_s():.0f} s of processor")
    return 0


def _processor_s() -> float:
    """Return the processor time, s, of all that was typed so far and has ended."""
    now = os.times()
    return now.children_user + now.children_system


if __name__ == "__main__":
    sys.exit(main())
