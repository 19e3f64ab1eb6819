"""Which column is what, in which unit: by names and by what the values can be; what cannot be known is said."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np

from bench.record.exchange import BASE_UNITS, Scale, scale_of, unit_error
from drivers.base.arrays import Array
from drivers.base.constants import STANDARD_GRAVITY_MPS2
from drivers.base.errors import ConfigurationError

TIME, GYRO, ACCELEROMETER, TEMPERATURE = "time", "gyro", "accelerometer", "temperature"
NOBODY_KNOWS = "gyro?"
QUANTITIES = {TIME: "time", GYRO: "rate", ACCELEROMETER: "specific force", TEMPERATURE: "temperature"}
_INERTIAL = ("rate", "specific force")
_NAMES = {
    TIME: r"^(t|ts|stamp|[mun]?s|sec(onds)?|utc\w*|date\w*|t_?\(?m?u?n?s\)?)$|timestamp|(^|[ _])zeit|^tiempo|"
    r"^time|^elapsed|(^|[ _])i?tow$|(^|[ _.a-z])time([ _]?[mun]?s)?$",
    TEMPERATURE: r"temp(?!l|or)|^t_?(in|out|gyro|imu|c)$|thermo",
    ACCELEROMETER: r"acc(?!ur)|^[af]_?[xyz](?![a-z])|specific|^(delta|d)[_ ]?v(el\w*)?(?![a-z])",
    GYRO: r"gyr|omega|ang\w*[_ .]?(vel|rate)|^[wg]_?[xyz](?![a-z])|^[pqr]$|"
    r"(^|[_ .]|yaw|roll|pitch)rate(_?[xyz]|_?(lsb|raw|counts)|$)|(yaw|roll|pitch)[_ ]?rate|drehrate|"
    r"^(delta|d)[_ ]?(ang\w*|theta)",
}
"""In this order: a temperature of a gyro is a temperature."""
_OTHERWISE = re.compile(
    r"bias|status|valid|^est_|estimate|flag|std|cov|samples|_?count(er)?$|mag(n|_|$)|demand|command|set_?point|target|"
    r"(table|sampl\w*|frame|data|baud|heart|turntable)[_ ]?(rate|ang)|norm(?!al)|abs|magnitude|total|resultant|"
    r"(^|[_ ])dt$|^az[_ ]?(deg|rad)|azim|integral|interval|clip|relative|packet|_id$"
)
"""Columns that are none of these in spite of their names or units."""
_NAMELESS = re.compile(r"[a-z]?|.*\d")
"""Names that may say nothing: none, a letter, and what ends in a number, as columns of a matrix do."""
_TELLING = re.compile(
    r"vel|pos|dcm|quat|euler|element|lat|lon|alt|speed|ang|std|cov|mag|press|volt|curr|(^|[_. ])q\d"
)
"""Words of other things that they may have."""
_OTHER_LOG = re.compile(
    r"mag(n|_|$)|compass|gps|gnss|location|position|attitude|orient|quat|euler|rotation|baro|pressure"
)
"""Logs of something else, by their name."""
_WITHOUT_GRAVITY = re.compile(r"lin(ear)?[_ ]?acc|gravity|user|free[_ ]?acc")
"""A phone's accelerations of these names are a filter's, where it has an accelerometer beside them."""
_COUNTER = re.compile(r"sample|row|index|count|^n$|^i$|frame|seq|packet")
_IN_NAME = {
    "mrad/s": r"mrad_?(per_?|/)?s(ec)?|mradps|mrads", "mdps": r"mdps|mdeg_?(per_?|/)?s(ec)?",
    "rad/s": r"(?<![nuk])(rad_?(per_?|/)?s(ec)?|radps|rads)",
    "deg/s": r"(?<![nuk])(dps|deg_?(per_?|/)?s(ec)?)",
    "deg/h": r"dph|deg_?(per_?|/)?h", "m/s^2": r"m_?(per_?|/)?s\^?2|mps2|ms2", "mg": "_mg", "g": "_gs?",
    "degC": "deg_?c|_c", "K": "_k",
    "ns": "_ns|^ns|nano(s\\w*)?", "us": "_us|^us|timeus|micro(s\\w*)?", "ms": "_ms|^ms|timems|milli(s\\w*)?",
    "s": "_s|^s|_sec(onds)?",
}  # fmt: skip
_AXIS = re.compile(r"(?:^|[^a-z])[a-z]?([xyz])(?![a-z])|([xyz])$|(?:gyro?|acc|rate|omega)_?([xyz])")
_AXIS_WORDS = {"roll": "x", "pitch": "y", "yaw": "z", "p": "x", "q": "y", "r": "z"}
_AS_IT_IS = Scale(1.0)
_G_NEAR = 0.15
"""How far the norm of accelerometers at rest may be off gravity."""
_UNIT_VECTOR = 1e-6
"""Part of their norm by which directions differ in length; what is measured differs by more."""
_PACE, _PACE_ROWS = 0.02, 4.0
"""Part, and rows in all, by which times of one log may differ in pace: clocks differ by far less."""
_SLOWEST_HZ, _FASTEST_HZ = 0.2, 20e3
_EPOCH_S = (0.9e9, 4.1e9)
"""Seconds since 1970 from 1998 to 2099."""


@dataclass(frozen=True)
class Channel:
    """A column: `kind` gyro, accelerometer or temperature, `axis` x, y, z or "".

    `unit` is the log's own, "" where it is not known; `scale` makes `base_unit` of its values.
    """

    name: str
    kind: str
    axis: str
    unit: str = ""
    scale: Scale = _AS_IT_IS

    @property
    def base_unit(self) -> str:
        """Unit of all figures; "log units" where the log does not say its own."""
        return BASE_UNITS[QUANTITIES[self.kind]] if self.unit else "log units"


@dataclass(frozen=True)
class Columns:
    """What the columns are: channels, the time (None without), and what nobody knows and how to say it.

    `guessed`: nothing tells what the columns are; all that vary are taken for gyros.
    """

    channels: tuple[Channel, ...]
    time: Channel | None
    ignored: tuple[str, ...]
    remarks: list[str] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)
    guessed: bool = False


def is_gyro(name: str) -> bool:
    """Return whether a column's name is that of a gyro."""
    return _kind_of(name) == GYRO


