"""An exam's case on disk: Parquet recordings with a mapping file, as anybody's recordings would come."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from bench.analysis.gap._data import GapRun

MAPPING_FILE = "runs.toml"
_COLUMNS = {
    "time": ("time_s", "s"),
    "output": ("rate_dph", "deg/h"),
    "t_in": ("t_in_degc", "degC"),
    "t_out": ("t_out_degc", "degC"),
    "angle": ("angle_deg", "deg"),
    "elevation": ("elevation_deg", "deg"),
}


def write_case(folder: Path, runs: Sequence[GapRun]) -> Path:
    """Write runs of one unit into a folder; return the mapping file that `read_mapped_runs` takes."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["format = 1", f"unit_id = {json.dumps(runs[0].unit_id)}"]
    lines += [f"latitude_deg = {runs[0].stimulus.latitude_deg!r}", "", "[columns]"]
    lines += [
        f"{key} = {{ name = {json.dumps(name)}, unit = {json.dumps(unit)} }}"
        for key, (name, unit) in _COLUMNS.items()
    ]
    for number, run in enumerate(runs, 1):
        file = f"run_{number:02d}.parquet"
        _write_run(folder / file, run)
        changes = [0, *(np.flatnonzero(run.phase[1:] != run.phase[:-1]) + 1).tolist()]
        phases = ", ".join(
            f"{{ name = {json.dumps(str(run.phase[k]))}, start_s = {float(k * run.stimulus.period_s)} }}"
            for k in changes
        )
        lines += ["", "[[run]]", f"file = {json.dumps(file)}", f"run_id = {json.dumps(run.run_id)}"]
        lines += [f"profile = {json.dumps(run.profile)}", f"condition = {json.dumps(run.condition)}"]
        lines += [f"power_on_s = {float(run.stimulus.time_s[0] - run.stimulus.period_s)!r}"]
        lines += [f"phases = [{phases}]"]
    path = folder / MAPPING_FILE
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _write_run(path: Path, run: GapRun) -> None:
    """Write rows at the edges of the samples; the first row's output covers no sample."""
    s = run.stimulus

    def after_first(values: np.ndarray) -> np.ndarray:
        return np.concatenate(([np.nan], values))

    columns = {
        "time_s": np.arange(len(s) + 1) * s.period_s,
        "rate_dph": after_first(run.output_dph),
        "t_in_degc": after_first(s.t_in_c),
        "t_out_degc": after_first(s.t_out_c),
        "angle_deg": s.angle_deg,
        "elevation_deg": after_first(s.elevation_deg),
    }
    pyarrow.parquet.write_table(pa.table(columns), path)
