"""An IMU's log on an even grid: by a mapping file, by an imported run, or by the names of its columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.analysis.calibration._conventions import AXES
from bench.analysis.common.even_rows import row_places
from bench.analysis.common.statistics import on_grid
from bench.record.exchange import Mapping, read_log, read_mapping, read_table
from bench.record.recording import Run
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError

_COLUMNS = [f"gyro_{axis}_dps" for axis in AXES] + [f"accelerometer_{axis}_mps2" for axis in AXES]
_MOST_MISSING = 20


@dataclass(frozen=True, eq=False)
class ImuLog:
    """Rates in deg/s and specific forces in m/s2, (n, 3) each, every `period_s`, NaN where missing; the log."""

    file: Path
    period_s: float
    rates_dps: Array
    forces_mps2: Array
    unit_id: str = ""
    latitude_deg: float | None = None


def read_imu_log(path: Path) -> ImuLog:
    """Return the first log of a mapping file, the log of an imported run folder, or a log by its columns.

    Those are time_s, gyro_x_dps .. and accelerometer_x_mps2 .., means over each sample. ConfigurationError for
    a file that cannot be read or lacks an axis, RecordError for one that is empty or not one of numbers.
    """
    if path.is_dir():
        imported = Run.open(path).manifest.imported
        if imported is None:
            raise RecordError("this run was not imported", where=str(path))
        return _mapped(path / imported.log, read_mapping(path / imported.mapping), path)
    if path.suffix == ".toml":
        mapping = read_mapping(path)
        return _mapped(mapping.logs(path)[0][1], mapping, path)
    table = read_table(path, ("time_s", *_COLUMNS))
    if table.words:
        name, word = next(iter(table.words.items()))
        raise RecordError("the record is not one of numbers", where=f"{path}: {name}", found=word)
    return _even(path, table.columns["time_s"], np.column_stack([table.columns[name] for name in _COLUMNS]))


def _mapped(file: Path, mapping: Mapping, where: Path) -> ImuLog:
    gyros, accelerometers = mapping.columns.gyros, mapping.columns.accelerometers
    if set(gyros) != set(AXES) or set(accelerometers) != set(AXES):
        raise ConfigurationError(
            "a calibration needs three gyros and three accelerometers",
            where=str(where),
            found=f"gyros {', '.join(sorted(gyros)) or 'none'}, "
            f"accelerometers {', '.join(sorted(accelerometers)) or 'none'}",
            expected="[columns.gyros] and [columns.accelerometers] with x, y and z",
            remedy="`gyrobench look LOG --write FOLDER` writes such a mapping",
        )
    log = read_log(file, mapping)
    names = ["output" if axis == mapping.axis else f"rate_{axis}" for axis in AXES]
    names += [f"accelerometer_{axis}" for axis in AXES]
    values = np.column_stack([log.columns[name] for name in names])
    return _even(file, log.time_s, values, mapping.unit_id, mapping.latitude_deg)


def _even(
    file: Path, time_s: Array, values: Array, unit_id: str = "", latitude_deg: float | None = None
) -> ImuLog:
    if len(values) < 2:
        raise RecordError("the record is empty", where=str(file))
    if not (np.diff(time_s) > 0.0).all():
        raise RecordError("times of the record do not grow", where=str(file))
    place, period_s = row_places(time_s)
    if place[-1] > _MOST_MISSING * len(values):
        raise RecordError(
            "most of the record is missing",
            where=str(file),
            found=f"{len(values)} rows {period_s:.4g} s apart in {time_s[-1] - time_s[0]:.0f} s",
            expected="one record without long pauses",
        )
    even = on_grid(place, values)
    return ImuLog(file, period_s, even[:, : len(AXES)], even[:, len(AXES) :], unit_id, latitude_deg)
