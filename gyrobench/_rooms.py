"""Names a folder of the user's that hides one of the packages that gyrobench consists of."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

ROOMS = ("bench", "drivers", "procedures", "simulators")
_HOME = Path(__file__).resolve().parents[1]


def check_rooms() -> None:
    """Raise ImportError, in one sentence, if Python would take one of our packages from somewhere else."""
    for room in ROOMS:
        loaded = sys.modules.get(room)
        spec = find_spec(room) if loaded is None else loaded.__spec__
        if spec is None:
            raise ImportError(
                f"gyrobench is installed without its package {room!r}: install it again (pip install gyrobench)"
            )
        folders = spec.submodule_search_locations or ()
        place = Path(spec.origin or next(iter(folders))).resolve()
        if place.name == "__init__.py":
            place = place.parent
        if place.parent != _HOME:
            raise ImportError(
                f"{place} hides the package {room!r} that gyrobench consists of: rename it, or start Python "
                "where it is not in the module search path"
            )
