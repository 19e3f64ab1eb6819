"""Cells of a log's column as numbers: words that are none, date-times and times of day as seconds."""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drivers.base.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

_CHECKSUM = r"\*[0-9A-Fa-f]{2}$"
"""As NMEA 0183 puts it behind the last number of a line."""
_ZONE = re.compile(r"(z|utc|gmt|[+-]\d\d:?\d\d)\s*$", re.I)
_STAMPS = 19700101000000.0, 21010101000000.0
"""Numbers that are date-times, YYYYMMDDhhmmss, if all fields are ones of a date."""


class Cells(NamedTuple):
    """Numbers (n,), NaN where a cell is none, None for a column of text; a cell that is no number.

    `dated`: the numbers are s of date-times, since 1970, or of times of day; `local`: date-times without a zone.
    `remark`: what was guessed.
    """

    numbers: Array | None
    word: str = ""
    dated: bool = False
    local: bool = False
    remark: str = ""


def cells_of(values: pd.Series, decimal: str, missing: Collection[str] = ()) -> Cells:
    """Return a column's cells as numbers; those with one of the words `missing` are empty."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(values):
        return _of_numbers(np.asarray(values.to_numpy(np.float64, na_value=np.nan)), "")
    if pd.api.types.is_timedelta64_dtype(values):
        return Cells(_seconds(pd.Timestamp(0) + values), dated=True)
    if pd.api.types.is_datetime64_any_dtype(values):
        return Cells(_seconds(values), dated=True, local=getattr(values.dt, "tz", None) is None)
    text = values.astype("string").str.strip().str.replace(_CHECKSUM, "", regex=True)
    text = text.mask(text.isin(list(missing)))
    numbers = pd.to_numeric(text.str.replace(",", ".") if decimal == "," else text, errors="coerce")
    known = text.notna().to_numpy(np.bool_)
    odd = known & ~np.isfinite(numbers.to_numpy(np.float64, na_value=np.nan))
    odd &= ~text.str.lower().isin(["nan", "inf", "-inf"]).to_numpy(np.bool_)
    word = f"{text.iloc[int(np.argmax(odd))]!r} in row {int(np.argmax(odd)) + 1}" if odd.any() else ""
    if not known.any() or odd.sum() < 0.5 * known.sum():
        return _of_numbers(np.asarray(numbers.to_numpy(np.float64, na_value=np.nan)), word)
    times, local, remark = _times(text)
    if times.notna().sum() < 0.5 * known.sum():
        return Cells(None, word)
    return Cells(_seconds(times), "", True, local, remark)


def _of_numbers(values: Array, word: str) -> Cells:
    """Return numbers, or the date-times that they are if each of them is one written in a row of digits."""
    known = np.isfinite(values)
    inside = values[known]
    if not len(inside) or not _STAMPS[0] <= inside.min() <= inside.max() < _STAMPS[1]:
        return Cells(values, word)
    whole = np.floor(inside).astype(np.int64)
    fields = [whole // 10 ** (2 * place) % 100 for place in range(5)]
    second, minute, hour, day, month = fields
    if not ((second < 60) & (minute < 60) & (hour < 24) & (day >= 1) & (month >= 1) & (month <= 12)).all():
        return Cells(values, word)
    months = (whole // 10**10 - 1970) * 12 + month - 1
    first = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    if not (
        day <= (months + 1).astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) - first
    ).all():
        return Cells(values, word)
    result = np.full(len(values), np.nan)
    result[known] = 86_400.0 * (first + day - 1) + 3600.0 * hour + 60.0 * minute + second + (inside - whole)
    return Cells(result, word, True, True)


def _seconds(times: pd.Series) -> Array:
    plain = times.dt.tz_localize(None) if getattr(times.dt, "tz", None) is not None else times
    counts = plain.to_numpy("datetime64[ns]").astype(np.int64)
    return np.where(plain.isna().to_numpy(), np.nan, counts * 1e-9)


def _times(text: pd.Series) -> tuple[pd.Series, bool, str]:
    """Return times of day or date-times, whether these have no zone, and what was guessed.

    Day and month are in the order that misses fewest and spans least; of equal ones the day is first, with AM or
    PM the month.
    """
    import pandas as pd

    text = text.str.replace(
        r"(\d\d:\d\d:\d\d)[:_,](\d{1,6})$", r"\1.\2", regex=True
    )  # ms behind another mark
    first = str(text.dropna().iloc[0])
    if re.match(r"\d{1,2}:\d\d", first):
        return pd.Timestamp(0) + pd.to_timedelta(text, errors="coerce"), False, ""
    if not re.match(r"\d", first) or re.fullmatch(r"\d+[.,]\d*", first):  # pandas takes 70,8 for a year
        return pd.Series(pd.NaT, index=text.index, dtype="datetime64[ns]"), False, ""
    local = not _ZONE.search(first)
    year_first = re.match(r"\d{4}", first) is not None
    day_first = not re.search(r"[ap]m\s*$", first, re.I)
    ways: list[dict[str, Any]] = [{"dayfirst": day_first}, {"dayfirst": not day_first}]
    if year_first:
        ways.insert(0, {"format": "ISO8601"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pandas remarks on the orders that do not fit
        tried = [pd.to_datetime(text, errors="coerce", utc=True, **way) for way in ways]
    fits = [(found.isna().sum(), found.max() - found.min()) for found in tried]
    best = tried[fits.index(min(fits))]
    remark = ""
    if not year_first and fits[0] == fits[1] and not tried[0].equals(tried[1]) and "." not in first[:3]:
        order = "day before month" if day_first else "month before day"
        remark = (
            f"dates are taken as {order}, which they do not show: {first} is {best.dropna().iloc[0]:%Y-%m-%d}"
        )
    return best, local, remark
