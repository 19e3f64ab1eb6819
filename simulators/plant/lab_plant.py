"""The physics of an emulated lab: one chamber, a table and the units mounted on it, in lab time.

Ticks are at integer seconds. A chamber demand counts from the tick after it; temperatures between ticks are
linear. The table is exact at any time. Noise depends on seed and index only, so the same demands at the same
times give the same bits however `advance` and `measure` are called.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from drivers.kit.config import Mounting
from simulators.config import Ground
from simulators.plant.chamber import ChamberAir, ChamberParameters
from simulators.plant.fog import fog_unit
from simulators.plant.fog_parameters import FOG_MID, FOG_NAV
from simulators.plant.gimbals import Gimbals
from simulators.plant.ground import MovingGround
from simulators.plant.imu import ImuUnit, imu_errors, imu_noise
from simulators.plant.lab_chamber import LabChamber
from simulators.plant.mems import mems_unit
from simulators.plant.model import UnitModel
from simulators.plant.modelled_channels import ModelledAir, ModelledTable, lab_channels, says_of
from simulators.plant.modelled_unit import ModelledErrors, modelled
from simulators.plant.mounting import MOUNTINGS, Mount
from simulators.plant.noise import NoiseSource
from simulators.plant.rlg import rlg_unit
from simulators.plant.table import TableAxis, TableParameters
from simulators.plant.triad import triad_unit
from simulators.plant.unit import GyroUnit
from simulators.plant.wobble import WhirlingUnit, Wobble, nominal_wobble

UnitKind = Literal["fog_mid", "fog_nav", "mems", "ins_triad", "rlg", "imu", "imu_full"]
Unit = GyroUnit | ImuUnit
_WALK = 61
"""Random stream of a modelled unit's rate random walk."""


@dataclass(frozen=True)
class UnitConfig:
    """A unit under test. Unit seed 0 of a FOG grade is the nominal unit; `change` is made to every model of it.

    `axis`: the one under test, which a mounting speaks of. `tilt_deg` is the fixture's, `lean_deg` the unit's own
    (see `simulators.plant.mounting.Mount`). `aux_sensor`: number of the chamber's auxiliary sensor
    glued to its case, 0 for none. `mounting` None: its axis horizontal, an IMU z up.
    `wobble`: the bearing that an `ins_triad` turns in, None for the nominal one of
    its seed; other units turn in a perfect one. `errors`: those of a fitted model instead of the unit's own; the
    thermal network stays. `on_ground`: it stands beside the table and does not turn with it.
    """

    name: str
    model: UnitKind = "fog_mid"
    unit_seed: int = 0
    axis: str = "x"
    mounting: Mounting | None = None
    mount_azimuth_error_deg: float = 0.0
    tilt_deg: float = 0.0
    lean_deg: tuple[float, float] = (0.0, 0.0)
    aux_sensor: int = 0
    change: Callable[[UnitModel], UnitModel] | None = None
    wobble: Wobble | None = None
    errors: ModelledErrors | None = None
    on_ground: bool = False


@dataclass(frozen=True)
class PlantConfig:
    """The lab: place, run seed (noise and turn-on), room, chamber, table, units.

    `axes`: name and direction at 0 (east, west, north, south, up, down) of every table axis, outermost first.
    """

    latitude_deg: float = 39.10
    seed: int = 0
    room_temp_c: float = 25.0
    chamber: ChamberParameters = field(default_factory=ChamberParameters)
    table: TableParameters = field(default_factory=TableParameters)
    ground: Ground = field(default_factory=Ground)
    imu_error_scale: float = 1.0
    axes: tuple[tuple[str, str], ...] = (("table", "up"),)
    units: tuple[UnitConfig, ...] = ()


