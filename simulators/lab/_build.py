"""From a lab's configuration to its plant, ports and emulators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of
from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator
from simulators.emulators.weiss import WeissEmulator
from simulators.faults import VANISH, Fault
from simulators.interfaces import Emulator, StreamingEmulator
from simulators.lab._config import DeviceConfig, GyroConfig, LabConfig, PlatformConfig
from simulators.lab._core import Lab
from simulators.lab._line import Line
from simulators.lab._ports import Port, PtyPort, TcpPort
from simulators.lab._power import PowerCycled, Since
from simulators.lab._stagehand import Act
from simulators.plant.chamber import WEAK_CHAMBER, ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, Unit, UnitConfig, UnitKind
from simulators.plant.modelled_unit import ModelledErrors
from simulators.plant.table import TableParameters
from simulators.plant.wobble import EncoderParameters, Wobble

T = TypeVar("T")
_CHAMBERS = {"standard": ChamberParameters(), "weak": WEAK_CHAMBER}


def build_lab(config: LabConfig) -> tuple[Lab, dict[str, Act]]:
    """Return the lab and what its stage hands can do; ConfigurationError names what it cannot emulate."""
    plant = LabPlant(_plant_config(config))
    ports: list[Port] = [
        _port("table", config.table.transport, config),
        _port("chamber", config.chamber.transport, config),
    ]
    emulators: dict[str, Emulator] = {
        "table": _table(config.table, plant),
        "chamber": _chamber(config.chamber, plant),
    }
    streams: dict[str, StreamingEmulator] = {}
    for gyro in config.gyros:
        ports.append(_port(gyro.name, gyro.transport, config))
        emulators[gyro.name] = streams[gyro.name] = _gyro(gyro, plant.unit(gyro.name))
    for platform in config.platforms:
        ports.append(_port(platform.name, platform.transport, config))
        emulators[platform.name] = streams[platform.name] = _platform(platform, config, plant)
    lab = Lab(
        plant, ports, emulators, streams, delivery_s=config.delivery_s, lines=_lines(config, emulators, plant)
    )
    acts = _acts(plant, lab, emulators["chamber"])
    return lab, {**acts, "power_cycle": _power_cycle(config, plant, lab, streams)}


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


def _plant_config(config: LabConfig) -> PlantConfig:
    return PlantConfig(
        latitude_deg=config.latitude_deg,
        seed=config.seed,
        room_temp_c=config.room_temp_c,
        chamber=_known("chamber model", config.chamber_model, _CHAMBERS),
        axes=tuple((axis["name"], axis["direction"]) for axis in config.table.settings["axes"]),
        table=TableParameters(**_named(config.rotation, "ripple_")),
        encoder=EncoderParameters(**_named(config.rotation, "encoder_", strip=True)),
        units=tuple(
            UnitConfig(
                name=gyro.name,
                model=_known("gyro model", gyro.model, {kind: kind for kind in get_args(UnitKind)}),
                unit_seed=gyro.unit_seed,
                axis=gyro.settings["axis"],
                mounting=gyro.mounting,
                mount_azimuth_error_deg=gyro.mount_azimuth_error_deg,
                aux_sensor=gyro.settings.get("case_sensor") or 0,
                wobble=None if gyro.bearing is None else _wobble(gyro.bearing),
                errors=None if gyro.errors is None else ModelledErrors.from_json(gyro.errors),
            )
            for gyro in config.gyros
        ),
    )


def _named(values: Mapping[str, Any], prefix: str, *, strip: bool = False) -> dict[str, Any]:
    """Return the entries whose names begin with `prefix`, with or without it."""
    chosen = {name: value for name, value in values.items() if name.startswith(prefix)}
    return {name.removeprefix(prefix): value for name, value in chosen.items()} if strip else chosen


def _wobble(bearing: Mapping[str, Any]) -> Wobble:
    return Wobble(
        {float(line): complex(x, y) for line, x, y in bearing["lines_arcsec"]},
        play_arcsec=complex(*bearing["play_arcsec"]),
        play_travel_deg=bearing["play_travel_deg"],
        misalignment_arcsec=tuple(bearing["misalignment_arcsec"]),
    )


def _port(name: str, transport: str, config: LabConfig) -> Port:
    patient = config.clock == "virtual"
    if transport == "tcp":
        return TcpPort(name, patient=patient)
    returns = any(fault.kind == VANISH and fault.port == name for fault in config.faults)
    return PtyPort(name, patient=patient, returns=returns)


def _known(what: str, name: str, table: Mapping[str, T]) -> T:
    if name not in table:
        raise ConfigurationError(
            f"the emulated lab has no {what} {name!r}", expected="one of " + ", ".join(table)
        )
    return table[name]


def _table(device: DeviceConfig, plant: LabPlant) -> Emulator:
    kinds = {"acutrol3000": _acutrol, "ideal_atl": _atl}
    if other := _of_others("table", device.driver, kinds):
        return other(device.settings, plant.table)
    return _known("table", device.driver, kinds)(device, plant)


def _acutrol(device: DeviceConfig, plant: LabPlant) -> Emulator:
    axes = {
        axis["number"]: AcutrolAxis(plant.tables[axis["name"]], axis["min_angle_deg"], axis["max_angle_deg"])
        for axis in device.settings["axes"]
    }
    return AcutrolEmulator(axes)


def _atl(device: DeviceConfig, plant: LabPlant) -> Emulator:
    from simulators.emulators.ideal_atl import AtlEmulator

    return AtlEmulator(plant.table, baudrate=device.settings["baudrate"])


def _chamber(device: DeviceConfig, plant: LabPlant) -> Emulator:
    kinds = {
        "weiss": _weiss,
        "espec_p300": _p300,
        "espec_scp220": _scp220,
        "watlow_f4": _f4,
        "watlow_f4t": _f4t,
    }
    if other := _of_others("chamber", device.driver, kinds):
        return other(device.settings, plant.chamber)
    return _known("chamber", device.driver, kinds)(device, plant)


def _weiss(device: DeviceConfig, plant: LabPlant) -> Emulator:
    return WeissEmulator(
        plant.chamber,
        address=1 if device.settings["address"] is None else device.settings["address"],
        auxiliary=tuple(int(number) for number in device.settings["auxiliary"]),
        start_channel=device.settings["start_channel"],
    )


def _p300(device: DeviceConfig, plant: LabPlant) -> Emulator:
    from simulators.emulators.espec import EspecEmulator

    return EspecEmulator(plant.chamber, address=device.settings["address"])


def _scp220(device: DeviceConfig, plant: LabPlant) -> Emulator:
    from simulators.emulators.espec import EspecEmulator

    return EspecEmulator(plant.chamber, rom="SCP-220 V2.10", address=device.settings["address"])


def _f4(device: DeviceConfig, plant: LabPlant) -> Emulator:
    from simulators.emulators.watlow import F4Emulator  # pymodbus takes a third of a second to import

    settings = device.settings
    return F4Emulator(
        plant.chamber,
        start_output=settings["start_channel"],
        device=settings["address"] or 1,
        baudrate=settings["baudrate"],
    )


def _f4t(device: DeviceConfig, plant: LabPlant) -> Emulator:
    from simulators.emulators.watlow import F4TEmulator

    return F4TEmulator(
        plant.chamber,
        framing="tcp" if device.transport == "tcp" else "rtu",
        device=device.settings["address"] or 1,
        baudrate=device.settings["baudrate"],
    )


def _gyro(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None = None) -> StreamingEmulator:
    """Return a unit's emulator; `before`: what it was until it was switched off, for what outlasts that."""
    emulators = {
        "kvh1750": _kvh,
        "sbg_ellipse": _can,
        "can_dbc": _can,
        "rlg2t": _rlg,
        "frames": _frames,
        "stim300": _stim300,
    }
    if other := _of_others("gyro", gyro.driver, emulators):
        return cast(StreamingEmulator, other(gyro.settings, unit))
    return _known("gyro", gyro.driver, emulators)(gyro, unit, before)


