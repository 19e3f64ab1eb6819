"""One reader for every compensation file that gyrobench writes: the file says itself what it corrects."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

from bench.state_file import read_state
from drivers.errors import RecordError

if TYPE_CHECKING:
    from bench.calibration import ImuCompensation
    from bench.fitting import Compensation
    from bench.heading import LaggedModel
    from bench.rlg import RlgCompensation
    from bench.whirl import WhirlCompensation

    AnyCompensation = Compensation | ImuCompensation | LaggedModel | RlgCompensation | WhirlCompensation

KINDS = ("thermal drift", "calibration of an IMU", "whirl", "heading effect", "drift of a ring laser gyro")


def load_compensation(path: Path) -> AnyCompensation:
    """Read a compensation file of any kind; RecordError if it is none, damaged, or of a kind not known here.

    Returns for thermal drift `bench.fitting.Compensation`, for an IMU `bench.calibration.ImuCompensation`, for
    whirl `bench.whirl.WhirlCompensation`, for the heading effect `bench.heading.LaggedModel`, for the drift of a
    ring laser gyro `bench.rlg.RlgCompensation`.
    """
    if not zipfile.is_zipfile(path):
        return _from_text(path)
    kind = read_state(path).get("kind")
    # imported when met: a thermal model brings a learning library with it
    if kind is None:
        from bench.fitting import Compensation

        return Compensation.load(path)
    if kind == "imu-calibration":
        from bench.calibration import ImuCompensation

        return ImuCompensation.load(path)
    if kind == "whirl":
        from bench.whirl import WhirlCompensation

        return WhirlCompensation.load(path)
    if kind == "gyrobench heading compensation":
        from bench.heading import load_model

        return load_model(path)
    raise _unknown(path, f"kind {kind}")


def _from_text(path: Path) -> AnyCompensation:
    """Read the one kind that is plain JSON."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # bytes that are no text are one too
        raise _unknown(path, "a file that is neither a zip nor JSON") from error
    said = str(data.get("format", "")) if isinstance(data, dict) else ""
    if not said.startswith("gyrobench-rlg"):
        raise _unknown(path, f"JSON of format {said}" if said else "JSON that does not say what it is")
    from bench.rlg import RlgCompensation

    return RlgCompensation.load(path)


def _unknown(path: Path, found: str) -> RecordError:
    return RecordError(
        "this is no compensation file",
        where=str(path),
        found=found,
        expected="one of " + ", ".join(KINDS),
        remedy="use the file that `gyrobench fit` wrote, whole",
    )
