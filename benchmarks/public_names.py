"""The public names of `gyrobench`, with signatures and members, as tests/contracts/public_api.txt has them.

python -m benchmarks.public_names --write      after a change that is meant, with a line in CHANGELOG.md
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import gyrobench

ROOT = Path(__file__).parents[1]
FILE = ROOT / "tests" / "contracts" / "public_api.txt"


def listed() -> list[str]:
    """Return the names that docs/api.md lists."""
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    return re.findall(r"^\* `(\w+)`:", page, re.MULTILINE)


def stated(public: object, name: str) -> list[str]:
    """Return a public name as lines: the signature of a function, the public members of a class."""
    if inspect.isfunction(public):
        return [name + str(inspect.signature(public)).replace("'", "")]
    assert inspect.isclass(public)
    lines = [f"class {name}({', '.join(base.__name__ for base in public.__bases__)})"]
    if public.__module__.startswith(("bench", "drivers", "gyrobench")):
        members: dict[str, object] = {}
        for base in reversed(public.__mro__):
            if base.__module__.startswith(("bench", "drivers", "gyrobench")):
                members |= dict.fromkeys(getattr(base, "__annotations__", {})) | dict(vars(base))
        for member, value in sorted(members.items()):
            if not member.startswith("_") and member not in ("model_config",):
                plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
                signature = str(inspect.signature(plain)) if inspect.isfunction(plain) else ""
                lines.append(f"  {member}{signature}".replace("'", ""))
    return lines


def lines() -> list[str]:
    """Return what is public now."""
    return [line for name in sorted(listed()) for line in stated(getattr(gyrobench, name), name)]


if __name__ == "__main__":
    if "--write" in sys.argv:
        FILE.write_text("\n".join(lines()) + "\n", encoding="utf-8")
    else:
        print(*lines(), sep="\n")