def _of_others(
    role: str, kind: str, ours: Mapping[str, object]
) -> Callable[[Mapping[str, Any], object], Emulator] | None:
    """Return another package's emulator: an entry point `<role>.<kind>` of group `gyrobench.emulators`.

    It is called with the device's section of the bench file and its plant (`simulators.interfaces`).
    """
    found = [] if kind in ours else list(entry_points_of("gyrobench.emulators").select(name=f"{role}.{kind}"))
    return cast("Callable[[Mapping[str, Any], object], Emulator]", found[0].load()) if found else None


def _kvh(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None) -> StreamingEmulator:
    from simulators.emulators.kvh import KvhEmulator

    return KvhEmulator(
        unit,
        serial_number=gyro.settings["unit"],
        axes=gyro.settings["axes"],
        baudrate=gyro.settings["baudrate"],
        clock_error_ppm=gyro.clock_error_ppm,
        streaming=True,
        settings=before.settings if isinstance(before, KvhEmulator) else None,
    )


def _can(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None) -> StreamingEmulator:
    from drivers.can_dbc import layout_of  # only a lab with such a gyro needs it
    from drivers.sbg import ellipse_layout
    from simulators.emulators.can_dbc import CanEmulator

    return CanEmulator(
        unit,
        ellipse_layout() if gyro.driver == "sbg_ellipse" else layout_of(gyro.settings),
        source_address=gyro.settings.get("source_address"),
        rate_hz=gyro.settings["rate_hz"],
        bitrate=gyro.settings["bitrate"],
        clock_error_ppm=gyro.clock_error_ppm,
        adapter=before.adapter if isinstance(before, CanEmulator) else None,
    )


def _rlg(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None) -> StreamingEmulator:
    from drivers.rlg import described

    return _frames(replace(gyro, settings=described(gyro.settings)), unit, before)


