"""What `import gyrobench` offers is what docs/api.md lists, with the signatures and members that were agreed."""

from __future__ import annotations

import gyrobench
from benchmarks.public_names import FILE, lines, listed


def test_names_are_those_of_the_page() -> None:
    assert sorted([*listed(), "__version__"]) == gyrobench.__all__ == dir(gyrobench)


def test_nothing_public_has_changed_unsaid() -> None:
    """Meant? `python -m benchmarks.public_names --write`, and a line in CHANGELOG.md."""
    assert lines() == FILE.read_text(encoding="utf-8").splitlines()
