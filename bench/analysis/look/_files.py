"""What comes after a look: the log as a table with units, a mapping for each gyro, and a nominal's noise."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from bench.analysis.look._channels import ACCELEROMETER, GYRO
from bench.analysis.look._look import AxisLook, Look
from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file

_ARCSEC_PER_DEG = 3600.0
_QUANTISATION = np.sqrt(12.0)
"""A quantum over this is the standard deviation, and the Allan deviation's Q, of its rounding."""


def write_files(found: Look, folder: Path, *, latitude_deg: float, unit_id: str = "") -> list[Path]:
    """Write `NAME.pq` (Parquet), and for every gyro a mapping and a nominal with its `[noise]`; return the paths.

    The mapping is one of `gyrobench import` and `gap diagnose`; rows that the log lacks are missing in the table.
    ConfigurationError where the log leaves open what these files must say.
    """
    gyros = [axis for axis in found.axes if axis.channel.kind == GYRO]
    if not gyros or not found.clock.known or any(not axis.channel.unit for axis in gyros):
        raise ConfigurationError(
            "a mapping needs gyros, their unit and the sample rate",
            where=str(found.log),
            found="; ".join(found.questions) or "no gyro",
            expected="columns, units and rate, told or found",
        )
    folder.mkdir(parents=True, exist_ok=True)
    stem = found.log.stem
    table = folder / f"{stem}.pq"
    pa.parquet.write_table(_table(found, gyros), table)
    with found.log.open("rb") as log:
        checksum = hashlib.file_digest(log, "sha256").hexdigest()
    paths = [table]
    for axis in gyros:
        name = axis.channel.axis or axis.channel.name
        mapping, nominal = folder / f"{stem}_{name}.toml", folder / f"{stem}_{name}_nominal.toml"
        replace_file(mapping, _mapping(found, axis, table, checksum, latitude_deg, unit_id or stem))
        replace_file(nominal, _nominal(found, axis))
        paths += [mapping, nominal]
    return paths


def _table(found: Look, gyros: list[AxisLook]) -> pa.Table:
    columns = {axis.channel.name: axis.values for axis in found.axes} | dict(found.temperatures)
    some = np.asarray(np.isfinite([axis.values for axis in gyros]).any(axis=0), np.bool_)
    time_s = np.arange(len(some)) / found.clock.per_s
    return pa.table({"time_s": time_s[some]} | {name: values[some] for name, values in columns.items()})


def _mapping(
    found: Look, axis: AxisLook, table: Path, checksum: str, latitude_deg: float, unit_id: str
) -> str:
    lines = [
        f"# {found.log.name.encode('unicode_escape').decode()} as `gyrobench look` read it; its SHA-256:",
        f"# {checksum}",
        "format = 1",
        f"unit_id = {json.dumps(unit_id)}",
        f"latitude_deg = {float(latitude_deg)!r}",
        f'axis = "{axis.channel.axis or "x"}"',
        "",
        "[columns]",
        'time = { name = "time_s", unit = "s" }',
        f'output = {{ name = {json.dumps(axis.channel.name)}, unit = "deg/s" }}',
    ]
    if heat := next(iter(found.temperatures), ""):
        lines.append(f't_in = {{ name = {json.dumps(heat)}, unit = "degC" }}')
    lines += ["", "[[run]]", f"file = {json.dumps(table.name)}", f"profile = {json.dumps(found.log.stem)}"]
    elevation = _elevation(found, axis)
    known = "from the accelerometers at rest" if elevation is not None else "not known: say it"
    lines.append(f"elevation_deg = {elevation or 0.0:.1f}  # of the input axis, 90 is up; {known}")
    return "\n".join(lines) + "\n"


def _elevation(found: Look, axis: AxisLook) -> float | None:
    """Return how far the axis points up, from the mean of the accelerometers at rest; None without three."""
    heavy = {
        other.channel.axis: other.figures.mean
        for other in found.axes
        if other.channel.kind == ACCELEROMETER and np.isfinite(other.figures.mean)
    }
    if set(heavy) != {"x", "y", "z"} or axis.channel.axis not in heavy:
        return None
    size = float(np.sqrt(sum(value**2 for value in heavy.values())))
    return float(np.degrees(np.arcsin(np.clip(heavy[axis.channel.axis] / size, -1.0, 1.0)))) if size else None


def _nominal(found: Look, axis: AxisLook) -> str:
    """Return a nominal with the noise only: the fitted coefficients, or what the curve itself shows."""
    allan = axis.allan
    lines = [
        f"# Noise of {axis.channel.name}, at rest, {axis.noise_from_s:.6g} s to {axis.noise_to_s:.6g} s."
    ]
    if allan is None or not np.isfinite(allan.coefficients[1]):
        raise ConfigurationError(
            "the rest is too short for a noise estimate",
            where=axis.channel.name,
            expected="512 samples at least",
        )
    quantisation, white, flicker, walk, _ = allan.coefficients
    if allan.fits and white > 0.0:
        lines.append("# Fitted to the Allan deviation (IEEE Std 952).")
    else:
        lines += [
            f"# The five coefficients do not describe the Allan deviation (off by {allan.worst_ratio:.3g} at "
            f"{allan.worst_tau_s:.3g} s):",
            "# read off the curve instead, white noise where it falls with the root, flicker where it is lowest.",
        ]
        white = (
            allan.white
            if np.isfinite(allan.white)
            else float(allan.deviation[0] * np.sqrt(allan.tau_s[0] / 3600.0))
        )
        flicker, walk, quantisation = allan.lowest, 0.0, 0.0
    lines += [
        "format = 1", f"name = {json.dumps(found.log.stem)}", "", "[noise]", f"arw_deg_per_sqrt_h = {white!r}",
        f"bias_instability_dph = {flicker!r}", f"rate_random_walk_dph_per_sqrt_h = {walk!r}",
        f"quantum_arcsec = {float(quantisation * _ARCSEC_PER_DEG * _QUANTISATION)!r}",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
