"""Known vulnerabilities of the pinned dependencies: `python -m benchmarks.audit` (`make audit`), used by CI.

pip-audit asks the package index. An audit in which nothing was audited fails with an exit code of its own, 2: an
index that does not answer says nothing about a package. What of some packages could not be asked is said aloud. A
known vulnerability fails, with 1, unless `ACCEPTED` says why it cannot be reached.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
ACCEPTED: dict[str, str] = {}
"""Identifier of a vulnerability -> why no input of ours reaches it; looked at with every new pin."""
NOT_MADE = 2
_RED_LINE = "\033[31mAUDIT NOT MADE\033[0m"
_TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Verdict:
    """What the index said: packages it knew and did not, vulnerabilities as "package version identifier"."""

    asked: int
    unknown: int
    reachable: tuple[str, ...]
    accepted: tuple[str, ...]


def judge(report: dict[str, Any], accepted: dict[str, str]) -> Verdict:
    """Return the verdict on pip-audit's JSON report."""
    rows = report["dependencies"]
    known = [row for row in rows if "skip_reason" not in row]
    reachable: list[str] = []
    left: list[str] = []
    for row in known:
        for found in row["vulns"]:
            names = {found["id"], *found.get("aliases", ())}
            text = f"{row['name']} {row['version']} {found['id']}"
            (left if names & accepted.keys() else reachable).append(text)
    return Verdict(len(known), len(rows) - len(known), tuple(reachable), tuple(left))


def main() -> int:
    """Ask, say what came of it; 1 for a vulnerability known and not accepted, 2 if nothing was audited."""
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(ROOT / "constraints.txt")]
    command += ["--no-deps", "--disable-pip", "--format", "json", "--progress-spinner", "off"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S)
        verdict = judge(json.loads(done.stdout), ACCEPTED)
    except (subprocess.TimeoutExpired, ValueError, KeyError, TypeError) as error:
        print(f"{_RED_LINE}: the package index did not answer ({type(error).__name__}).", file=sys.stderr)
        return NOT_MADE
    if not verdict.asked:
        print(
            f"{_RED_LINE}: the package index says nothing about any of {verdict.unknown} pinned packages.",
            file=sys.stderr,
        )
        return NOT_MADE
    if verdict.unknown:
        print(
            f"AUDIT INCOMPLETE: of {verdict.asked + verdict.unknown} pinned packages the index could say nothing "
            f"about {verdict.unknown}.",
            file=sys.stderr,
        )
    print(f"{verdict.asked} packages audited, {len(verdict.reachable)} known vulnerabilities to act on.")
    for text in verdict.accepted:
        print(f"accepted: {text}")
    for text in verdict.reachable:
        print(f"VULNERABLE: {text}", file=sys.stderr)
    return 1 if verdict.reachable else 0


if __name__ == "__main__":
    sys.exit(main())
