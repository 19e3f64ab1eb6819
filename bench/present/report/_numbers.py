"""Numbers as a report prints them: sensible digits, real minus signs, a dash for what is not known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

DASH = "–"
_MINUS = "−"
_THIN = "\u202f"  # narrow no-break space, the SI's thousands separator (SI brochure, 5.4.4)
_UNITS = (
    ("_k_per_min", "K/min"),
    ("_dps", "°/s"),
    ("_dph", "°/h"),
    ("_deg", "°"),
    ("_ppm", "ppm"),
    ("_hz", "Hz"),
    ("_min", "min"),
    ("_c", "°C"),
    ("_s", "s"),
)
_SPELLED = {"deg/h": "°/h", "deg/s": "°/s", "deg": "°", "degC": "°C", "degC/min": "°C/min"}
_SPELLED |= {"deg/sqrt(h)": "°/√h", "deg/h/degC": "°/h/°C", "ppm/degC": "ppm/°C"}
_SPELLED |= {"deg/h/sqrt(h)": "°/h/√h", "deg/h/h": "°/h²"}


def known(value: float | None) -> bool:
    """Return whether there is a finite number to show."""
    return value is not None and math.isfinite(value)


def fixed(value: float | None, decimals: int) -> str:
    """Return `value` with that many decimals, thousands apart; a dash if None, NaN or infinite."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{abs(value):,.{decimals}f}".replace(",", _THIN)
    negative = value < 0 and float(f"{abs(value):.{decimals}f}") != 0.0
    return _MINUS + text if negative else text


def significant(value: float | None, digits: int = 3) -> str:
    """Return `value` to `digits` significant digits, never in exponent form below a million."""
    if value is None or not math.isfinite(value):
        return DASH
    if value != 0.0 and not 1e-6 <= abs(value) < 1e15:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(exponent)}".replace("-", _MINUS)
    return fixed(value, _decimals(value, digits))


def with_uncertainty(value: float | None, uncertainty: float | None) -> str:
    """Return a value and its standard uncertainty, both with the decimals of two digits of the latter."""
    if value is None or uncertainty is None or not known(value) or not known(uncertainty):
        return DASH
    decimals = min(_decimals(uncertainty, 2), 4) if uncertainty > 0.0 else 4
    return f"{fixed(value, decimals)} ± {fixed(uncertainty, decimals)}"


def column(values: Iterable[float | None], digits: int = 3, most: int = 4) -> tuple[str, ...]:
    """Return a column with common decimals: `digits` significant for its smallest value, at most `most`."""
    cells = tuple(values)
    sizes = [
        _decimals(value, digits) for value in cells if value is not None and math.isfinite(value) and value
    ]
    decimals = min(max(sizes, default=0), most)
    return tuple(fixed(value, decimals) for value in cells)


def duration(seconds: float | None) -> str:
    """Return a duration in h and min (s below two minutes)."""
    if seconds is None or not math.isfinite(seconds):
        return DASH
    if seconds < 120:
        return f"{fixed(seconds, 0)} s"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"


def moment(utc: str) -> str:
    """Return an ISO 8601 UTC time to the minute; anything else unchanged, a dash if empty."""
    head = utc[:16]
    is_iso = len(head) == 16 and head[10] == "T" and head[:4].isdigit()
    return f"{head[:10]} {head[11:]} UTC" if is_iso else utc or DASH


def mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the known values; None if there are none."""
    numbers = [value for value in values if value is not None and math.isfinite(value)]
    return sum(numbers) / len(numbers) if numbers else None


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: 'deg/h' becomes '°/h'."""
    return _SPELLED.get(unit, unit)


def plain_name(name: str) -> str:
    """Return a name with spaces for its underscores."""
    return name.replace("_", " ")


def with_unit(text: str, unit: str) -> str:
    """Return number and unit joined so that no line breaks between them; a dash stays alone."""
    if text == DASH or not unit:
        return text
    return text + unit if unit == "°" else f"{text}\u00a0{unit_text(unit)}"


def parameter(name: str, value: Any) -> tuple[str, str]:
    """Return (label, value with unit) of a parameter whose name ends in its unit (`ramp_k_per_min`)."""
    label, unit = next(
        ((name[: -len(end)], unit) for end, unit in _UNITS if name.endswith(end) and name != end), (name, "")
    )
    return label.replace("_", " "), with_unit(plain(value), unit)


def plain(value: Any) -> str:
    """Return any parameter value as text: numbers as they were given, lists joined, None as a dash."""
    if value is None:
        return DASH
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("-", _MINUS) if math.isfinite(value) else DASH
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(plain(item) for item in value)
    return str(value)


def _decimals(value: float, digits: int) -> int:
    if value == 0.0:
        return 0
    rounded = float(f"{abs(value):.{digits - 1}e}")
    return max(0, digits - 1 - math.floor(math.log10(rounded)))
