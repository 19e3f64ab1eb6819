"""Where a run is, at a glance: what every display shows, on the terminal, in the live files, in the panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.control.history import History
from bench.control.stream_stations import GyroStation

_RATE_WINDOW_S = 60.0
SILENT_S = 5.0


@dataclass(frozen=True)
class GyroProgress:
    """One gyro: mean rate of the last minute, the latest block's mean, deg/s; its own temperature, degC.

    `frames`, `lost` (by its counter) and `rejected` (by reason) since the stream began; `age_s` since its last
    block of data. `samples` and `sum_dps`: valid samples since the stream began and the sum of their rates.
    """

    rate_dps: float
    latest_dps: float
    temp_c: float
    frames: int = 0
    lost: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)
    age_s: float = float("nan")
    samples: int = 0
    sum_dps: float = 0.0

    @property
    def silent(self) -> bool:
        """Whether nothing has come for so long that its values are old."""
        return not self.age_s <= SILENT_S


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
    demands: Mapping[str, Mapping[str, Any] | None]
    """What was asked of each axis of the table last, as in its event; None: nothing yet, it is at rest."""
    gyros: Mapping[str, GyroProgress]
    air_age_s: float = 0.0
    table_age_s: float = 0.0
    """How old what chamber and table said last is, bench time."""
    poll_s: float = 1.0
    """How often they are asked."""
    standing_s: float = 0.0
    """Bench time so far that went by waiting for a human: questions and pauses."""
    readings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Of every supply, logger and other instrument: its newest readings by column."""
    paused: bool = False
    alarms: tuple[Mapping[str, Any], ...] = ()
    """The last 20 events that an operator has to see at once, as in events.jsonl."""
    log: tuple[Mapping[str, Any], ...] = ()
    """The last 20 events, as in events.jsonl."""

    def stale(self, age_s: float) -> bool:
        """Return whether a value of that age is old: two polls were missed, and a moment more."""
        return not age_s <= 2.0 * self.poll_s + 3.0

    def left_s(self, expected_s: float) -> float:
        """Return what is left of a run expected to take `expected_s`: waiting for a human is no progress."""
        return max(0.0, expected_s - (self.time_s - self.standing_s))


def air_rate_k_per_min(history: History, now_s: float) -> float:
    """Return how fast the chamber's air moved over the last minute; NaN before there is half of one."""
    rows = history.since(now_s - _RATE_WINDOW_S)
    time_s, air_c = rows["time_s"], rows["air_temp_c"]
    if len(time_s) < 2 or time_s[-1] - time_s[0] < 0.5 * _RATE_WINDOW_S:
        return float("nan")
    return float(60.0 * (air_c[-1] - air_c[0]) / (time_s[-1] - time_s[0]))


def gyro_progress(station: GyroStation, now_s: float) -> GyroProgress:
    """Return where a gyro is."""
    rate_dps = station.output_dps(now_s - _RATE_WINDOW_S)  # decodes what has come
    last, nan = station.history.last, float("nan")
    return GyroProgress(
        rate_dps=rate_dps,
        latest_dps=last.get("rate_dps", nan),
        temp_c=last.get("temp_c", nan),
        frames=station.frames,
        lost=station.lost,
        rejected=station.rejected,
        age_s=now_s - last.get("time_s", nan),
        samples=station.total_samples,
        sum_dps=station.total,
    )
