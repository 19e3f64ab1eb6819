"""From a lab's configuration to its plant, ports and emulators."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file
from drivers.kit.config import DeviceConfig, SupplyConfig
from drivers.kit.places import is_serial
from drivers.kit.registry import EMULATORS, registered
from simulators.config import Bearing, GyroInLab, InstrumentInLab, LabConfig, PlatformInLab
from simulators.faults import VANISH, Fault
from simulators.interfaces import Emulator, EmulatorMaker, Installation, StreamingEmulator
from simulators.lab._adapter import Adapter
from simulators.lab._control_channel import Act
from simulators.lab._core import Lab
from simulators.lab._line import Line
from simulators.lab._ports import Port, PtyPort, TcpPort
from simulators.lab._power import Power, Since
from simulators.plant.accelerometers import draw_accelerometers
from simulators.plant.chamber import WEAK_CHAMBER, ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, Unit, UnitConfig, UnitKind
from simulators.plant.lab_platform import LabPlatform
from simulators.plant.load import Load
from simulators.plant.modelled_unit import ModelledErrors
from simulators.plant.space_stable import draw_platform, with_heading_effect
from simulators.plant.table import TableParameters
from simulators.plant.wobble import Wobble

T = TypeVar("T")
_CHAMBERS = {"standard": ChamberParameters(), "weak": WEAK_CHAMBER}
_NEW = Installation()
_POWER_W: Mapping[str, float] = {
    **{"fog_mid": 3.0, "fog_nav": 6.0, "mems": 0.5, "ins_triad": 25.0, "rlg": 8.0},
    **{"imu": 5.0, "imu_full": 5.0},
}
"""What a unit of each model draws from its supply."""


def build_lab(config: LabConfig) -> tuple[Lab, dict[str, Act]]:
    """Return the lab and what its emulated operator can do; ConfigurationError names what it cannot emulate."""
    ports: list[Port] = []
    try:
        return _built(config, ports)
    except BaseException:
        for port in ports:
            port.close()
        raise


def _built(config: LabConfig, ports: list[Port]) -> tuple[Lab, dict[str, Act]]:
    """Build a lab; what it has opened is in `ports`, whether it can be built or not."""
    plant = LabPlant(plant_config(config))
    ports.append(_port("table", config.table.port, config))
    ports.append(_port("chamber", config.chamber.port, config))
    emulators: dict[str, Emulator] = {
        "table": _emulator("table", config.table.driver, config.table, plant.tables),
        "chamber": _emulator("chamber", config.chamber.driver, config.chamber, plant.chamber),
    }
    streams: dict[str, StreamingEmulator] = {}
    for gyro in config.gyros:
        name = gyro.config.name
        ports.append(_port(name, gyro.config.port, config))
        emulators[name] = streams[name] = _gyro(gyro, plant.unit(name))
    for platform in config.platforms:
        name = platform.config.name
        ports.append(_port(name, platform.config.port, config))
        emulators[name] = streams[name] = _platform(platform, config, plant)
    power = Power(plant, {gyro.config.name: gyro for gyro in config.gyros}, streams, _gyro)
    for instrument in config.instruments:
        name = instrument.config.name
        ports.append(_port(name, instrument.config.port, config))
        emulators[name] = _instrument(instrument, config, plant, power)
    streams |= {name: unit for name, unit in power.units.items() if not unit.is_on}
    emulators |= streams
    lab = Lab(
        plant,
        ports,
        emulators,
        streams,
        delivery_s=config.delivery_s,
        lines=_lines(config, emulators, plant),
        formats=config.lines,
        parities={"table": config.table.parity, "chamber": config.chamber.parity},
        adapters=_adapters(config, streams),
    )
    power.exchange = lab.exchange
    acts = _acts(plant, lab, emulators["chamber"])
    return lab, {**acts, "power_cycle": lambda request: power.cycle(request, lab.now_ns / 1e9)}


def _instrument(instrument: InstrumentInLab, config: LabConfig, plant: LabPlant, power: Power) -> Emulator:
    """Return an instrument's emulator. Its plant: a supply's loads by output, a logger's chamber, else the lab's.

    The units of a supply are off until it gives them power.
    """
    section, role = instrument.config, instrument.role
    if not isinstance(section, SupplyConfig):
        physics = plant.chamber if role == "logger" else plant
        return _emulator(role, section.driver, section, physics)
    drawn_w = {gyro.config.name: _POWER_W[gyro.model] for gyro in config.gyros}
    for output in section.outputs:
        for name in output.units:
            power.switch(name, False, 0.0)
    loads = {
        output.number: Load([(name, drawn_w.get(name, 0.0)) for name in output.units], power.switch)
        for output in section.outputs
    }
    return _emulator(role, section.driver, section, loads)


def _adapters(config: LabConfig, streams: Mapping[str, StreamingEmulator]) -> dict[str, Adapter]:
    """Return the adapters that hand streams over in batches; ConfigurationError for one of no unit."""
    for name in config.adapter_batch_s:
        _known("port", name, streams)
    return {name: Adapter(period_s) for name, period_s in config.adapter_batch_s.items()}


def _lines(config: LabConfig, emulators: Mapping[str, Emulator], plant: LabPlant) -> dict[str, Line]:
    """Return a line for each port, with its faults; ConfigurationError for one that no port has."""
    for fault in config.faults:
        _known("port", fault.port, emulators)
    lines = {}
    for name, emulator in emulators.items():
        device_faults = dict(getattr(emulator, "faults", {}))
        if name == "chamber":
            device_faults["weaken"] = lambda fault, now_s: plant.chamber.weaken(now_s, fault.factor)
        lines[name] = Line(
            name,
            [fault for fault in config.faults if fault.port == name],
            seed=config.seed,
            wire=getattr(emulator, "wire", None),
            device_faults=device_faults,
            texts=getattr(emulator, "fault_texts", None),
        )
    return lines


def plant_config(config: LabConfig) -> PlantConfig:
    """Return the physics of a lab; ConfigurationError for a model of a chamber or unit that there is not."""
    return PlantConfig(
        latitude_deg=config.latitude_deg,
        seed=config.seed,
        room_temp_c=config.room_temp_c,
        chamber=_known("chamber model", config.chamber_model, _CHAMBERS),
        axes=tuple((axis.name, axis.direction) for axis in config.table.all_axes),
        table=TableParameters(**asdict(config.rotation)),
        ground=config.ground,
        imu_error_scale=config.imu_error_scale,
        units=tuple(
            UnitConfig(
                name=gyro.config.name,
                model=_known("gyro model", gyro.model, {kind: kind for kind in get_args(UnitKind)}),
                unit_seed=gyro.unit_seed,
                axis=gyro.config.axis,
                mounting=gyro.mounting,
                mount_azimuth_error_deg=gyro.mount_azimuth_error_deg,
                tilt_deg=gyro.mount_tilt_deg,
                lean_deg=gyro.lean_deg,
                aux_sensor=gyro.config.case_sensor or 0,
                wobble=None if gyro.bearing is None else _wobble(gyro.bearing),
                on_ground=gyro.on_ground,
                errors=None if gyro.errors is None else ModelledErrors.from_json(gyro.errors),
            )
            for gyro in config.gyros
        ),
    )


def _wobble(bearing: Bearing) -> Wobble:
    return Wobble(
        {line: complex(x, y) for line, x, y in bearing.lines_arcsec},
        play_arcsec=complex(*bearing.play_arcsec),
        play_travel_deg=bearing.play_travel_deg,
        misalignment_arcsec=bearing.misalignment_arcsec,
    )


def _port(name: str, place: str | None, config: LabConfig) -> Port:
    """Return a pseudo-terminal, where there are, for a device on a serial line, else a TCP port."""
    if (place is not None and not is_serial(place)) or not hasattr(os, "openpty"):
        return TcpPort(name)
    returns = any(fault.kind == VANISH and fault.port == name for fault in config.faults)
    return PtyPort(name, returns=returns)


def _known(what: str, name: str, table: Mapping[str, T]) -> T:
    if name not in table:
        raise ConfigurationError(
            f"the emulated lab has no {what} {name!r}", expected="one of " + ", ".join(table)
        )
    return table[name]


def _emulator(
    role: str, kind: str, config: DeviceConfig, plant: object, installed: Installation = _NEW
) -> Emulator:
    maker = _known(role, kind, registered(EMULATORS, role)).load()
    return cast(EmulatorMaker, maker)(config, plant, installed)


def _gyro(gyro: GyroInLab, unit: Unit | Since, before: StreamingEmulator | None = None) -> StreamingEmulator:
    """Return a unit's emulator; `before`: what it was until it was switched off."""
    installed = Installation(gyro.clock_error_ppm, before)
    return cast(StreamingEmulator, _emulator("gyro", gyro.config.driver, gyro.config, unit, installed))