def unit_model(config: UnitConfig, run_seed: int = 0, power_on: int = 0) -> UnitModel:
    """Build the model that a unit's configuration names; a ring laser differs a little between power cycles."""
    if config.model == "mems":
        model = mems_unit(config.unit_seed)
    elif config.model == "rlg":
        model = rlg_unit(config.unit_seed, run_seed, power_on)
    elif config.model == "ins_triad":
        model = triad_unit(config.unit_seed)
    else:
        model = fog_unit(FOG_MID if config.model == "fog_mid" else FOG_NAV, config.unit_seed)
    if config.errors is not None:
        model = modelled(model, config.errors, (run_seed, config.unit_seed, _WALK))
    return model if config.change is None else config.change(model)


class LabPlant:
    """The lab, switched on at 0 s with the chamber off, the table at rest and the units powered."""

    def __init__(self, config: PlantConfig) -> None:
        self.config = config
        self.now_s = 0.0
        carrier = config.axes[-1][0]
        models = {unit.name: unit.errors.channels for unit in config.units if unit.errors is not None}
        shared = lab_channels(models)
        self.tables: dict[str, TableAxis] = {}
        """The table's axes by name, outermost first."""
        for name, _ in config.axes:
            owner = "encoder" if name == carrier else f"encoder {name}"
            parts = (config.table, NoiseSource(config.seed, owner))
            wanted = name == carrier and says_of(shared, "table_angle", "table_rate")
            self.tables[name] = ModelledTable(*parts, shared) if wanted else TableAxis(*parts)
        self._ground = MovingGround(config.ground, NoiseSource(config.seed, "ground"))
        self._units: dict[str, Unit] = {}
        self._power_ons: dict[str, int] = {}
        self._ticks = 0
        for unit in config.units:
            self._add(unit)
        chamber = config.chamber
        if any(says_of(values, "case_temperature") for values in models.values()):
            # a model's case follows the air that is recorded
            chamber = replace(chamber, unit_lag_s=0.0)
        source = NoiseSource(config.seed, "chamber")
        air = ChamberAir(chamber, config.room_temp_c, source)
        if says_of(shared, "chamber_air"):
            air = ModelledAir(chamber, config.room_temp_c, source).follow(shared)
        glued = {unit.aux_sensor: self._units[unit.name] for unit in config.units if unit.aux_sensor}
        self.chamber = LabChamber(air, self.advance, glued)
        """A question to it advances the lab to the question's time."""

    @property
    def table(self) -> TableAxis:
        """The table axis that carries the units."""
        return self.tables[self.config.axes[-1][0]]

    def unit(self, name: str) -> Unit:
        """Return a unit, a `GyroPlant`; ConfigurationError for a name the lab does not have."""
        if name not in self._units:
            raise ConfigurationError(
                "no unit of that name in the lab",
                where="plant",
                found=name,
                expected="one of " + (", ".join(self._units) or "no units at all"),
            )
        return self._units[name]

    def advance(self, to_s: float) -> None:
        """Move the lab to `to_s`: every tick up to the next integer second is computed."""
        if to_s <= self.now_s:
            return
        self.now_s = to_s
        last = math.ceil(to_s)
        while self._ticks < last:
            self._tick()

    def mount(self, unit_name: str, mounting: Mounting, roll_deg: float = 0.0) -> None:
        """Put a unit on its bracket another way, now (the emulated operator does it)."""
        if mounting not in MOUNTINGS:
            raise ConfigurationError("no such mounting", found=str(mounting), expected=" or ".join(MOUNTINGS))
        self.unit(unit_name).mount(self.now_s, mounting, roll_deg)

    def switch(self, unit_name: str, on: bool, at_s: float) -> None:
        """Switch a unit's power at a time from now on. An IMU's errors stay."""
        unit = self.unit(unit_name)
        if isinstance(unit, ImuUnit):
            return
        if not on:
            unit.switch(at_s, None)
            return
        count = self._power_ons.get(unit_name, 0) + 1
        config = next(entry for entry in self.config.units if entry.name == unit_name)
        unit.switch(at_s, unit_model(config, self.config.seed, count))
        self._power_ons[unit_name] = count

    def mount_at(self, unit_name: str, attitude: Sequence[Sequence[float]]) -> None:
        """Mount an IMU now so that its attitude C (3, 3), body to east-north-up, is this with all axes at 0."""
        unit = self.unit(unit_name)
        if not isinstance(unit, ImuUnit):
            raise ConfigurationError(
                "only an IMU is mounted at an attitude", where=unit_name, expected="model imu or imu_full"
            )
        unit.mount_at(self.now_s, np.array(attitude, dtype=np.float64))

    def true_drift(self, unit_name: str) -> Mapping[str, Array]:
        """Return a unit's truth, float64 (ticks,) a name, tick k at k s.

        `bias_dph` (effects and turn-on, without flicker), `flicker_dph`, `sf_error_ppm` (without the parts that
        depend on rate), `sensor_temp_c`, `case_temp_c` (readings), and the model's own columns, for a
        fibre-optic gyro `coil_temp_c`, `coil_rate_k_per_min`, `board_temp_c`. The record grows by 8 float64 a
        tick for a FOG, 12 for a three-axis unit.
        """
        return self.unit(unit_name).truth()

    def _add(self, config: UnitConfig) -> None:
        if config.name in self._units:
            raise ConfigurationError("two units of one name", where="plant", found=config.name)
        if config.mounting not in (None, *MOUNTINGS):
            raise ConfigurationError(
                "no such mounting",
                where=config.name,
                found=str(config.mounting),
                expected=" or ".join(MOUNTINGS),
            )
        source = NoiseSource(self.config.seed, f"unit {config.name}")
        axes = [(direction, self.tables[name]) for name, direction in self.config.axes]
        if config.on_ground:  # as on a table that nobody ever turns
            axes = [("up", TableAxis(self.config.table, source))]
        if config.model in ("imu", "imu_full"):
            if config.errors is not None:
                raise ConfigurationError(
                    "a model's effects act on a single-axis unit",
                    where=config.name,
                    found=f"model {config.model}",
                    expected="a unit of the model fog_mid, fog_nav or rlg",
                    remedy="leave the unit out of [gap_model]",
                )
            full = config.model == "imu_full"
            imu = ImuUnit(
                imu_errors(config.unit_seed, full, self.config.imu_error_scale),
                imu_noise(full),
                axes,
                self.config.latitude_deg,
                source,
                axis=config.axis,
                azimuth_error_deg=config.mount_azimuth_error_deg,
                ground=self._ground,
            )
            if config.mounting is not None:
                imu.mount(0.0, config.mounting)
            imu.start(self.config.room_temp_c)
            self._units[config.name] = imu
            return
        upright = [direction for direction, _ in axes] == ["up"]
        if not upright and (config.model == "ins_triad" or config.errors is not None):
            raise ConfigurationError(
                "a unit of this model needs a table of one axis that points up",
                where=config.name,
                found=f"model {config.model}{' with the errors of a fitted model' if config.errors else ''} on "
                + ", ".join(f"{name} {direction}" for name, direction in self.config.axes),
                expected="another model, or a bench file without [[table.axes]]",
            )
        lying = config.mounting or "axis_horizontal"
        mount = Mount(
            lying, config.mount_azimuth_error_deg, config.tilt_deg, config.axis, 0.0, config.lean_deg
        )
        whirling = config.model == "ins_triad" and not config.on_ground
        if whirling:
            mount = replace(mount, mounting="z_up")
        parts = (unit_model(config, self.config.seed), mount, axes[-1][1], self.config.latitude_deg, source)
        unit = (
            WhirlingUnit(*parts, config.wobble or nominal_wobble(config.unit_seed), ground=self._ground)
            if whirling
            else GyroUnit(*parts, gimbals=None if upright else Gimbals(axes), ground=self._ground)
        )
        unit.start(self.config.room_temp_c)
        self._units[config.name] = unit

    def _tick(self) -> None:
        air_temp_c = self.chamber.tick()
        for unit in self._units.values():
            unit.tick(air_temp_c)
        self._ticks += 1
