"""An emulated lab that matches a bench file: in this process or in one of its own, with the same bytes.

The only things the bench learns of it are ports and a clock URL, which it puts in the bench file's place.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from bench.lab._process import LabProcess
from bench.record.benchfile import BenchFile, Emulated
from drivers.base.errors import BenchError, ConfigurationError, one_of
from drivers.base.files import SETTINGS_BYTES, parse_toml, read_bounded, replace_file
from drivers.kit.config import GyroConfig, Mistake, Mounting, refusal
from simulators.config import (
    Accelerometers,
    Bearing,
    Ground,
    GyroInLab,
    InstrumentInLab,
    LabConfig,
    PlatformInLab,
    Rotation,
)
from simulators.faults import Fault

if TYPE_CHECKING:
    from bench.analysis.gap import Model
    from simulators.lab.in_process import InProcessLab

_MODELS = {"fog": "fog_mid", "mems": "mems", "rlg": "rlg"}
"""Technology of a gyro -> the model that an emulated one usually has."""

_OF_GYROS = ("on_ground", "mounting", "lean_deg", "clock_error_ppm")
"""Keys of a plant file that name gyros of the bench."""


class Plant(BaseModel):
    """What physics stands behind the emulated devices. Units not named get their driver's usual model."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=1, ge=0)
    room_temp_c: float = 25.0
    chamber: str = "standard"
    delivery_s: float = Field(default=4.0, gt=0, le=4)
    models: dict[str, str] = Field(default_factory=dict)
    """Unit id -> model name (fog_mid, fog_nav, mems, ins_triad, rlg, imu, imu_full)."""
    mount_azimuth_error_deg: float = Field(default=0.3, ge=-5, le=5)
    mount_tilt_deg: float = Field(default=0.0, ge=-5, le=5)
    """How far the fixture raises a level axis under test above the horizon."""
    lean_deg: dict[str, tuple[Annotated[float, Field(ge=-5, le=5)], Annotated[float, Field(ge=-5, le=5)]]] = (
        Field(default_factory=dict)
    )
    """Gyro name -> input-axis misalignment: angles by which the axis under test (x) leans towards the next one
    (y) and towards the last one (z). An IMU has errors of its own."""
    mounting: dict[str, Mounting] = Field(default_factory=dict)
    """Gyro name -> how it lies at first: axis_horizontal (not named, unless an imu: z_up), axis_up or z_up."""
    heading_effect_dph: float = Field(default=1e-3, ge=0, le=1)
    """rms over headings of the change of a platform's mean drift"""
    platform_start_k: float = Field(default=0.0, ge=-60, le=60)
    """How much warmer than in equilibrium a platform is at power-on: negative for a cold one."""
    accelerometers: dict[str, Accelerometers] = Field(default_factory=dict)
    """Platform's unit id -> how good its accelerometers are; the bench file says whether it sends them."""
    clock_error_ppm: dict[str, float] = Field(default_factory=dict)
    """Gyro name -> error of its sample clock, positive when it is fast; 10000 is 1 %."""
    adapter_batch_ms: dict[str, Annotated[float, Field(gt=0, le=1000)]] = Field(default_factory=dict)
    """Unit's name -> how often its USB adapter hands over what has come: 16 as most are delivered, 1 at best."""
    rotation: Rotation = Rotation()
    ground: Ground = Ground()
    """What the table stands on: gyros feel how it turns, an IMU's accelerometers how it moves as well."""
    on_ground: tuple[str, ...] = ()
    """Gyro names: units that stand on the ground beside the table and do not turn with it."""
    imu_error_scale: float = Field(default=1.0, gt=0, le=100)
    """How many times larger than a navigation-grade unit's the drawn errors of an IMU are."""
    bearing: dict[str, Bearing] = Field(default_factory=dict)
    """Unit id -> the bearing it turns in; a unit not named has its model's own."""
    gap_model: dict[str, Path] = Field(default_factory=dict)
    """Unit id -> model file (nominal, or written by `gyrobench gap close`): its effects and noise in place of the
    unit's own errors. Relative to the plant file."""
    actual: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Port name (table, chamber, a unit's or instrument's name) -> keys of its section as the device really has
    them: baudrate, address, rate_hz and others; also bytesize, parity, stopbits. A device named here
    understands only what is sent with its own settings; one that is not understands any."""
    fault: tuple[Fault, ...] = ()

    def _modelled(self, unit: str) -> Model | None:
        if unit not in self.gap_model:
            return None
        from bench.analysis.gap import read_model  # scipy takes its time to import

        return read_model(self.gap_model[unit])

    def errors_of(self, unit: str) -> dict[str, Any] | None:
        """Return terms and noise of the model that a unit is to follow, as JSON values, None without one."""
        model = self._modelled(unit)
        if model is None:
            return None
        terms = [
            {"effect": term.name, "values": list(term.values), "shape": dict(term.variant.shape)}
            for term in model.terms
        ]
        terms += [
            {"effect": term.name, "values": list(term.values), "shape": {}} for term in model.disturbances
        ]
        return {
            "terms": terms,
            "noise": model.noise.coefficients,
            "channels": {term.name: list(term.values) for term in model.channel_terms},
        }

    def platform_drift_of(self, unit: str) -> list[float] | None:
        """Return the drift of the model that a platform is to follow: the values of its effect, None without one.

        ConfigurationError for a model with effects that a platform does not have.
        """
        model = self._modelled(unit)
        if model is None:
            return None
        drifts = [term for term in model.channel_terms if term.effect.emulated_by == "platform"]
        others = [term.name for term in model.terms] + [term.name for term in model.disturbances]
        others += [term.name for term in model.channel_terms if term not in drifts]
        if others:
            raise ConfigurationError(
                "an emulated platform cannot follow these effects of its model",
                where=str(self.gap_model[unit]),
                found=", ".join(others),
                expected="the effect of heading on its drift, or none",
            )
        return list(drifts[0].values) if drifts else None

    def sample_clock_error_ppm(self, gyro: GyroConfig) -> float:
        """Return how fast a gyro's sample clock is: as its model has it, else as the plant file says."""
        model = self._modelled(gyro.unit)
        for term in model.channel_terms if model is not None else ():
            if term.effect.emulated_by == "sample_clock":
                return term.values[0]
        return self.clock_error_ppm.get(gyro.name, 0.0)

    def model_of(self, gyro: GyroConfig, axes: int = 1) -> str:
        """Return the name of the physics behind a gyro on a table of so many axes.

        A unit of three axes on a table of several is an IMU.
        """
        if axes > 1 and gyro.axes == "xyz":
            return self.models.get(gyro.unit, "imu")
        return self.models.get(gyro.unit, _MODELS[gyro.technology])

    def metadata(self, file: BenchFile) -> dict[str, Any]:
        """Return what the manifest of a run on this plant says of it."""
        return {"seed": self.seed, "model": self.summary(file)}

    def for_run(self, number: int) -> Plant:
        """Return the plant of run `number` of a campaign, counted from 0, with a seed of its own.

        A campaign then gives the same bytes however it was interrupted and however many runs go on side by side.
        """
        return self.model_copy(update={"seed": self.seed + number})

    def summary(self, file: BenchFile) -> str:
        """Return in a few words what is emulated."""
        axes = len(file.table.all_axes)
        units = [
            f"{gyro.name} {self.model_of(gyro, axes)}"
            + (f" with the errors of {self.gap_model[gyro.unit].name}" if gyro.unit in self.gap_model else "")
            for gyro in file.gyro
        ]
        for platform in file.platform:
            model = self.gap_model.get(platform.unit)
            drift = "" if model is None else f" with the drift of {model.name}"
            units.append(f"{platform.name} space-stable platform{drift}")
        faults = f", {len(self.fault)} faults" if self.fault else ""
        return f"{self.chamber} chamber, {', '.join(units)}{faults}"


