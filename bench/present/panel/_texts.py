"""The numbers of the page as texts with a fixed number of digits, so that nothing jumps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bench.present.sentences import demands_words, event_of, sentence
from bench.record.events.run import Note, Prompt
from bench.record.events.safe import SafeState

DASH = "–"
_NEWS_S = 2.0
_SAID_AT_REST = "read back when the bench was made safe"
_SMALL_DPS = 0.05
"""A gyro rate below this reads better in deg/h."""


def texts(
    now: Mapping[str, Any] | None, age_s: float, read_back: Mapping[str, SafeState] | None = None
) -> dict[str, str]:
    """Return the texts of a session by key; a number that is not known is a dash.

    `age_s`: how old its live state is. `read_back`: what a device said after that, when it was made safe.
    """
    now = now or {}
    going_on = now.get("state") != "ended" and now.get("alive") is not False
    run, campaign = now.get("run") or {}, now.get("campaign") or {}
    chamber, table = now.get("chamber") or {}, now.get("table") or {}
    time_s, left_s = now.get("time_s"), now.get("left_s")
    ended = now.get("state") == "ended"
    words = {
        "title": str(campaign.get("title") or run.get("procedure") or "Nothing goes on"),
        "bench": str(run.get("bench") or campaign.get("bench") or ""),
        "emulated": "EMULATED LAB: no real device moves"
        if run.get("emulated") or campaign.get("emulated")
        else "",
        "run": str(run.get("run_id") or DASH),
        "procedure": str(run.get("procedure") or DASH),
        "units": ", ".join(f"{unit} ({name})" for name, unit in (run.get("units") or {}).items()) or DASH,
        "count": f"run {campaign['number']} of {campaign['count']}"
        if campaign.get("count")
        else "single run"
        if run
        else "",
        "campaign_left": _campaign_left(campaign, left_s) if going_on else "",
        "step": str(now.get("step") or DASH),
        "doing": str(now.get("doing") or DASH),
        "phase": str(now.get("phase") or "").replace("_", " ") or DASH,
        "elapsed": duration(time_s),
        "left": _left(now, left_s, ended),
        "speed": _speed(now.get("speed"), bool(run.get("emulated"))),
        "progress": f"{_share(time_s, left_s):.4f}",
        "age": "" if age_s < 2.0 or ended else f"last news {age_s:.0f} s ago",
        "chamber.age": _age(chamber, age_s, going_on),
        "table.age": _age(table, age_s, going_on),
        **_last(now.get("log") or ()),
        "air": number(chamber.get("air_temp_c"), 2),
        "set": number(chamber.get("set_point_c"), 2),
        "air_rate": number(chamber.get("rate_k_per_min"), 2, sign=True),
        "angle": number(table.get("angle_deg"), 4),
        "rate": number(table.get("rate_dps"), 4, sign=True),
        "demand": demands_words(table.get("demands") or {}) or DASH,
    }
    for name, value in (chamber.get("auxiliary_c") or {}).items():
        words[f"aux.{name}"] = number(value, 2)
    for instrument, row in (now.get("readings") or {}).items():
        for column, value in row.items():
            words[f"reading.{instrument}.{column}"] = number(value, 2 if column.endswith("_c") else 3)
    for name, gyro in (now.get("gyros") or {}).items():
        words |= {f"gyro.{name}.{key}": text for key, text in _gyro(gyro).items()}
        words[f"gyro.{name}.age"] = _age(gyro, age_s, going_on)
        words[f"gyro.{name}.unit"] = str((run.get("units") or {}).get(name, ""))
    return words | _read_back(read_back or {})


def _last(log: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return what became of the last order: the newest event that is no question; a note says why not."""
    events = [event_of(row) for row in log]
    last = next((event for event in reversed(events) if not isinstance(event, Prompt)), None)
    return {
        "last": "" if last is None else sentence(last),
        "last_refused": "yes" if isinstance(last, Note) else "",
    }


