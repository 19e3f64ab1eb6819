"""An IMU's log, by its mapping file, as the record of a unit that was turned by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._by_hand import HandRecord
from bench.analysis.common.statistics import on_grid, stretches
from bench.record.exchange import read_log, read_mapping
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_AXES = "xyz"
_AT_LIMIT = 3
"""Equal samples in a row at a gyro's extreme from which on it is the end of its range."""


def load_hand_record(mapping_file: Path) -> tuple[HandRecord, float, Path]:
    """Return the record of a mapping file's first log on an even grid, the latitude in deg, and the log.

    ConfigurationError for a mapping without three gyros and three accelerometers, and for an unreadable log.
    """
    mapping = read_mapping(mapping_file)
    columns = mapping.columns
    if set(columns.gyros) != set(_AXES) or set(columns.accelerometers) != set(_AXES):
        raise ConfigurationError(
            "a calibration by hand needs three gyros and three accelerometers",
            where=str(mapping_file),
            found=f"gyros {', '.join(sorted(columns.gyros)) or 'none'}, "
            f"accelerometers {', '.join(sorted(columns.accelerometers)) or 'none'}",
            expected="[columns.gyros] and [columns.accelerometers] with x, y and z",
            remedy="`gyrobench look LOG --write FOLDER` writes such a mapping",
        )
    _, file = mapping.logs(mapping_file)[0]
    log = read_log(file, mapping)
    period_s = float(np.median(np.diff(log.time_s)))
    place = np.rint((log.time_s - log.time_s[0]) / period_s).astype(np.int64)
    gyros = ["output" if axis == mapping.axis else f"rate_{axis}" for axis in _AXES]
    rates, forces = (
        on_grid(place, np.stack([log.columns[name] for name in names], axis=1))
        for names in (gyros, [f"accelerometer_{axis}" for axis in _AXES])
    )
    return HandRecord(mapping.unit_id, period_s, rates, forces, saturated(rates)), mapping.latitude_deg, file


def saturated(rate_dps: Array) -> NDArray[np.bool_]:
    """Return the samples (n,) at which a gyro (n, 3) stays at the largest or smallest value that it has."""
    at = np.zeros(len(rate_dps), np.bool_)
    for own in rate_dps.T:
        for extreme in (np.nanmin(own), np.nanmax(own)):
            for low, high in stretches(own == extreme).tolist():
                at[low:high] |= high - low >= _AT_LIMIT
    return at
