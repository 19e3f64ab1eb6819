"""From a lab's configuration to its plant, ports and emulators."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drivers.errors import ConfigurationError
from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator
from simulators.emulators.weiss import WeissEmulator
from simulators.interfaces import Emulator, StreamingEmulator
from simulators.lab._config import DeviceConfig, GyroConfig, LabConfig
from simulators.lab._core import Lab
from simulators.lab._ports import Port, PtyPort, TcpPort
from simulators.lab._stagehand import Act
from simulators.plant.chamber import WEAK_CHAMBER, ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig

T = TypeVar("T")
_CHAMBERS = {"standard": ChamberParameters(), "weak": WEAK_CHAMBER}


def build_lab(config: LabConfig) -> tuple[Lab, dict[str, Act]]:
    """Return the lab and what its stage hands can do; ConfigurationError names what it cannot emulate."""
    plant = LabPlant(_plant_config(config))
    patient = config.clock == "virtual"
    ports: list[Port] = [
        _port("table", config.table.transport, patient),
        _port("chamber", config.chamber.transport, patient),
    ]
    weiss, acutrol = _chamber(config.chamber, plant), _table(config.table, plant)
    emulators: dict[str, Emulator] = {"table": acutrol, "chamber": weiss}
    streams: dict[str, StreamingEmulator] = {}
    for gyro in config.gyros:
        ports.append(_port(gyro.name, gyro.transport, patient))
        emulators[gyro.name] = streams[gyro.name] = _gyro(gyro, plant)
    lab = Lab(plant, ports, emulators, streams, delivery_s=config.delivery_s)
    return lab, _acts(plant, acutrol, weiss)


def _plant_config(config: LabConfig) -> PlantConfig:
    return PlantConfig(
        latitude_deg=config.latitude_deg,
        seed=config.seed,
        room_temp_c=config.room_temp_c,
        chamber=_known("chamber model", config.chamber_model, _CHAMBERS),
        axes=tuple((axis["name"], axis["direction"]) for axis in config.table.settings["axes"]),
        units=tuple(
            UnitConfig(
                name=gyro.name,
                model=gyro.model,
                unit_seed=gyro.unit_seed,
                mounting=gyro.mounting,
                mount_azimuth_error_deg=gyro.mount_azimuth_error_deg,
                aux_sensor=gyro.settings.get("case_sensor") or 0,
            )
            for gyro in config.gyros
        ),
    )


def _port(name: str, transport: str, patient: bool) -> Port:
    return TcpPort(name, patient=patient) if transport == "tcp" else PtyPort(name, patient=patient)


def _known(what: str, name: str, table: dict[str, T]) -> T:
    if name not in table:
        raise ConfigurationError(
            f"the emulated lab has no {what} {name!r}", expected="one of " + ", ".join(table)
        )
    return table[name]


def _table(device: DeviceConfig, plant: LabPlant) -> AcutrolEmulator:
    axes = {
        axis["number"]: AcutrolAxis(plant.tables[axis["name"]], axis["min_angle_deg"], axis["max_angle_deg"])
        for axis in device.settings["axes"]
    }
    return _known("table", device.driver, {"acutrol3000": AcutrolEmulator})(axes)


def _chamber(device: DeviceConfig, plant: LabPlant) -> WeissEmulator:
    return _known("chamber", device.driver, {"weiss": WeissEmulator})(
        plant.chamber,
        address=device.settings["address"],
        auxiliary=tuple(int(number) for number in device.settings["auxiliary"]),
        start_channel=device.settings["start_channel"],
    )


def _gyro(gyro: GyroConfig, plant: LabPlant) -> StreamingEmulator:
    return _known("gyro", gyro.driver, {"kvh1750": _kvh, "sbg_ellipse": _sbg, "rlg2t": _rlg})(gyro, plant)


def _kvh(gyro: GyroConfig, plant: LabPlant) -> StreamingEmulator:
    from simulators.emulators.kvh import KvhEmulator

    return KvhEmulator(
        plant.unit(gyro.name),
        serial_number=gyro.settings["unit"],
        axes=gyro.settings["axes"],
        baudrate=gyro.settings["baudrate"],
        clock_error_ppm=gyro.clock_error_ppm,
        streaming=True,
    )


def _sbg(gyro: GyroConfig, plant: LabPlant) -> StreamingEmulator:
    from simulators.emulators.sbg import SbgEmulator  # cantools takes longer to import than all the rest

    return SbgEmulator(
        plant.unit(gyro.name),
        rate_hz=gyro.settings["rate_hz"],
        bitrate=gyro.settings["bitrate"],
        clock_error_ppm=gyro.clock_error_ppm,
    )


def _rlg(gyro: GyroConfig, plant: LabPlant) -> StreamingEmulator:
    from simulators.emulators.rlg import RlgEmulator

    return RlgEmulator(
        plant.unit(gyro.name),
        rate_hz=gyro.settings["rate_hz"],
        baudrate=gyro.settings["baudrate"],
        clock_error_ppm=gyro.clock_error_ppm,
    )


def _acts(plant: LabPlant, table: AcutrolEmulator, chamber: WeissEmulator) -> dict[str, Act]:
    def mount(request: dict[str, Any]) -> dict[str, Any]:
        units = [request["unit"]] if "unit" in request else [unit.name for unit in plant.config.units]
        for unit in units:
            plant.mount(unit, request["mounting"])
        return {}

    def truth(request: dict[str, Any]) -> dict[str, Any]:
        """Write the true drift of a unit to an .npz file."""
        np.savez(Path(request["path"]), allow_pickle=False, **plant.true_drift(request["unit"]))
        return {}

    def alarm(request: dict[str, Any]) -> dict[str, Any]:
        chamber.raise_alarm(str(request["text"]), plant.now_s)
        return {}

    def trip(request: dict[str, Any]) -> dict[str, Any]:
        table.trip(str(request["reason"]), plant.now_s, request.get("axis"))
        return {}

    return {"mount": mount, "truth": truth, "alarm": alarm, "trip": trip}
