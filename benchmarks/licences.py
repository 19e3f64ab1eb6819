"""The licences of all pins: `python -m benchmarks.licences`; `--write` renews docs/licences.md.

What a package says of itself where it is installed: License-Expression, else its classifiers, else License. A
package that gyrobench or one of its extras needs at run time must not be under the GPL alone; what only tests,
documentation and benchmarks need may be, and is named. 1 if one is, or if a pin says nothing of its licence.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks._sections import stamp
from drivers.base.files import replace_file

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
NOT_FOR_RUNNING = ("test", "lint", "bench", "docs")
"""Extras of pyproject.toml that no bench computer needs."""
SAID_ELSEWHERE = {
    "axe-playwright-python": "MIT (its file LICENSE)",
    "fmpy": "BSD-2-Clause (its file LICENSE.txt)",
}
"""Packages whose metadata say nothing of it -> what the file says that comes with them."""
_HEAD = """# Licences

gyrobench is under Apache-2.0. What it needs comes from package indexes and is not part of it. Listed are the pins
of constraints.txt, what each says of its licence where it is installed, and whether a bench computer needs it
(with any extra but {}) or only tests, documentation and benchmarks do.
{}
"""


@dataclass(frozen=True)
class Pin:
    """A pinned package: what it says of its licence (empty: nothing; None: not installed), and who needs it."""

    name: str
    version: str
    licence: str | None
    runs: bool

    @property
    def forbidden(self) -> bool:
        """Whether a bench computer would need something that is under the GPL alone."""
        return self.runs and copyleft(self.licence or "")


def copyleft(licence: str) -> bool:
    """Whether a licence is the GPL or AGPL with no other to choose."""
    choices = [part.strip() for part in licence.upper().replace(" OR ", ";").split(";")]
    return all(
        ("GPL" in choice or "GENERAL PUBLIC" in choice) and "LGPL" not in choice and "LESSER" not in choice
        for choice in choices
    )


def licence_of(found: Distribution) -> str:
    """Return what a package says of its licence, empty if nothing."""
    facts = found.metadata
    classifiers = facts.get_all("Classifier") or []
    said = [text.rpartition(" :: ")[2] for text in classifiers if text.startswith("License ::")]
    lines = "\n".join(facts.get_all("License") or []).strip().splitlines()
    return "".join(facts.get_all("License-Expression") or []) or "; ".join(said) or "".join(lines[:1])[:60]


def pins() -> Iterator[Pin]:
    """Yield the pins of constraints.txt, in its order."""
    needed = _needed(_own())
    for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines():
        if "==" not in line or line.startswith("#"):
            continue
        name, _, version = line.partition("==")
        key = str(canonicalize_name(name.strip()))
        try:
            licence: str | None = licence_of(distribution(key)) or SAID_ELSEWHERE.get(key, "")
        except PackageNotFoundError:
            licence = None
        yield Pin(name.strip(), version.split(";")[0].strip(), licence, key in needed)


def _own() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    chosen = [line for name, lines in extras.items() if name not in NOT_FOR_RUNNING for line in lines]
    return [*project["dependencies"], *(line for line in chosen if not line.startswith("gyrobench"))]


def _needed(lines: Iterable[str]) -> set[str]:
    """Return the names of packages that these requirements lead to, on this machine."""
    found: set[tuple[str, str]] = set()
    waiting = [(Requirement(line), "") for line in lines]
    while waiting:
        requirement, extra = waiting.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        name = str(canonicalize_name(requirement.name))
        for wanted in ("", *requirement.extras):
            if (name, wanted) in found:
                continue
            found.add((name, wanted))
            try:
                more = distribution(name).requires or []
            except PackageNotFoundError:
                continue
            waiting += [(Requirement(line), wanted) for line in more]
    return {name for name, _ in found}


def main() -> int:
    """List them; 1 if a bench computer would need the GPL, or a pin says nothing."""
    known = list(pins())
    elsewhere = [pin.name for pin in known if copyleft(pin.licence or "") and not pin.runs and pin.licence]
    gpl = f"Under the GPL alone, and needed by those only: {', '.join(elsewhere) or 'none'}."
    head = _HEAD.format(", ".join(f"`{name}`" for name in NOT_FOR_RUNNING), gpl)
    rows = [
        f"| {pin.name} | {pin.version} | {'not installed' if pin.licence is None else pin.licence} "
        f"| {'bench computer' if pin.runs else 'tests, benchmarks'} |"
        for pin in known
    ]
    table = "\n".join(["| package | version | licence | needed by |", "|---|---|---|---|", *rows])
    text = f"{head}\n{stamp('python -m benchmarks.licences --write')}\n\n{table}\n"
    print(text)
    if "--write" in sys.argv[1:]:
        replace_file(PAGE, text)
    wrong = [
        f"{pin.name}: {pin.licence}, needed by a bench computer"
        for pin in known
        if pin.forbidden and pin.licence
    ]
    wrong += [f"{pin.name} says nothing of its licence" for pin in known if pin.licence == ""]
    for line in wrong:
        print(f"LICENCE: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