def unit_seed(unit: str) -> int:
    """Return the seed that makes an emulated unit itself: the same serial number is the same unit every day."""
    return int.from_bytes(hashlib.sha256(unit.encode()).digest()[:4], "little")


class EmulatedLab:
    """A running lab; use as a context manager. `file` is the bench file that reaches it.

    It is in this process unless `apart` gives it a process of its own, which other software can reach and which
    outlives a bench that is killed; on the wall clock, where time goes by itself, it always has one. The bytes
    are the same. Lab and bench share a processor; labs that run side by side have different lanes.
    """

    def __init__(
        self,
        file: BenchFile,
        plant: Plant,
        *,
        clock: Literal["virtual", "wall"] = "virtual",
        lane: int | None = None,
        apart: bool = False,
    ) -> None:
        allowed = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
        cpu = allowed[(os.getpid() if lane is None else lane) % len(allowed)] if allowed else None
        line = lab_config(file, plant, clock, cpu).to_line()
        self._lab: LabProcess | InProcessLab = (
            LabProcess(line) if apart or clock == "wall" else _in_process(line)
        )
        self.clock_url = self._lab.clock_url
        self.emulated = plant.metadata(file)
        """What the manifest of a run on this lab says of it."""
        # On a lab's own clock the greeting says what is emulated, on the wall clock only the bench file can.
        metadata = self.emulated if self.clock_url is None else None
        self.file = _with_ports(file, self.ports, self.clock_url, metadata)

    @property
    def ports(self) -> dict[str, str]:
        """Where the devices are, by name."""
        return self._lab.ports

    def perform(self, act: dict[str, Any]) -> dict[str, Any]:
        """Have the emulated operator do `act` in the lab; BenchError says why it could not."""
        answer = self._lab.perform(json.dumps(act).encode())
        if not answer.get("ok"):
            raise BenchError(f"the emulated lab could not do {act}: {answer.get('error')}")
        return answer

    def wait(self) -> None:
        """Wait until the lab's own process ends."""
        if isinstance(self._lab, LabProcess):
            self._lab.wait()

    def close(self) -> None:
        """End the lab."""
        self._lab.close()

    def save_truth(self, folder: Path) -> None:
        """Keep the true drift of every emulated unit, and the faults, beside the run: for judging only.

        BenchError if they cannot be kept.
        """
        for gyro in self.file.gyro:
            path = (folder / f"truth_{gyro.name}.npz").resolve()
            self.perform({"act": "truth", "unit": gyro.name, "path": str(path)})
        if struck := self.perform({"act": "struck"})["struck"]:
            lines = "".join(json.dumps(entry) + "\n" for entry in struck)
            try:
                replace_file(folder / "truth_faults.jsonl", lines, sync=False)
            except OSError as error:
                raise BenchError(
                    "what the faults did could not be kept",
                    where=str(folder),
                    found=error.strerror or str(error),
                ) from error

    def __enter__(self) -> EmulatedLab:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _in_process(line: bytes) -> InProcessLab:
    from simulators.lab.in_process import (
        InProcessLab,
    )  # plant and emulators: only who has a lab here loads them

    return InProcessLab(line)


