"""Tables inside a page written by hand: between `<!-- name -->` and `<!-- /name -->`."""

from __future__ import annotations

import re
from pathlib import Path

from drivers.base.files import replace_file


def fill(page: Path, name: str, text: str) -> None:
    """Put `text` between the page's marks; ValueError if it has not exactly one pair of them."""
    pattern = rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)"
    found, count = re.subn(
        pattern, lambda m: m[1] + text + m[2], page.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    if count != 1:
        raise ValueError(f"{page}: no place for the table, expected one pair of {name} marks")
    replace_file(page, found)