def assign(
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    told: Sequence[str],
    told_units: Sequence[str],
    rate_hz: float | None,
    log_name: str = "",
) -> Columns:
    """Say what every column is: by its name, its unit, the log's name ("Gyroscope"), or else by its values.

    `told` are texts KIND=NAME,NAME (globs; "gyro", "accelerometer", "temperature", "time"), `told_units` texts
    NAME=UNIT (see `scale_of`: "gx=0.0305 deg/s"), `units` what the file says, `rate_hz` what is known of the
    sample rate. ConfigurationError for a kind, name or unit that is not known.
    """
    said: dict[str, str] = {}
    for kind, _, patterns in (rule.partition("=") for rule in told):
        if kind not in QUANTITIES:
            raise ConfigurationError("no such kind of column", found=kind, expected=", ".join(QUANTITIES))
        for pattern in patterns.split(","):
            said |= dict.fromkeys(_matching(columns, pattern.strip()), kind)
    said_units: dict[str, str] = {}
    for pattern, _, unit in (rule.partition("=") for rule in told_units):
        said_units |= dict.fromkeys(_matching(columns, pattern), unit.strip())
    remarks: list[str] = []
    questions: list[str] = []
    kinds = _kinds(columns, units, log_name) | said
    foreign = [
        name for name, unit in units.items() if not any(scale_of(q, unit) for q in ("time", *_INERTIAL))
    ]
    if not {GYRO, ACCELEROMETER, TEMPERATURE} & set(kinds.values()) and not set(foreign) & set(columns):
        kinds |= _by_values(columns, log_name.lower(), remarks) | said
    guessed_gyros = NOBODY_KNOWS in kinds.values()
    kinds = {name: GYRO if kind == NOBODY_KNOWS else kind for name, kind in kinds.items()}
    known = {name: _known(name, kinds[name], units, said_units, remarks) for name in columns}
    time = _time(columns, kinds, known, TIME in said.values(), rate_hz, questions)
    channels: list[Channel] = []
    for kind in (GYRO, ACCELEROMETER, TEMPERATURE):
        names = [name for name in columns if kinds[name] == kind]
        guess = _guessed_unit(kind, columns, names)
        guessed = [name for name in names if guess and not known[name]]
        if guessed:
            how = "their norm is that of gravity" if kind == ACCELEROMETER else "by its values"
            remarks.append(f"{', '.join(guessed)} in {guess}: {how}")
        channels += [
            _channel(name, kind, axis, known[name] or guess)
            for name, axis in zip(names, _axes(names), strict=True)
        ]
        if unknown := [name for name in names if not known[name] and not guess]:
            base = BASE_UNITS[QUANTITIES[kind]]
            questions.append(
                f"the unit of {', '.join(unknown)} is not in the log: say --unit '{unknown[0]}={base}' "
                f"(for counts a factor, '0.03 {base}')"
            )
    used = {channel.name for channel in channels} | ({time.name} if time else set())
    return Columns(
        tuple(channels), time, tuple(name for name in columns if name not in used), remarks, questions,
        guessed_gyros,
    )  # fmt: skip