def load_plant(path: Path | None, seed: int | None = None) -> Plant:
    """Read a plant file (TOML); None gives the defaults. `seed`: in place of the file's."""
    seeded = {} if seed is None else {"seed": seed}
    if path is None:
        return Plant().model_copy(update=seeded)
    try:
        plant = Plant.model_validate(parse_toml(read_bounded(path, SETTINGS_BYTES)))
    except ValidationError as error:
        raise refusal("the plant file", str(path), [_mistake(each) for each in error.errors()]) from error
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            "the plant file cannot be used",
            where=str(path),
            found=str(error),
            expected="a TOML file",
        ) from error
    models = {unit: path.parent / file for unit, file in plant.gap_model.items()}
    return plant.model_copy(update={"gap_model": models, **seeded})


def _mistake(details: ErrorDetails) -> Mistake:
    where, key = details["loc"], ".".join(map(str, details["loc"]))
    if details["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return Mistake(key, "an unknown key", one_of(str(where[-1]), _names_at(where[:-1])))
    if details["type"] in ("missing", "missing_argument"):
        return Mistake(key, "nothing", "a value")
    return Mistake(key, repr(details["input"]), details["msg"].removeprefix("Input should be "))


def _names_at(where: tuple[int | str, ...]) -> list[str]:
    """Return the keys of the table at a place of a plant file: the file's, or a section's."""
    if not where:
        return list(Plant.model_fields)
    kind = Plant.model_fields[str(where[0])].annotation
    sections = (each for each in (kind, *get_args(kind)) if dataclasses.is_dataclass(each))
    return [field.name for section in sections for field in dataclasses.fields(section)]


def lab_config(
    file: BenchFile, plant: Plant, clock: Literal["virtual", "wall"] = "virtual", cpu: int | None = None
) -> LabConfig:
    """Return what a lab's process is told to be: devices and units of the bench file, physics of the plant."""
    from bench.lab._actual import as_they_are, refuse_strangers

    refuse_strangers(file, {key: getattr(plant, key) for key in _OF_GYROS})
    file, lines = as_they_are(file, plant.actual)
    return LabConfig(
        clock=clock,
        lines=lines,
        seed=plant.seed,
        emulated=plant.metadata(file),
        latitude_deg=file.bench.latitude_deg,
        room_temp_c=plant.room_temp_c,
        chamber_model=plant.chamber,
        delivery_s=plant.delivery_s if clock == "virtual" else 0.02,
        table=file.table,
        chamber=file.chamber,
        gyros=tuple(
            GyroInLab(
                config=gyro,
                model=plant.model_of(gyro, len(file.table.all_axes)),
                unit_seed=unit_seed(gyro.unit),
                mounting=plant.mounting.get(gyro.name),
                mount_azimuth_error_deg=plant.mount_azimuth_error_deg,
                mount_tilt_deg=plant.mount_tilt_deg,
                lean_deg=plant.lean_deg.get(gyro.name, (0.0, 0.0)),
                clock_error_ppm=plant.sample_clock_error_ppm(gyro),
                bearing=plant.bearing.get(gyro.unit),
                on_ground=gyro.name in plant.on_ground,
                errors=plant.errors_of(gyro.unit),
            )
            for gyro in file.gyro
        ),
        rotation=plant.rotation,
        ground=plant.ground,
        imu_error_scale=plant.imu_error_scale,
        faults=plant.fault,
        adapter_batch_s={name: 1e-3 * batch_ms for name, batch_ms in plant.adapter_batch_ms.items()},
        platforms=tuple(
            PlatformInLab(
                config=platform,
                unit_seed=unit_seed(platform.unit),
                effect_dph=plant.heading_effect_dph,
                start_k=plant.platform_start_k,
                modelled=platform.unit in plant.gap_model,
                heading_effect=plant.platform_drift_of(platform.unit),
                accelerometers=plant.accelerometers.get(platform.unit, Accelerometers()),
            )
            for platform in file.platform
        ),
        instruments=tuple(
            InstrumentInLab(role=role, config=section) for role, section in file.all_instruments.values()
        ),
        cpu=cpu,
    )


def _with_ports(
    file: BenchFile, ports: dict[str, str], clock_url: str | None, metadata: dict[str, Any] | None = None
) -> BenchFile:
    gyros = tuple(
        dataclasses.replace(gyro, interface="gyrobench_slcan", channel=ports[gyro.name])
        if gyro.on_can
        else dataclasses.replace(gyro, port=ports[gyro.name])
        for gyro in file.gyro
    )
    return file.model_copy(
        update={
            "bench": file.bench.model_copy(
                update={"clock": clock_url, "emulated": metadata and Emulated(**metadata)}
            ),
            "table": dataclasses.replace(file.table, port=ports["table"]),
            "chamber": dataclasses.replace(file.chamber, port=ports["chamber"]),
            "gyro": gyros,
            "platform": tuple(
                dataclasses.replace(platform, port=ports[platform.name]) for platform in file.platform
            ),
            "instruments": {
                role: tuple(dataclasses.replace(section, port=ports[section.name]) for section in sections)
                for role, sections in file.instruments.items()
            },
        }
    )
