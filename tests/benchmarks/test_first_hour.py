"""What README and pages tell a newcomer to type does what they say; what takes minutes is `make first-hour`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.first_hour import PAGES, Block, blocks, copied, place_of, typed

PROGRAMS = Path(sys.executable).parent


def test_every_page_has_blocks_and_what_does_not_do_as_said_is_noticed(tmp_path: Path) -> None:
    found = [block for page in PAGES for block in blocks(page)]
    assert {block.page for block in found} == set(PAGES)
    lines = [line for block in found for line in block.lines]
    assert {"make setup", "make demo", ". .venv/bin/activate"} < set(lines)
    assert not any(line.startswith(("Cold-shock", "unit unit")) for line in lines)
    assert "exit code 2" in typed(Block("here", "gyrobench rehearse nothing"), tmp_path, PROGRAMS)
    assert "lacks" in typed(Block("here", "gyrobench runs list"), tmp_path, PROGRAMS)  # there is none yet
    assert "exit code 1" in typed(Block("here", "import nothing_of_that_name"), tmp_path, PROGRAMS)


@pytest.mark.slow
def test_the_pages_do_what_they_say(tmp_path: Path) -> None:
    clone = copied(tmp_path)
    for block in (block for page in PAGES for block in blocks(page)):
        if not block.slow:
            assert not (wrong := typed(block, place_of(block.page, clone), PROGRAMS)), (
                f"{block.page}: {block.text}\n{wrong}"
            )
