"""Ring-laser gyro with two temperature sensors on a serial port: our own reference frame.

No maker's protocol: the smallest frame that carries what a temperature test of a ring laser needs. Its bytes are
the frame description `rlg2t`; here are the driver's name in a bench file and the bench's name of its one axis.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

from numpy.typing import NDArray

from drivers.frames import Frames, FramesConfig, kind_as_described
from drivers.kit.config import GyroConfig
from drivers.kit.kinds import Columns, Probe


class RlgConfig(GyroConfig):
    """`[[gyro]]` of a ring-laser gyro that sends `rlg2t`."""

    @property
    def technology(self) -> Literal["fog", "rlg", "mems"]:
        """A ring laser."""
        return "rlg"

    @property
    def described(self) -> FramesConfig:
        """The configuration of a described gyro that sends the same."""
        same = {"description": "rlg2t", "frame_format": None, "axes": "x", "axis": "x"}
        return FramesConfig(**{**vars(self), **same})


def _rates(config: RlgConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    return {config.axis: Frames.rates(config.described, columns, sample_rate_hz)["x"]}


_AS_DESCRIBED = kind_as_described(
    RlgConfig,
    lambda config: config.described,
    lambda config, connection: Frames.open(config.described, connection),
    probes=lambda: [Probe(20, keys={"axis": "x"})],
)
Rlg2t = replace(_AS_DESCRIBED, rates=_rates, accelerations=None)
