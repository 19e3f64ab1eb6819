"""What an emulated lab is made of, as plain data that crosses to its process as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from simulators.faults import Fault
from simulators.plant.lab_plant import UnitKind

Transport = Literal["pty", "tcp"]


@dataclass(frozen=True)
class DeviceConfig:
    """A polled instrument: driver kind, transport, and what the bench file says of it."""

    driver: str
    transport: Transport
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class GyroConfig:
    """A gyro unit: `settings` as in the bench file; `model` and `unit_seed` say which physics it has.

    `bearing`: what an INS turns in, as in a plant file; None for the one its seed draws.
    `errors`: terms and noise of a fitted model in place of the unit's own errors.
    """

    name: str
    driver: str
    transport: Transport
    settings: dict[str, Any]
    model: UnitKind
    unit_seed: int
    mounting: Literal["axis_horizontal", "axis_up", "z_up"] = "axis_horizontal"
    mount_azimuth_error_deg: float = 0.0
    clock_error_ppm: float = 0.0
    bearing: dict[str, Any] | None = None
    errors: dict[str, Any] | None = None


@dataclass(frozen=True)
class PlatformConfig:
    """A platform INS: `settings` as in the bench file; `unit_seed` draws its physics.

    `effect_dph`: rms over headings of the change of its mean drift; `north_deg`: table angle at heading 0.
    `modelled`: its drift is that of a model, `heading_effect` the model's values (None: it has none).
    """

    name: str
    driver: str
    transport: Transport
    settings: dict[str, Any]
    unit_seed: int
    effect_dph: float = 1e-3
    north_deg: float = 0.0
    modelled: bool = False
    heading_effect: list[float] | None = None


@dataclass(frozen=True)
class LabConfig:
    """A whole lab.

    `rotation`: ripple of the table's rate and errors of its encoder, as in a plant file. `delivery_s`: how often
    adapters hand over streamed bytes. `cpu`: processor that lab and bench share in
    virtual time, None to leave that to the system. `emulated`: seed and model, which a bench is told.
    """

    clock: Literal["virtual", "wall"]
    seed: int
    latitude_deg: float
    room_temp_c: float
    chamber_model: str
    table: DeviceConfig
    chamber: DeviceConfig
    gyros: tuple[GyroConfig, ...]
    faults: tuple[Fault, ...] = ()
    platforms: tuple[PlatformConfig, ...] = ()
    rotation: dict[str, Any] = field(default_factory=dict)
    delivery_s: float = 1.0
    cpu: int | None = None
    emulated: dict[str, Any] | None = None

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> LabConfig:
        """Return the configuration of plain JSON values."""
        return cls(
            **{
                **data,
                "table": DeviceConfig(**data["table"]),
                "chamber": DeviceConfig(**data["chamber"]),
                "gyros": tuple(GyroConfig(**gyro) for gyro in data["gyros"]),
                "faults": tuple(
                    Fault(**{**fault, "at_s": tuple(fault.get("at_s", ()))})
                    for fault in data.get("faults", ())
                ),
                "platforms": tuple(PlatformConfig(**each) for each in data.get("platforms", ())),
            }
        )
