"""Pages of results, a section a command: each rewrites its own and leaves the others."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.base.clock import utc_now
from drivers.base.files import replace_file

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Page:
    """A file of sections: what stands at its head, and which sections come first, in which order."""

    path: Path
    head: str
    order: tuple[str, ...] = ()


RELIABILITY = Page(
    _FOLDER / "reliability.md",
    "# Reliability\n\nEvery section is written by the command that it names, with what that command found.\n",
    (
        "Guards",
        "Mutants",
        "Kills",
        "Kills of commands",
        "Kills seen from the wire",
        "Failed calls",
        "Tampered folders",
        "Soak",
        "A week in one run",
        "Time to the safe state",
        "Fuzzed decoders",
        "Branch coverage",
        "Repeats",
    ),
)
RESULTS = Page(
    _FOLDER / "RESULTS.md",
    "# Results\n\nWritten by `make bench`, a section a benchmark; do not edit. The ratio: how many times better\n"
    "ours is. [README.md](README.md): what is compared; [NOTES.md](NOTES.md): remarks, accuracy campaigns.\n",
    ("Machine", "Guard"),
)


def _commit() -> str:
    """Return the commit that the modules were loaded from, and whether anything but the pages differs from it."""
    folder = _FOLDER.parent

    def git(*words: str) -> str:
        found = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
        return found.stdout.strip()

    commit = git("rev-parse", "--short", "HEAD") or "unknown"
    changed = git("status", "--porcelain", "--untracked-files=no", "--", "*.py", "*.toml", "*.dbc")
    return f"{commit} with changes" if changed else commit


COMMIT = _commit()
"""Asked for when the command begins: an hour later the working tree may be another."""


def stamp(command: str) -> str:
    """Return in a line by which command, when, from which commit and on what something was measured."""
    return (
        f"`{command}`, {utc_now()[:10]}, commit {COMMIT}, {os.cpu_count()} processors, "
        f"load {os.getloadavg()[0]:.1f}, Python {platform.python_version()}."
    )


def write_section(title: str, command: str, lines: Sequence[str], page: Page = RELIABILITY) -> str:
    """Put a section into the page in place of the one that was there; return its text."""
    text = page.path.read_text(encoding="utf-8") if page.path.exists() else ""
    sections = dict(_split(text))
    sections[title] = "\n".join([f"## {title}", "", stamp(command), "", *lines]).rstrip() + "\n"
    known = [name for name in page.order if name in sections]
    rest = sorted(set(sections) - set(known))
    replace_file(page.path, "\n".join([page.head, *(sections[name] for name in [*known, *rest])]))
    return sections[title]


def section(title: str, page: Page = RELIABILITY) -> str:
    """Return a section of the page as it is, empty if there is none."""
    text = page.path.read_text(encoding="utf-8") if page.path.exists() else ""
    return dict(_split(text)).get(title, "")


def _split(text: str) -> list[tuple[str, str]]:
    parts = text.split("\n## ")[1:]
    return [(part.partition("\n")[0].strip(), f"## {part.rstrip()}\n") for part in parts]
