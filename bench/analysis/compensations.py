"""One reader for every compensation file that gyrobench writes: the file says itself what it corrects."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bench.analysis.common.state_file import read_state
from drivers.base.errors import RecordError

if TYPE_CHECKING:
    from bench.analysis.calibration import ImuCompensation
    from bench.analysis.heading import LaggedModel
    from bench.analysis.rlg import RlgCompensation
    from bench.analysis.thermal import Compensation
    from bench.analysis.whirl import WhirlCompensation

    AnyCompensation = Compensation | ImuCompensation | LaggedModel | RlgCompensation | WhirlCompensation

KINDS = ("thermal drift", "calibration of an IMU", "whirl", "heading effect", "drift of a ring laser gyro")


def load_compensation(path: Path) -> AnyCompensation:
    """Read a compensation file of any kind; RecordError if it is none, damaged, or of a kind not known here.

    Returns, all of bench.analysis: for thermal drift `thermal.Compensation`, for an IMU
    `calibration.ImuCompensation`, for whirl `whirl.WhirlCompensation`, for the heading effect
    `heading.LaggedModel`, for the drift of a ring laser gyro `rlg.RlgCompensation`.
    """
    kind = read_state(path).get("kind")
    # imported when met: a thermal model brings a learning library with it
    if kind is None:
        from bench.analysis.thermal import Compensation

        return Compensation.load(path)
    if kind == "imu-calibration":
        from bench.analysis.calibration import ImuCompensation

        return ImuCompensation.load(path)
    if kind == "whirl":
        from bench.analysis.whirl import WhirlCompensation

        return WhirlCompensation.load(path)
    if kind == "gyrobench heading compensation":
        from bench.analysis.heading import load_model

        return load_model(path)
    if kind == "ring laser drift":
        from bench.analysis.rlg import RlgCompensation

        return RlgCompensation.load(path)
    raise RecordError(
        "this is no compensation file",
        where=str(path),
        found=f"kind {kind}",
        expected="one of " + ", ".join(KINDS),
        remedy="use the file that `gyrobench fit` wrote, whole",
    )
