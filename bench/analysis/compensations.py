"""One reader for every compensation file: the file says itself what it corrects.

A package of another maker adds a kind through the entry point group `gyrobench.compensations`: the entry's name
is the kind that its files say, its object a class derived from `FittedCompensation` (`bench.analysis.common`).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from bench.analysis.common.compensation import FittedCompensation
from bench.analysis.common.state_file import read_state
from drivers.base.errors import RecordError
from drivers.base.plugins import entry_points_of

ENTRY_POINT_GROUP = "gyrobench.compensations"
KINDS = {
    None: ("bench.analysis.thermal", "Compensation"),
    "imu-calibration": ("bench.analysis.calibration", "ImuCompensation"),
    "whirl": ("bench.analysis.whirl", "WhirlCompensation"),
    "gyrobench heading compensation": ("bench.analysis.heading", "HeadingCompensation"),
    "ring laser drift": ("bench.analysis.rlg", "RlgCompensation"),
}
"""Where each kind is; imported when met: a thermal model brings a learning library with it."""


def load_compensation(path: Path) -> FittedCompensation:
    """Read a compensation file of any kind; RecordError if it is none, damaged, or of a kind not known here."""
    kind = read_state(path).get("kind")
    if kind in KINDS:
        module, name = KINDS[kind]
        own: type[FittedCompensation] = getattr(import_module(module), name)
        return own.load(path)
    installed = entry_points_of(ENTRY_POINT_GROUP)
    for entry in installed.select(name=str(kind)):
        others: type[FittedCompensation] = entry.load()
        return others.load(path)
    known = ("thermal drift", *filter(None, KINDS), *sorted({entry.name for entry in installed}))
    raise RecordError(
        "this is no compensation file",
        where=str(path),
        found=f"kind {kind}",
        expected="one of " + ", ".join(known),
        remedy="use the file that `gyrobench fit` wrote, whole, or install the package that brings its kind",
    )