def _kinds(columns: Mapping[str, Array], units: Mapping[str, str], log_name: str) -> dict[str, str]:
    """Return what each column is by its name, else by its unit, else, of x, y, z, by the log's name."""
    kinds = {name: _kind_of(name) or _kind_by_unit(name, units.get(name, "")) for name in columns}
    azimuths = {
        name
        for name, kind in kinds.items()
        if kind == ACCELEROMETER and scale_of("angle", units.get(name, "") or "none")
    }
    kinds |= dict.fromkeys(azimuths, "")
    times = {
        name
        for name, kind in kinds.items()
        if kind == TEMPERATURE and scale_of("time", units.get(name, "") or "none")
    }
    kinds |= dict.fromkeys(times, TIME)  # "temps [ms]" is French
    letters = {re.split(r"[./]", name.lower())[-1] for name in columns}
    if not letters >= {*"pqr"}:  # one alone is anything
        kinds |= {name: "" for name in columns if re.split(r"[./]", name.lower())[-1] in ("p", "q", "r")}
    if not {GYRO, ACCELEROMETER} & set(kinds.values()) and (kind := _kind_of(log_name)) in (
        GYRO,
        ACCELEROMETER,
    ):
        kinds |= dict.fromkeys([name for name in columns if name.lower() in ("x", "y", "z")], kind)
    filtered = {name for name, kind in kinds.items()
                if kind == ACCELEROMETER and _WITHOUT_GRAVITY.search(name.lower())}  # fmt: skip
    if filtered < {name for name, kind in kinds.items() if kind == ACCELEROMETER}:
        kinds |= dict.fromkeys(filtered, "")
    return kinds


def _kind_by_unit(name: str, unit: str) -> str:
    """Return what a column of another name is by a unit that only one kind has: "w_RS_S_x [rad s^-1]"."""
    if (
        not unit
        or _OTHERWISE.search(name.lower())
        or scale_of("specific force", unit) == scale_of("specific force", "g")
    ):
        return ""
    kinds = (GYRO, ACCELEROMETER, TEMPERATURE)
    return next((kind for kind in kinds if scale_of(QUANTITIES[kind], unit)), "")


def _matching(columns: Mapping[str, Array], pattern: str) -> list[str]:
    names = [name for name in columns if name == pattern or fnmatchcase(name, pattern)]
    if not names:
        raise ConfigurationError("no such column", found=pattern, expected=", ".join(columns))
    return names


def _kind_of(name: str) -> str:
    lower = name.lower()
    last = re.split(r"[./]", lower)[-1]
    if _OTHERWISE.search(lower):
        return ""
    return next(
        (kind for kind, names in _NAMES.items() if re.search(names, lower) or re.search(names, last)), ""
    )


