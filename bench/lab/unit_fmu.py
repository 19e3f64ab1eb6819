"""A unit of an emulated lab as an FMU for co-simulation: for software that has a world of its own."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TypeVar

from bench.analysis.common.fmu import write_fmu
from bench.lab.emulated import Plant, lab_config
from bench.record.benchfile import BenchFile
from drivers.base.errors import ConfigurationError
from drivers.kit.config import DeviceConfig
from simulators.lab.unit_alone import UnitAlone

_D = TypeVar("_D", bound=DeviceConfig)


def write_unit_fmu(file: Path, bench: BenchFile, plant: Plant, gyro: str | None = None) -> None:
    """Write a gyro of a bench, as `plant` emulates it, as an FMU for co-simulation; `gyro` None: the first.

    Inputs `rate_dps` (`rate_x_dps`, ...), the true rate in inertial space, and `air_temp_c`; outputs
    `output_dps` (`output_x_dps`, ...), `temp_c` and `case_temp_c`. Its samples are those of the emulated lab of
    the same seed, without the error of its sample clock. ConfigurationError for a gyro that the bench has not, an
    IMU, a model with effects of angle or attitude, a file that cannot be written, and without PythonFMU.
    """
    config = lab_config(bench, plant)
    chosen = [each for each in config.gyros if gyro in (None, each.config.name)][:1]
    if not chosen:
        raise ConfigurationError(
            "the bench has no such gyro",
            where="--gyro",
            found=gyro or "no gyro at all",
            expected=", ".join(each.config.name for each in config.gyros) or "a bench file with a [[gyro]]",
        )
    section = _anywhere(chosen[0].config, "channel" if chosen[0].config.on_can else "port")
    alone = dataclasses.replace(
        config,
        table=_anywhere(config.table),
        chamber=_anywhere(config.chamber),
        gyros=(dataclasses.replace(chosen[0], config=section),),
        platforms=(),
        instruments=(),
        faults=(),
        lines={},
        emulated=None,
        cpu=None,
    )
    unit = chosen[0].config.unit
    about = f"Emulated gyro {unit}, model {chosen[0].model}, seed {plant.seed}."
    write_fmu(file, UnitAlone, json.loads(alone.to_line()), about)


def _anywhere(section: _D, place: str = "port") -> _D:
    """Return a device without where it is on its bench: whom the FMU is given to need not know."""
    return dataclasses.replace(section, **{place: "none"})
