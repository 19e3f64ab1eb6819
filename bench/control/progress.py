"""Where a run is, at a glance: what every display shows, on the terminal, in the live files, in the panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class GyroProgress:
    """One gyro: mean rate of the last minute, the latest block's mean, deg/s; its own temperature, degC.

    `frames`, `lost` (by its counter) and `rejected` (by reason) since the stream began; `age_s` since its last
    block of data.
    """

    rate_dps: float
    latest_dps: float
    temp_c: float
    frames: int = 0
    lost: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)
    age_s: float = float("nan")

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


@dataclass(frozen=True)
class Progress:
    """What a display shows. `air_rate_k_per_min`: over the last minute, NaN before that."""

    time_s: float
    step: str
    doing: str
    phase: str
    air_temp_c: float
    set_point_c: float
    air_rate_k_per_min: float
    auxiliary_c: Mapping[str, float]
    angle_deg: float
    rate_dps: float
    demand: str
    gyros: Mapping[str, GyroProgress]
    paused: bool = False
    alarms: tuple[Mapping[str, Any], ...] = ()
    """The last 20 alarms: time_s, device, text."""
    log: tuple[Mapping[str, Any], ...] = ()
    """The last 20 events, as in events.jsonl."""