def _read_back(states: Mapping[str, SafeState]) -> dict[str, str]:
    """Return what table and chamber said when the bench was made safe: newer than the last telemetry."""
    found = {}
    if (table := states.get("table")) is not None and table.rates_dps:
        rate_dps = max(table.rates_dps.values(), key=abs)
        found = {"rate": number(rate_dps, 4, sign=True), "demand": "at rest", "table.age": _SAID_AT_REST}
    if (chamber := states.get("chamber")) is not None and chamber.set_point_c is not None:
        found["set"] = number(chamber.set_point_c, 2)
    return found


def ago(seconds: float) -> str:
    """Return how long ago something was, in the unit that one says it in."""
    for length_s, unit in ((86_400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{max(seconds, 0.0):.0f} s"


def _age(device: Mapping[str, Any], age_s: float, going_on: bool) -> str:
    """Return how old the values of a device are; "last read" if no newer ones are coming."""
    own_s = device.get("age_s")
    if not device or (own_s is None and "stale" in device):
        return "nothing read yet"
    all_s = (own_s or 0.0) + (age_s if not going_on or age_s > _NEWS_S else 0.0)
    if device.get("stale") or not going_on or age_s > _NEWS_S:
        return f"last read {ago(all_s)} ago"
    return "now" if all_s < _NEWS_S else f"{ago(all_s)} ago"


def _left(now: Mapping[str, Any], left_s: object, ended: bool) -> str:
    if ended or now.get("alive") is False:
        return duration(0.0) if now.get("outcome") in ("completed", "invalid") else DASH
    late = left_s == 0.0 and now.get("state") == "running"
    return "takes longer than expected: 0:00:00" if late else duration(left_s)


def _gyro(gyro: Mapping[str, Any]) -> dict[str, str]:
    mean, latest = gyro.get("rate_dps"), gyro.get("latest_dps")
    small = isinstance(mean, int | float) and abs(mean) < _SMALL_DPS
    factor, digits = (3600.0, 3) if small else (1.0, 5)
    rejected = gyro.get("rejected") or {}
    return {
        "mean": number(mean, digits, factor, sign=True),
        "latest": number(latest, digits, factor, sign=True),
        "rate_unit": "°/h" if small else "°/s",
        "temp": number(gyro.get("temp_c"), 2),
        "frames": count(gyro.get("frames")),
        "lost": count(gyro.get("lost")),
        "rejected": count(sum(v for v in rejected.values() if isinstance(v, int))),
        "reasons": ", ".join(f"{v} {k}" for k, v in rejected.items() if v),
    }


def number(value: object, digits: int, factor: float = 1.0, *, sign: bool = False) -> str:
    """Return a number with that many decimals and a real minus, a dash if it is not known."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return DASH
    return f"{value * factor:{'+' if sign else ''}.{digits}f}".replace("-", "−")


def count(value: object) -> str:
    """Return a whole number in groups of three."""
    return f"{value:,}".replace(",", "\u2009") if isinstance(value, int) else DASH


def duration(seconds: object) -> str:
    """Return a duration as h:mm:ss."""
    if not isinstance(seconds, int | float) or not math.isfinite(seconds):
        return DASH
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def _speed(value: object, emulated: bool) -> str:
    fast = isinstance(value, int | float) and value >= 1.5
    if fast:
        return f"emulated, {value:,.0f} × real time"
    return "emulated" if emulated else ""


def _share(time_s: object, left_s: object) -> float:
    if not isinstance(time_s, int | float) or not isinstance(left_s, int | float) or time_s + left_s <= 0:
        return 0.0
    return min(1.0, time_s / (time_s + left_s))


def _campaign_left(campaign: Mapping[str, Any], run_left_s: object) -> str:
    """Return what is left of a campaign: of this run and of those after it."""
    after_s = campaign.get("left_s")
    if not isinstance(after_s, int | float):
        return ""
    return (
        f"campaign: {duration(after_s + (run_left_s if isinstance(run_left_s, int | float) else 0.0))} left"
    )
