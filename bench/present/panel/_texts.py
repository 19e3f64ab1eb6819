"""The numbers of the page as texts with a fixed number of digits, so that nothing jumps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from bench.present.sentences import demands_words

DASH = "–"
_SMALL_DPS = 0.05
"""A gyro rate below this reads better in deg/h."""


def texts(now: Mapping[str, Any] | None, age_s: float) -> dict[str, str]:
    """Return the texts of a session by key; a number that is not known is a dash."""
    now = now or {}
    run, campaign = now.get("run") or {}, now.get("campaign") or {}
    chamber, table = now.get("chamber") or {}, now.get("table") or {}
    time_s, left_s = now.get("time_s"), now.get("left_s")
    ended = now.get("state") == "ended"
    words = {
        "title": str(campaign.get("title") or run.get("procedure") or "No session"),
        "run": str(run.get("run_id") or DASH),
        "procedure": str(run.get("procedure") or DASH),
        "units": ", ".join(f"{unit} ({name})" for name, unit in (run.get("units") or {}).items()) or DASH,
        "count": f"run {campaign['number']} of {campaign['count']}"
        if campaign.get("count")
        else "single run",
        "campaign_left": _campaign_left(campaign, left_s),
        "step": str(now.get("step") or DASH),
        "doing": str(now.get("doing") or DASH),
        "phase": str(now.get("phase") or "").replace("_", " ") or DASH,
        "elapsed": duration(time_s),
        "left": DASH if ended else duration(left_s),
        "speed": _speed(now.get("speed"), bool(run.get("emulated"))),
        "progress": f"{_share(time_s, left_s):.4f}",
        "age": "" if age_s < 2.0 or ended else f"last news {age_s:.0f} s ago",
        "last_read": "last read, not now" if ended or now.get("alive") is False else "",
        "air": number(chamber.get("air_temp_c"), 2),
        "set": number(chamber.get("set_point_c"), 2),
        "air_rate": number(chamber.get("rate_k_per_min"), 2, sign=True),
        "angle": number(table.get("angle_deg"), 4),
        "rate": number(table.get("rate_dps"), 4, sign=True),
        "demand": demands_words(table.get("demands") or {}) or DASH,
    }
    for name, value in (chamber.get("auxiliary_c") or {}).items():
        words[f"aux.{name}"] = number(value, 2)
    for name, gyro in (now.get("gyros") or {}).items():
        words |= {f"gyro.{name}.{key}": text for key, text in _gyro(gyro).items()}
        words[f"gyro.{name}.unit"] = str((run.get("units") or {}).get(name, ""))
    return words


def _gyro(gyro: Mapping[str, Any]) -> dict[str, str]:
    mean, latest = gyro.get("rate_dps"), gyro.get("latest_dps")
    small = isinstance(mean, int | float) and abs(mean) < _SMALL_DPS
    factor, digits = (3600.0, 3) if small else (1.0, 5)
    age_s = gyro.get("age_s")
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
        "silent": f"no data for {age_s:.0f} s" if isinstance(age_s, int | float) and age_s > 5.0 else "",
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