def _platform(platform: PlatformInLab, config: LabConfig, plant: LabPlant) -> StreamingEmulator:
    def heading_deg(time_s: float) -> float:
        return plant.table.total_angle_deg(time_s) - platform.north_deg

    drawn = draw_platform(
        platform.unit_seed, effect_dph=platform.effect_dph, latitude_deg=config.latitude_deg
    )
    if platform.modelled:
        drawn = with_heading_effect(drawn, platform.heading_effect)
    physics = LabPlatform(
        replace(
            drawn,
            start_k=platform.start_k,
            accelerometers=draw_accelerometers(platform.unit_seed, platform.accelerometers),
        ),
        config.seed,
        heading_deg,
        longitude_deg=platform.config.longitude_deg,
    )
    made = _emulator("platform", platform.config.driver, platform.config, physics)
    return cast(StreamingEmulator, made)


def _acts(plant: LabPlant, lab: Lab, chamber: Emulator) -> dict[str, Act]:
    def mount(request: dict[str, Any]) -> dict[str, Any]:
        units = [request["unit"]] if "unit" in request else [unit.name for unit in plant.config.units]
        for unit in units:
            if "attitude" in request:
                plant.mount_at(unit, request["attitude"])
            else:
                plant.mount(unit, request["mounting"], float(request.get("roll_deg", 0.0)))
        return {}

    def truth(request: dict[str, Any]) -> dict[str, Any]:
        """Write the true drift of a unit to an .npz file."""
        packed = BytesIO()
        np.savez(packed, allow_pickle=False, **plant.true_drift(request["unit"]))
        replace_file(Path(request["path"]), packed.getvalue(), sync=False)
        return {}

    def door(request: dict[str, Any]) -> dict[str, Any]:
        open_door = getattr(chamber, "open_door", None)
        if open_door is None:
            raise ConfigurationError(
                "the emulated chamber cannot tell of its door", expected="a chamber whose emulator can"
            )
        open_door(bool(request["open"]))
        return {}

    def inject(request: dict[str, Any]) -> dict[str, Any]:
        """Put a fault on a port: the keys of a [[fault]] in the plant file, at_s left out for now."""
        from pydantic import TypeAdapter  # few labs need it, and it takes as long as numpy to import

        at_s = request.pop("at_s", () if "rate_per_h" in request else [lab.now_ns / 1e9])
        lab.inject(TypeAdapter(Fault).validate_python({**request, "at_s": at_s}))
        return {}

    def struck(request: dict[str, Any]) -> dict[str, Any]:
        """Say which faults have struck so far, in order of time."""
        every = [entry for line in lab.lines.values() for entry in line.struck]
        return {"struck": sorted(every, key=lambda entry: float(entry["time_s"]))}

    acts = {"mount": mount, "truth": truth, "door": door}
    return {**acts, "fault": inject, "struck": struck}