def _axes(names: Sequence[str]) -> list[str]:
    """Return the axis of every column of one kind: by its name, else x, y, z for three in a row."""
    axes = []
    for name in names:
        found = ["".join(groups) for groups in _AXIS.findall(name.lower())]
        found += [letter.lower() for letter in re.findall(r"[a-z]([XYZ])(?![a-z])", name)]
        word = re.match(r"(roll|pitch|yaw|[pqr]$)", name.lower())
        axes.append(found[-1] if found else _AXIS_WORDS[word.group()] if word else "")
    return [*"xyz"] * (len(names) // 3) if not any(axes) and len(names) in (3, 6) else axes


def _by_values(columns: Mapping[str, Array], log_name: str, remarks: list[str]) -> dict[str, str]:
    """Say what columns without telling names are: a time grows, three accelerometers have the norm of gravity.

    The log's name says what three columns beside a time are, or that they are none of these. A column with a name
    of its own that says something else is nothing here.
    """
    kinds: dict[str, str] = {}
    names = [
        name for name in columns if _NAMELESS.fullmatch(name.lower()) and not _TELLING.search(name.lower())
    ]
    if 2 * len(names) < len(columns):
        return kinds
    log_kind = "other" if _OTHER_LOG.search(log_name) else _kind_of(log_name)
    if log_kind == "other":
        return kinds
    if _grows(columns[names[0]]):
        kinds[names.pop(0)] = TIME
    if log_kind == TEMPERATURE:
        return kinds | dict.fromkeys(names, TEMPERATURE)
    few = len(names) in (3, 6, 7)
    triples = [names[k : k + 3] for k in range(0, len(names) - 2, 3)][: None if few else 2]
    if not few and len(names) < 9:  # of many columns gyros and accelerometers are the first
        triples = []
    if len(triples) == 1 and log_kind in (GYRO, ACCELEROMETER):
        heavy = triples if log_kind == ACCELEROMETER else []
    else:
        heavy = [triple for triple in triples if _accelerometer_unit(columns, triple, all_the_time=True)]
    other = GYRO if len(heavy) == 1 or (len(triples) == 1 and log_kind == GYRO) else ""
    if triples and (other or (few and heavy == triples)):
        for triple in triples:
            kinds |= dict.fromkeys(triple, ACCELEROMETER if triple in heavy else other)
        told = ", ".join(f"{name} {kind}" for name, kind in kinds.items())
        more = "" if few else f"; the {len(names) - 6} behind them are not looked at"
        remarks.append(f"what the columns are is told by their values or the log's name: {told}{more}")
        return kinds
    names = [name for name in names if np.ptp(columns[name]) > 0.0 and not _grows(columns[name])] or names
    remarks.append(
        f"the names of the columns say nothing: {', '.join(names)} are looked at as gyros, the whole log "
        "as rest; say --column gyro=... otherwise"
    )
    return kinds | dict.fromkeys(names, NOBODY_KNOWS)


def _known(
    name: str, kind: str, units: Mapping[str, str], said: Mapping[str, str], remarks: list[str]
) -> str:
    """Return the unit of a column that was told, that the file says or that its name has; "" without."""
    if not kind:
        return ""
    quantity = QUANTITIES[kind]
    if name in said:
        if scale_of(quantity, said[name]) is None:
            remedy = f"say --unit '{name}=UNIT', or --column KIND={name} if it is no {kind}"
            raise unit_error(quantity, said[name], name, remedy)
        return said[name]
    if stated := units.get(name, ""):
        if scale_of(quantity, stated) is not None:
            return stated
        remarks.append(f"{name}: what the log has for a unit, {stated}, is none for {kind}s")
        return ""
    ends = r"(?:{})(?![a-z0-9^])"
    named = (unit for unit in _IN_NAME if scale_of(quantity, unit) is not None)
    plain = re.sub(r"[ \[]+", "_", name.lower())
    return next((unit for unit in named if re.search(ends.format(_IN_NAME[unit]), plain)), "")


def _guessed_unit(kind: str, columns: Mapping[str, Array], names: Sequence[str]) -> str:
    if kind == TEMPERATURE and names:
        middle = float(np.nanmedian(columns[names[0]]))
        return "degC" if -70.0 < middle < 150.0 else "K" if 200.0 < middle < 425.0 else ""
    return _accelerometer_unit(columns, names) if kind == ACCELEROMETER else ""


def _accelerometer_unit(
    columns: Mapping[str, Array], names: Sequence[str], *, all_the_time: bool = False
) -> str:
    """Return the unit in which the usual norm of three columns is that of gravity, "" if none.

    `all_the_time`: half of the norms around the median are, too; rates have such a norm by chance only.
    """
    if len(names) != 3:
        return ""
    norms = np.sqrt(sum(columns[name][:1_000_000] ** 2 for name in names))
    low, norm, high = np.nanquantile(norms, [0.25, 0.5, 0.75]).tolist()
    if np.nanmax(norms) - np.nanmin(norms) < _UNIT_VECTOR * norm:
        return ""  # a direction, not a measurement
    near = (low, norm, high) if all_the_time else (norm,)
    units = (("m/s^2", STANDARD_GRAVITY_MPS2), ("g", 1.0), ("mg", 1e3))
    return next((unit for unit, size in units if all(abs(n / size - 1.0) < _G_NEAR for n in near)), "")


def _grows(values: Array, *, named: bool = False) -> bool:
    """Return whether a column is a time; one `named` so may have coarse stamps, several rows the same."""
    step = np.diff(values[np.isfinite(values)][:100_000])
    forward = step >= 0.0 if named else step > 0.0
    return len(step) > 1 and bool(forward.mean() > 0.99 and step.sum() > 0.0)


def _time(
    columns: Mapping[str, Array],
    kinds: Mapping[str, str],
    known: Mapping[str, str],
    told: bool,
    rate_hz: float | None,
    questions: list[str],
) -> Channel | None:
    """Return the time column; without a unit where several are possible."""
    times = [name for name in columns if kinds[name] == TIME and _grows(columns[name], named=True)]
    if not told:
        times = [name for name in times if known[name] or not _COUNTER.search(name.lower())]
    if not times:
        return None
    name = times[0]
    paces = {one: _length(columns[one]) / max(_length(columns[name]), 1e-300) for one in times}
    slack = max(_PACE, _PACE_ROWS / len(columns[name]))
    if other := next((one for one in times if not _same_pace(paces[one], slack)), ""):
        questions.append(
            f"{name} and {other} are times of different pace: sensors sampled apart; say --column time=..."
        )
    if known[name]:
        return _channel(name, TIME, "", known[name])
    step, start = float(np.nanmedian(np.diff(columns[name]))), float(columns[name][0])
    step = step or _length(columns[name]) / (len(columns[name]) - 1)
    rates = {unit: 1.0 / (step * _factor(unit)) for unit in ("s", "ms", "us", "ns")}
    fitting = [
        unit for unit, rate in rates.items()
        if (abs(rate / rate_hz - 1.0) < 0.05 if rate_hz else _SLOWEST_HZ <= rate <= _FASTEST_HZ)
    ]  # fmt: skip
    since_1970 = [unit for unit in fitting if _EPOCH_S[0] < start * _factor(unit) < _EPOCH_S[1]]
    fitting = since_1970 or fitting
    if len(fitting) != 1:
        likely = ", ".join(f"{unit}: {rates[unit]:.4g} Hz" for unit in fitting or rates)
        questions.append(f"the unit of {name} is not in the log ({likely}): say --unit {name}=...")
    return _channel(name, TIME, "", fitting[0] if len(fitting) == 1 else "")


def _length(times: Array) -> float:
    known = times[np.isfinite(times)]
    return float(known[-1] - known[0])


def _same_pace(ratio: float, slack: float) -> bool:
    """Return whether two times are of one pace but for their units."""
    return any(abs(ratio / unit - 1.0) < slack for unit in (1.0, 1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9))


def _factor(unit: str) -> float:
    scale = scale_of("time", unit)
    return scale.factor if scale else np.nan


def _channel(name: str, kind: str, axis: str, unit: str) -> Channel:
    return Channel(name, kind, axis, unit, scale_of(QUANTITIES[kind], unit) or Scale(1.0))
