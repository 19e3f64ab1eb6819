"""An IMU's log, by its mapping file, as the record of a unit that was turned by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._by_hand import HandRecord
from bench.analysis.calibration._imu_log import read_imu_log
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_AT_LIMIT = 3
"""Equal samples in a row at a gyro's extreme from which on it is the end of its range."""


def load_hand_record(mapping_file: Path) -> tuple[HandRecord, float, Path]:
    """Return the record of a mapping file's first log on an even grid, the latitude in deg, and the log.

    ConfigurationError for a mapping without three gyros and three accelerometers, and for an unreadable log.
    """
    log = read_imu_log(mapping_file)
    if log.latitude_deg is None:
        raise ConfigurationError(
            "a calibration by hand needs a mapping file",
            where=str(mapping_file),
            expected="a file that ends in .toml",
            remedy="`gyrobench look LOG --write FOLDER` writes one",
        )
    record = HandRecord(log.unit_id, log.period_s, log.rates_dps, log.forces_mps2, saturated(log.rates_dps))
    return record, log.latitude_deg, log.file


def saturated(rate_dps: Array) -> NDArray[np.bool_]:
    """Return the samples (n,) at which a gyro (n, 3) stays at the largest or smallest value that it has."""
    at = np.zeros(len(rate_dps), np.bool_)
    for own in rate_dps.T:
        for extreme in (np.nanmin(own), np.nanmax(own)):
            for low, high in stretches(own == extreme).tolist():
                at[low:high] |= high - low >= _AT_LIMIT
    return at
