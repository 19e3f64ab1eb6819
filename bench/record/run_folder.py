"""How a run folder is recognised and where runs may lie; loads nothing, so that a list of runs is quick."""

from __future__ import annotations

import re
from pathlib import Path

MANIFEST_FILE = "manifest.json"
PROCEDURE_FILE = "procedure.py"
"""Source of the procedure, if it was a file of the user\'s own."""

PICTURES_FOLDER = "pictures"
"""Pictures of the questions that were asked, named by their content."""

_URL = re.compile(r"^([a-z][a-z0-9+.-]+):/{1,2}(?=[^/])", re.IGNORECASE)


def is_run(place: Path | str) -> bool:
    """Return whether `place` may be a run: it has a manifest, or is a URL."""
    return bool(url_of(place)) or (Path(place) / MANIFEST_FILE).is_file()


def url_of(place: Path | str) -> str:
    """Return the URL if `place` is one, also after a Path took one of its slashes; empty for a local path."""
    found = _URL.match(str(place))
    return f"{found[1].lower()}://{str(place)[found.end() :].rstrip('/')}" if found else ""
