"""What comes after a look: the log as a table with units, a mapping for each gyro, and a nominal's noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from bench.analysis.look._channels import ACCELEROMETER, GYRO
from bench.analysis.look._look import AxisLook, Look
from bench.record.recording import checksum
from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file

_ARCSEC_PER_DEG = 3600.0
_QUANTISATION = np.sqrt(12.0)
"""A quantum over this is the standard deviation, and the Allan deviation's Q, of its rounding."""


def write_files(found: Look, folder: Path, *, latitude_deg: float, unit_id: str = "") -> list[Path]:
    """Write `NAME.pq` (Parquet), and for every gyro a mapping and a nominal with its `[noise]`; return the paths.

    The mapping is one of `gyrobench import` and `gap diagnose`; rows that the log lacks are missing in the
    table. ConfigurationError where the log leaves open what these files must say.
    """
    gyros = [axis for axis in found.axes if axis.channel.kind == GYRO]
    if not gyros or not found.clock.known or any(not axis.channel.unit for axis in gyros):
        raise ConfigurationError(
            "a mapping needs gyros, their unit and the sample rate",
            where=str(found.log),
            found="; ".join(found.questions) or "no gyro",
            expected="columns, units and rate, told or found",
        )
    stem = found.log.stem
    texts = {}
    for axis in gyros:
        name = axis.channel.axis or axis.channel.name
        texts[f"{stem}_{name}.toml"] = _mapping(found, axis, gyros, latitude_deg, unit_id or stem)
        texts[f"{stem}_{name}_nominal.toml"] = _nominal(found, axis)
    folder.mkdir(parents=True, exist_ok=True)
    some = np.asarray(np.isfinite([axis.values for axis in gyros]).any(axis=0), np.bool_)
    columns = {axis.channel.name: axis.values for axis in found.axes} | dict(found.temperatures)
    time_s = np.arange(len(some)) / found.clock.per_s
    rows = {"time_s": time_s[some]} | {name: values[some] for name, values in columns.items()}
    pa.parquet.write_table(pa.table(rows), folder / f"{stem}.pq")
    for name, text in texts.items():
        replace_file(folder / name, text)
    return [folder / name for name in (f"{stem}.pq", *texts)]


def _mapping(found: Look, axis: AxisLook, gyros: list[AxisLook], latitude_deg: float, unit_id: str) -> str:
    heavy = {one.channel.axis: one for one in found.axes if one.channel.kind == ACCELEROMETER}
    elevation = _elevation(heavy, axis)
    rows = [f"time = {_column('time_s', 's')}"]
    rows += [f"t_in = {_column(name, 'degC')}" for name in list(found.temperatures)[:1]]
    axes = {one.channel.axis: one for one in gyros}
    if axis.channel.axis in ("x", "y", "z") and len(axes) == len(gyros) and set(axes) <= set("xyz"):
        rows += [f"gyros.{name} = {_column(one.channel.name, 'deg/s')}" for name, one in sorted(axes.items())]
        if set(heavy) == set("xyz") and all(one.channel.unit for one in heavy.values()):
            rows += [
                f"accelerometers.{name} = {_column(one.channel.name, 'm/s^2')}"
                for name, one in sorted(heavy.items())
            ]
    else:
        rows.append(f"output = {_column(axis.channel.name, 'deg/s')}")
    known = "from the accelerometers at rest" if elevation is not None else "not known: say it"
    return f"""# {found.log.name.encode("unicode_escape").decode()} as `gyrobench look` read it; its SHA-256:
# {checksum(found.log).sha256}
format = 1
unit_id = {json.dumps(unit_id)}
latitude_deg = {float(latitude_deg)!r}
axis = "{axis.channel.axis or "x"}"

[columns]
{chr(10).join(rows)}

[[run]]
file = {json.dumps(found.log.stem + ".pq")}
profile = {json.dumps(found.log.stem)}
elevation_deg = {elevation or 0.0:.1f}  # of the input axis, 90 is up; {known}
"""


def _column(name: str, unit: str) -> str:
    return f'{{ name = {json.dumps(name)}, unit = "{unit}" }}'


def _elevation(heavy: dict[str, AxisLook], axis: AxisLook) -> float | None:
    """Return how far the axis points up, from the mean of the accelerometers at rest; None without three."""
    if not {"x", "y", "z", axis.channel.axis} <= set(heavy) or set(heavy) - {*"xyz"}:
        return None
    size = float(np.sqrt(sum(one.figures.mean**2 for one in heavy.values())))
    return float(np.degrees(np.arcsin(np.clip(heavy[axis.channel.axis].figures.mean / size, -1.0, 1.0))))


def _nominal(found: Look, axis: AxisLook) -> str:
    """Return a nominal with the noise only: the fitted coefficients, or what the curve itself shows."""
    allan = axis.allan
    if allan is None or np.isnan(allan.coefficients[0, 0]):
        raise ConfigurationError(
            "the rest is too short for a noise estimate",
            where=axis.channel.name,
            expected="512 samples at least",
        )
    quantisation, white, flicker, walk, _ = allan.coefficients[0].tolist()
    how = "# Fitted to the Allan deviation (IEEE Std 952)."
    if not allan.fits or white <= 0.0:
        how = (
            f"# The five coefficients do not describe the Allan deviation (off by {allan.worst_ratio:.3g} at "
            f"{allan.worst_tau_s:.3g} s):\n# read off the curve instead, white noise where it falls with the "
            "root, flicker where it is lowest."
        )
        first = float(allan.deviation[0] * np.sqrt(allan.tau_s[0] / 3600.0))
        white = allan.white if np.isfinite(allan.white) else first
        quantisation, flicker, walk = 0.0, allan.lowest, 0.0
    return f"""# Noise of {axis.channel.name}, at rest, {axis.noise_from_s:.6g} s to {axis.noise_to_s:.6g} s.
{how}
format = 1
name = {json.dumps(found.log.stem)}

[noise]
arw_deg_per_sqrt_h = {white!r}
bias_instability_dph = {flicker!r}
rate_random_walk_dph_per_sqrt_h = {walk!r}
quantum_arcsec = {float(quantisation * _ARCSEC_PER_DEG * _QUANTISATION)!r}
"""
