"""A case on disk: logs and `runs.toml` as a lab would hand them over, the seal beside them."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from benchmarks.gap_exam._family import Family, Layout
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

SEALED_S = 0.2
"""Step of a sealed effect: what comes round in a second differs between means over 1 s and over a log's rows."""
_PER_DPH = {"deg/h": 1.0, "deg/s": 1.0 / 3600.0, "rad/s": math.radians(1.0) / 3600.0}
_PER_DEG = {"deg": 1.0, "rad": math.radians(1.0)}
_APART_H = 8
"""Hours from the begin of a run to that of the next, where logs have date-times."""
FOLDERS = ("cases", "sealed", "answers")


@dataclass(frozen=True)
class Seal:
    """The truth of a case.

    `effects` are (name, size as planned), `snr` a ratio for each that has one. `names`: what the catalogue
    calls each mechanism; `beside`: what is no false cause with it; both empty for a folder that does not say
    so. `parameters`: true values by effect and catalogue parameter. `changing`: effects that differ between
    repeats.
    """

    kind: str
    effects: tuple[tuple[str, float], ...]
    snr: Mapping[str, float]
    held_out: tuple[str, ...]
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    changing: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    """Keys `CODE|k` of runs of a profile that a diagnosis never sees."""


def read_seal(path: Path) -> Seal:
    """Return the truth that a file holds; keys that it lacks are empty."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    known = {name: data[name] for name in Seal.__dataclass_fields__ if name in data}
    known["effects"] = tuple((str(name), float(size)) for name, size in data.get("effects", ()))
    for name in ("held_out", "changing", "left_out"):
        known[name] = tuple(known.get(name, ()))
    for name in ("names", "beside"):
        known[name] = {key: tuple(values) for key, values in known.get(name, {}).items()}
    return Seal(**known)


def write_seal(folder: Path, name: str, seal: Seal, parts: Mapping[str, Array]) -> None:
    """Write sealed/NAME.json and .npz; `parts` has each effect in each run, means of SEALED_S, deg/h."""
    write_arrays(folder / f"{name}.npz", parts)
    (folder / f"{name}.json").write_text(json.dumps(asdict(seal)), encoding="utf-8")


def write_arrays(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays by name in single precision."""
    single: dict[str, Any] = {key: values.astype(np.float32) for key, values in arrays.items()}
    np.savez_compressed(path, **single)


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of a file by name."""
    with np.load(path) as file:
        return {key: np.asarray(file[key], np.float64) for key in file}


def sealed_step_s(gap: Array, covers_s: float) -> float:
    """Return the step of a sealed gap (m,) by the time that it covers: plants of others seal whole seconds."""
    step_s = covers_s / len(gap)
    return SEALED_S if step_s < 0.5 else max(1.0, round(step_s))


def gap_of(parts: Mapping[str, Array], effects: Sequence[str], key: str) -> Array:
    """Return what effects do together in the run of a key, deg/h."""
    return np.asarray(np.sum([parts[f"{effect}|{key}"] for effect in effects], axis=0))


def held_out_ids(case: Path) -> list[str]:
    """Return the ids of the runs of a case that judge."""
    return (case / "held_out.txt").read_text(encoding="utf-8").split("\n")[:-1]


def run_keys(case: Path) -> dict[str, str]:
    """Return the seal's key `CODE|k` of each run by its id: the run in file `CODE_{k+1}.suffix`."""
    mapping = tomllib.loads((case / "runs.toml").read_text(encoding="utf-8"))
    keys = {}
    for run in mapping["run"]:
        stem = Path(run["file"]).stem
        code, _, number = stem.rpartition("_")
        keys[run.get("run_id", stem)] = f"{code}|{int(number) - 1}"
    return keys


@dataclass(frozen=True, eq=False)
class Logged:
    """What a log of a run has: output (n,) in deg/h, temperatures (n,) in degC, the angle (n + 1,) in deg."""

    stage: Stage
    output_dph: Array
    t_in_c: Array
    t_out_c: Array
    angle_deg: Array


def write_case(folder: Path, family: Family, logs: Sequence[Logged]) -> None:
    """Write the recordings of a case, the mapping file and the ids of the runs held out."""
    folder.mkdir(parents=True, exist_ok=True)
    layout = family.layout
    lines = ["format = 1", 'unit_id = "U-1"', f"latitude_deg = {family.latitude_deg}", "", "[columns]"]
    lines += [
        _column("time", ("stamp" if layout.clock else "time_s", "s")),
        _column("output", layout.output),
        _column("angle", layout.angle),
    ]
    word = f"{layout.temperature_word_k} " if layout.temperature_word_k else ""
    lines += [_column(key, (key, word + layout.temperature)) for key in ("t_in", "t_out")]
    lines += [_column("elevation", ("elevation", layout.angle[1]))]
    for log in logs:
        stage = log.stage
        file = f"{stage.code}_{stage.repeat + 1}{layout.suffix}"
        _write_log(folder / file, layout, log)
        phases = ", ".join(
            f"{{ name = {json.dumps(name)}, start_s = {start!r} }}" for name, start in stage.phases
        )
        lines += ["", "[[run]]", f'file = "{file}"', f'run_id = "{stage.run_id}"']
        lines += [f'profile = "{stage.profile}"', f'condition = "{stage.condition}"']
        lines += [f"power_on_s = {stage.power_on_s!r}", f"phases = [{phases}]"]
    (folder / "runs.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    held_out = [log.stage.run_id for log in logs if log.stage.held_out]
    (folder / "held_out.txt").write_text("\n".join(held_out) + "\n", encoding="utf-8")


def _column(key: str, column: tuple[str, str]) -> str:
    return f'{key} = {{ name = "{column[0]}", unit = "{column[1]}" }}'


def _write_log(path: Path, layout: Layout, log: Logged) -> None:
    """Write a row at the end of every step that was kept; the first row stands at the start and has no output."""
    stage = log.stage
    kept = np.concatenate(([True], stage.kept))
    per_deg = _PER_DEG[layout.angle[1]]
    output = np.where(stage.valid, log.output_dph, np.nan) * _PER_DPH[layout.output[1]]
    middles = 0.5 * (stage.edges_s[1:] + stage.edges_s[:-1])
    tumbled = stage.elevation_deg[np.minimum((middles / stage.step_s).astype(np.int64), stage.steps - 1)]

    def first(values: Array, start: float | None = None) -> Array:
        return np.concatenate((values[:1] if start is None else [start], values))[kept]

    def thermometer(values_c: Array) -> NDArray[np.generic]:
        if layout.temperature_word_k:
            return np.round(first(values_c) / layout.temperature_word_k).astype(np.int16)
        return np.round(first(values_c) + (ZERO_CELSIUS_K if layout.temperature == "K" else 0.0), 4)

    time: dict[str, NDArray[np.generic]] = {"time_s": np.round(stage.edges_s, 6)[kept]}
    if layout.clock:
        begin = np.datetime64(layout.clock, "us") + np.timedelta64(_APART_H * stage.number, "h")
        time = {"stamp": begin + np.round(1e6 * stage.edges_s).astype("timedelta64[us]")[kept]}
    columns = {
        **time,
        layout.output[0]: first(output, np.nan),
        layout.angle[0]: (log.angle_deg * per_deg)[kept],
        "t_in": thermometer(log.t_in_c),
        "t_out": thermometer(log.t_out_c),
        "elevation": first(tumbled * per_deg),
    }
    table = pa.table(columns)
    if layout.suffix == ".csv":
        pyarrow.csv.write_csv(table, path)
    else:
        pyarrow.parquet.write_table(table, path)
