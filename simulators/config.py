"""What an emulated lab is made of: the message that starts one; parts of it are sections of a plant file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.kit.registry import AnyChamber, AnyGyro, AnyPlatform, AnyTable
from simulators.faults import Fault

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Pair = tuple[_Finite, _Finite]
_Line = tuple[_Finite, _Finite, _Finite]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Rotation(_Part):
    """The table's motion and its encoder.

    Ripple is the peak change of the rate, 1e-6 of it, once and twice a turn (50,000 is 5 %); the encoder has
    white noise and a ripple of so many lines a turn beside the eccentricity that every emulated table has.
    """

    ripple_once_ppm: float = Field(default=5.0, ge=0, le=2e5)
    ripple_twice_ppm: float = Field(default=2.0, ge=0, le=2e5)
    encoder_noise_arcsec: float = Field(default=0.0, ge=0, le=3600)
    encoder_ripple_arcsec: float = Field(default=0.0, ge=0, le=3600)
    encoder_ripple_lines: int = Field(default=36, ge=1, le=1_000_000)


class Bearing(_Part):
    """The bearing that a unit of the model `ins_triad` turns in (simulators.plant.wobble).

    `lines_arcsec`: [m, x, y] each, a tilt of the unit about its x and y axes by x + jy turning m times a turn
    in body axes; none at all is a perfect bearing. `play_arcsec`: tilt added after a reversal, over
    `play_travel_deg`. `misalignment_arcsec`: angles of the sensors' x and y axes towards z.
    """

    lines_arcsec: tuple[_Line, ...]
    play_arcsec: _Pair = (0.0, 0.0)
    play_travel_deg: float = Field(default=0.5, gt=0, le=90)
    misalignment_arcsec: _Pair = (0.0, 0.0)


class GyroInLab(_Part):
    """A gyro unit: its section of the bench file, and which physics it has.

    `bearing`: what an INS turns in; None for the one its seed draws. `errors`: terms and noise of a fitted model
    in place of the unit's own errors.
    """

    config: AnyGyro
    model: str
    unit_seed: int
    mounting: Literal["axis_horizontal", "axis_up", "z_up"] = "axis_horizontal"
    mount_azimuth_error_deg: float = 0.0
    clock_error_ppm: float = 0.0
    bearing: Bearing | None = None
    errors: dict[str, Any] | None = None


class PlatformInLab(_Part):
    """A platform INS: its section of the bench file; `unit_seed` draws its physics.

    `effect_dph`: rms over headings of the change of its mean drift; `north_deg`: table angle at heading 0.
    `modelled`: its drift is that of a model, `heading_effect` the model's values (None: it has none).
    """

    config: AnyPlatform
    unit_seed: int
    effect_dph: float = 1e-3
    north_deg: float = 0.0
    modelled: bool = False
    heading_effect: list[float] | None = None


class LabConfig(_Part):
    """A whole lab.

    `delivery_s`: how often adapters hand over streamed bytes. `cpu`: processor that lab and bench share in
    virtual time, None to leave that to the system. `emulated`: seed and model, which a bench is told.
    """

    clock: Literal["virtual", "wall"]
    seed: int
    latitude_deg: float
    room_temp_c: float
    chamber_model: str
    table: AnyTable
    chamber: AnyChamber
    gyros: tuple[GyroInLab, ...]
    platforms: tuple[PlatformInLab, ...] = ()
    faults: tuple[Fault, ...] = ()
    rotation: Rotation = Rotation()
    delivery_s: float = 1.0
    cpu: int | None = None
    emulated: dict[str, Any] | None = None
