"""Which column is what, in which unit: by names and by what the values can be; what cannot be known is said."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import STANDARD_GRAVITY_MPS2, ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError

TIME, GYRO, ACCELEROMETER, TEMPERATURE = "time", "gyro", "accelerometer", "temperature"
KINDS = (TIME, GYRO, ACCELEROMETER, TEMPERATURE)
BASE_UNITS = {GYRO: "deg/s", ACCELEROMETER: "m/s^2", TEMPERATURE: "degC", TIME: "s"}
_G = STANDARD_GRAVITY_MPS2
_FACTORS: dict[str, dict[str, float]] = {
    GYRO: {
        "deg/s": 1.0, "dps": 1.0, "°/s": 1.0, "mdps": 1e-3, "deg/h": 1 / 3600, "dph": 1 / 3600, "°/h": 1 / 3600,
        "rad/s": math.degrees(1.0), "mrad/s": math.degrees(1e-3), "rad/h": math.degrees(1.0) / 3600,
        "arcsec/s": 1 / 3600, "rpm": 6.0,
    },
    ACCELEROMETER: {"m/s^2": 1.0, "m/s2": 1.0, "m/s/s": 1.0, "g": _G, "mg": 1e-3 * _G, "ug": 1e-6 * _G},
    TEMPERATURE: {"degc": 1.0, "°c": 1.0, "c": 1.0, "k": 1.0, "degf": 5 / 9, "°f": 5 / 9, "mdegc": 1e-3},
    TIME: {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
}  # fmt: skip
_OFFSETS = {"k": -ZERO_CELSIUS_K, "degf": -160.0 / 9.0, "°f": -160.0 / 9.0}
_INCREMENTS: dict[str, dict[str, float]] = {
    GYRO: {"deg": 1.0, "rad": math.degrees(1.0), "arcsec": 1 / 3600, "urad": math.degrees(1e-6)},
    ACCELEROMETER: {"m/s": 1.0, "g*s": _G, "mg*s": 1e-3 * _G, "ug*s": 1e-6 * _G},
}
"""Units of increments, written with "/sample": they become rates with the sample rate."""
_NAMES = {
    TIME: re.compile(
        r"^(t|time\w*|ts|stamp|sec(onds)?|utc\w*|date\w*|\w*timestamps?\w*|t_?\(?m?u?n?s\)?)$|^time|^elapsed"
    ),
    TEMPERATURE: re.compile(r"temp|^t_?(in|out|gyro|imu|c)$|thermo"),
    ACCELEROMETER: re.compile(r"acc(?!ur)|^a_?[xyz]\b|^a_?[xyz]_|^f_?[xyz]$|specific|^a_?[xyz]$"),
    GYRO: re.compile(
        r"gyr|omega|ang\w*[_ .]?(vel|rate)|^w_?[xyz]$|^g_?[xyz]\b|^g_?[xyz]_|^[pqr]$|rate_?[xyz]?"
    ),
}
_NOT_A_RATE = re.compile(r"bias|status|valid|flag|std|cov|samples|_?count(er)?$|mag(n|_|$)")
_COUNTER = re.compile(r"sample|row|index|count|^n$|^i$|frame|seq|packet")
_IN_NAME = {
    "rad/s": r"rad_?(per_?|/)?s(ec)?\b|rads\b",
    "deg/s": r"dps\b|deg_?(per_?|/)?s(ec)?\b", "deg/h": r"dph\b|deg_?(per_?|/)?h\b",
    "m/s^2": r"m_?(per_?|/)?s\^?2|mps2|ms2\b", "mg": r"_mg\b", "g": r"_g\b",
    "degC": r"deg_?c\b|_c\b", "K": r"_k\b",
    "ns": r"_ns\b|nano", "us": r"_us\b|micro", "ms": r"_ms\b|milli", "s": r"_s\b|_sec",
}  # fmt: skip
_G_NEAR = 0.15
"""How far the norm of accelerometers at rest may be off gravity."""


@dataclass(frozen=True)
class Channel:
    """A column: `kind` gyro, accelerometer or temperature, `axis` x, y, z or "".

    `unit` is the log's own, "" where it is not known; values in `base_unit` are `factor` * value + `offset`.
    `per_sample`: increments, to be multiplied by the sample rate.
    """

    name: str
    kind: str
    axis: str
    unit: str = ""
    factor: float = 1.0
    offset: float = 0.0
    per_sample: bool = False

    @property
    def base_unit(self) -> str:
        """Unit of all figures; "log units" where the log does not say its own."""
        return BASE_UNITS[self.kind] if self.unit else "log units"


@dataclass(frozen=True)
class Columns:
    """What the columns are: channels, the time (None without), and what nobody knows and how to say it."""

    channels: tuple[Channel, ...]
    time: Channel | None
    ignored: tuple[str, ...]
    remarks: list[str] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)


def gyros_among(names: Iterable[str]) -> int:
    """Return how many names look like gyros."""
    return sum(_kind_of(name) == GYRO for name in names)


def assign(
    columns: Mapping[str, Array], units: Mapping[str, str], told: Sequence[str], told_units: Sequence[str]
) -> Columns:
    """Say what every column is.

    `told` are texts KIND=NAME,NAME (globs; "gyro", "accelerometer", "temperature", "time"), `told_units` texts
    NAME=UNIT with a factor before the unit where there is one ("gx=0.0305 deg/s"). ConfigurationError for a kind,
    name or unit that is not known.
    """
    stated = {name: unit for name, unit in units.items() if name in columns and _is_unit(unit)}
    for rule in told_units:
        pattern, _, unit = rule.partition("=")
        stated |= dict.fromkeys(_matching(columns, pattern), unit.strip())
    kinds: dict[str, str] = {}
    for rule in told:
        kind, _, patterns = rule.partition("=")
        if kind not in KINDS:
            raise ConfigurationError("no such kind of column", found=kind, expected=", ".join(KINDS))
        names = [name for pattern in patterns.split(",") for name in _matching(columns, pattern.strip())]
        kinds |= dict.fromkeys(names, kind)
    said = dict(kinds)
    remarks: list[str] = []
    kinds = {name: _kind_of(name) for name in columns} | kinds
    if not any(kind in (GYRO, ACCELEROMETER) for kind in kinds.values()):
        kinds |= _by_values(columns, remarks) | said
    questions: list[str] = []
    time = _time(columns, kinds, stated, questions)
    channels = []
    for kind in (GYRO, ACCELEROMETER, TEMPERATURE):
        names = [name for name in columns if kinds[name] == kind]
        axes = _axes(names)
        guess = _guessed_unit(kind, columns, names)
        for name, axis in zip(names, axes, strict=True):
            channels.append(_channel(name, kind, axis, stated.get(name) or _unit_in(name, kind), guess))
        unknown = [channel.name for channel in channels if channel.kind == kind and not channel.unit]
        if guess and any(channel.kind == kind and channel.name not in stated for channel in channels):
            how = "their norm is that of gravity" if kind == ACCELEROMETER else "by its values"
            remarks.append(f"{', '.join(names)} in {guess}: {how}")
        if unknown:
            known = ", ".join(_FACTORS[kind])
            questions.append(
                f"the unit of {', '.join(unknown)} is not in the log: say --unit "
                f"'{unknown[0]}={BASE_UNITS[kind]}' ({known}; for counts a factor, '0.03 {BASE_UNITS[kind]}')"
            )
    used = {channel.name for channel in channels} | ({time.name} if time else set())
    ignored = tuple(name for name in columns if name not in used)
    return Columns(tuple(channels), time, ignored, remarks, questions)


def _matching(columns: Mapping[str, Array], pattern: str) -> list[str]:
    names = [name for name in columns if name == pattern or fnmatchcase(name, pattern)]
    if not names:
        raise ConfigurationError("no such column", found=pattern, expected=", ".join(columns))
    return names


def _kind_of(name: str) -> str:
    lower = name.lower()
    last = re.split(r"[./]", lower)[-1]
    if _NOT_A_RATE.search(lower):
        return ""
    return next((kind for kind in (TIME, TEMPERATURE, ACCELEROMETER, GYRO)
                 if _NAMES[kind].search(lower) or _NAMES[kind].search(last)), "")  # fmt: skip


def _axes(names: Sequence[str]) -> list[str]:
    """Return the axis of every column of one kind: by its name, else x, y, z for three in a row."""
    axes = []
    for name in names:
        match = re.findall(r"(?:^|[^a-z])[a-z]?([xyz])(?![a-z])|([xyz])$|[a-z]([XYZ])", name.lower())
        axes.append("".join(match[-1]) if match else "")
    if not any(axes) and len(names) in (3, 6):
        return [*"xyz"] * (len(names) // 3)
    return axes


def _by_values(columns: Mapping[str, Array], remarks: list[str]) -> dict[str, str]:
    """Say what columns without telling names are: a time grows, three accelerometers have the norm of gravity."""
    kinds: dict[str, str] = {}
    names = list(columns)
    if _grows(columns[names[0]]):
        kinds[names.pop(0)] = TIME
    triples = [names[k : k + 3] for k in range(0, len(names) - 2, 3)] if len(names) in (3, 6, 7) else []
    heavy = [triple for triple in triples if _accelerometer_unit(columns, triple)]
    for triple in triples:
        kinds |= dict.fromkeys(triple, ACCELEROMETER if triple in heavy else GYRO)
    if triples and not (len(triples) == 2 and len(heavy) != 1):
        remarks.append(
            "what the columns are is told by their values: " + ", ".join(f"{n} {k}" for n, k in kinds.items())
        )
        return kinds
    kinds = {name: kind for name, kind in kinds.items() if kind == TIME} | dict.fromkeys(names, GYRO)
    remarks.append(
        "the names of the columns say nothing: all are looked at as gyros; say --column gyro=... otherwise"
    )
    return kinds


def _grows(values: Array) -> bool:
    step = np.diff(values[np.isfinite(values)][:100_000])
    return len(step) > 1 and bool((step > 0.0).mean() > 0.99)


def _guessed_unit(kind: str, columns: Mapping[str, Array], names: Sequence[str]) -> str:
    if kind == TEMPERATURE and names:
        middle = float(np.nanmedian(columns[names[0]]))
        return "degC" if -70.0 < middle < 150.0 else "K" if 200.0 < middle < 425.0 else ""
    return _accelerometer_unit(columns, names) if kind == ACCELEROMETER else ""


def _accelerometer_unit(columns: Mapping[str, Array], names: Sequence[str]) -> str:
    """Return the unit in which the usual norm of three columns is that of gravity, "" if none."""
    if len(names) != 3:
        return ""
    norm = float(np.nanmedian(np.sqrt(sum(columns[name][:1_000_000] ** 2 for name in names))))
    near = ((unit, _FACTORS[ACCELEROMETER][unit] * norm / _G) for unit in ("m/s^2", "g", "mg"))
    return next((unit for unit, ratio in near if abs(ratio - 1.0) < _G_NEAR), "")


def _time(
    columns: Mapping[str, Array], kinds: Mapping[str, str], stated: Mapping[str, str], questions: list[str]
) -> Channel | None:
    name = next((name for name in columns if kinds[name] == TIME and _grows(columns[name])), None)
    if name is None or (_COUNTER.search(name.lower()) and name not in stated):
        return None
    unit = stated.get(name) or _unit_in(name, TIME)
    step = float(np.nanmedian(np.diff(columns[name])))
    if not unit:
        fitting = [
            one for one in ("s", "ms", "us", "ns") if 0.2 <= 1.0 / (step * _FACTORS[TIME][one]) <= 20e3
        ]
        unit = fitting[0] if fitting else "s"
        if len(fitting) > 1 or not fitting:
            rates = ", ".join(
                f"{one}: {1.0 / (step * _FACTORS[TIME][one]):.4g} Hz" for one in fitting or ["s"]
            )
            questions.append(
                f"the unit of {name} is not in the log ({rates}); taken: {unit}; say --unit {name}=..."
            )
    return _channel(name, TIME, "", unit, "")


def _unit_in(name: str, kind: str) -> str:
    units = (unit for unit, pattern in _IN_NAME.items() if unit.lower() in _FACTORS[kind])
    return next((unit for unit in units if re.search(_IN_NAME[unit], name.lower())), "")


def _is_unit(unit: str) -> bool:
    return any(unit.lower().replace("²", "^2") in factors for factors in _FACTORS.values())


def _channel(name: str, kind: str, axis: str, unit: str, guess: str) -> Channel:
    unit = unit or guess
    match = re.fullmatch(r"([-+\d.eE]*)\s*(.*?)(/sample)?", unit.strip().removesuffix(".").replace("²", "^2"))
    assert match is not None
    scale, plain, increment = match.groups()
    units = _INCREMENTS[kind] if increment and kind in _INCREMENTS else _FACTORS[kind]
    if not unit:
        return Channel(name, kind, axis)
    try:
        factor = float(scale or 1.0) * units[plain.lower()]
    except (KeyError, ValueError) as error:
        raise ConfigurationError(
            "a column's unit is not known",
            where=name,
            found=unit,
            expected=", ".join([*_FACTORS[kind], *(f"{key}/sample" for key in _INCREMENTS.get(kind, ()))]),
            remedy=f"say --unit '{name}=UNIT', or --column KIND={name} if it is no {kind}",
        ) from error
    return Channel(name, kind, axis, unit, factor, _OFFSETS.get(plain.lower(), 0.0), bool(increment))