def _frames(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None) -> StreamingEmulator:
    from drivers.frames import family_in
    from simulators.emulators.frames import FrameEmulator

    return FrameEmulator(
        unit,
        family_in(gyro.settings),
        axes=gyro.settings["axes"],
        rate_hz=gyro.settings["rate_hz"],
        baudrate=gyro.settings["baudrate"],
        message=gyro.settings.get("frame_format"),
        clock_error_ppm=gyro.clock_error_ppm,
    )


def _platform(platform: PlatformConfig, config: LabConfig, plant: LabPlant) -> StreamingEmulator:
    return _known("platform", platform.driver, {"platform_ins": _pins})(platform, config, plant)


def _stim300(gyro: GyroConfig, unit: Unit | Since, before: StreamingEmulator | None) -> StreamingEmulator:
    from simulators.emulators.stim300 import Stim300Emulator

    return Stim300Emulator(
        unit,
        serial_number=gyro.settings["unit"],
        axes=gyro.settings["axes"],
        baudrate=gyro.settings["baudrate"],
        clock_error_ppm=gyro.clock_error_ppm,
        settings=before.settings if isinstance(before, Stim300Emulator) else None,
        ordered=gyro.settings.get("settings"),
    )


def _pins(platform: PlatformConfig, config: LabConfig, plant: LabPlant) -> StreamingEmulator:
    from simulators.emulators.platform import PlatformEmulator
    from simulators.plant.lab_platform import LabPlatform
    from simulators.plant.space_stable import draw_platform, with_heading_effect

    def heading_deg(time_s: float) -> float:
        return plant.table.total_angle_deg(time_s) - platform.north_deg

    drawn = draw_platform(
        platform.unit_seed, effect_dph=platform.effect_dph, latitude_deg=config.latitude_deg
    )
    physics = LabPlatform(
        with_heading_effect(drawn, platform.heading_effect) if platform.modelled else drawn,
        config.seed,
        heading_deg,
        longitude_deg=platform.settings["longitude_deg"],
    )
    return PlatformEmulator(
        physics,
        serial_number=platform.settings["unit"],
        period_s=platform.settings["period_s"],
        baudrate=platform.settings["baudrate"],
    )


def _power_cycle(config: LabConfig, plant: LabPlant, lab: Lab, streams: dict[str, StreamingEmulator]) -> Act:
    gyros = {gyro.name: gyro for gyro in config.gyros}

    def power_cycle(request: dict[str, Any]) -> dict[str, Any]:
        """Switch a gyro (default all) off now, and on again after `off_s` (default 60)."""
        off_s = float(request.get("off_s", 60.0))
        if not 1.0 <= off_s <= 86400.0:
            raise ConfigurationError(
                "a unit cannot be off for that long", found=f"off_s {off_s:g}", expected="1 s to a day"
            )
        now_s = lab.now_ns / 1e9
        for name in [request["unit"]] if "unit" in request else list(gyros):
            gyro, before = _known("gyro", name, gyros), streams[name]
            plant.power_cycle(name, off_s)
            on_s = now_s + off_s
            inner = before.after if isinstance(before, PowerCycled) else before
            after = _gyro(gyro, Since(plant.unit(name), on_s), inner)
            streams[name] = PowerCycled(before, after, off_s=now_s, on_s=on_s)
            lab.exchange(name, streams[name])
        return {}

    return power_cycle


def _acts(plant: LabPlant, lab: Lab, chamber: Emulator) -> dict[str, Act]:
    def mount(request: dict[str, Any]) -> dict[str, Any]:
        units = [request["unit"]] if "unit" in request else [unit.name for unit in plant.config.units]
        for unit in units:
            if "attitude" in request:
                plant.mount_at(unit, request["attitude"])
            else:
                plant.mount(unit, request["mounting"])
        return {}

    def truth(request: dict[str, Any]) -> dict[str, Any]:
        """Write the true drift of a unit to an .npz file."""
        np.savez(Path(request["path"]), allow_pickle=False, **plant.true_drift(request["unit"]))
        return {}

    def door(request: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(chamber, WeissEmulator):
            raise ConfigurationError(
                "the emulated chamber cannot tell of its door", expected="driver 'weiss'"
            )
        chamber.open_door(bool(request["open"]))
        return {}

    def inject(request: dict[str, Any]) -> dict[str, Any]:
        """Put a fault on a port: the keys of a [[fault]] in the plant file, at_s left out for now."""
        at_s = request.pop("at_s", () if "rate_per_h" in request else [lab.now_ns / 1e9])
        lab.inject(Fault(**request, at_s=tuple(at_s)))
        return {}

    def struck(request: dict[str, Any]) -> dict[str, Any]:
        """Say which faults have struck so far, in order of time."""
        every = [entry for line in lab.lines.values() for entry in line.struck]
        return {"struck": sorted(every, key=lambda entry: float(entry["time_s"]))}

    acts = {"mount": mount, "truth": truth, "door": door}
    return {**acts, "fault": inject, "struck": struck}
