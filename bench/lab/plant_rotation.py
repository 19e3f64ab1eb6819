"""What a plant file says of turning: `[rotation]` for the table, `[bearing.<unit>]` for what an INS turns in."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Pair = tuple[_Finite, _Finite]
_Line = tuple[_Finite, _Finite, _Finite]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RotationPlant(_Part):
    """The table's motion and its encoder.

    Ripple is the peak change of the rate, 1e-6 of it, once and twice a turn (50,000 is 5 %); the encoder has
    white noise and a ripple of so many lines a turn beside the eccentricity that every emulated table has.
    """

    ripple_once_ppm: float = Field(default=5.0, ge=0, le=2e5)
    ripple_twice_ppm: float = Field(default=2.0, ge=0, le=2e5)
    encoder_noise_arcsec: float = Field(default=0.0, ge=0, le=3600)
    encoder_ripple_arcsec: float = Field(default=0.0, ge=0, le=3600)
    encoder_ripple_lines: int = Field(default=36, ge=1, le=1_000_000)


class BearingPlant(_Part):
    """The bearing that a unit of the model `ins_triad` turns in (simulators.plant.wobble).

    `lines_arcsec`: [m, x, y] each, a tilt of the unit about its x and y axes by x + jy turning m times a turn
    in body axes; none at all is a perfect bearing. `play_arcsec`: tilt added after a reversal, over
    `play_travel_deg`. `misalignment_arcsec`: angles of the sensors' x and y axes towards z.
    """

    lines_arcsec: tuple[_Line, ...]
    play_arcsec: _Pair = (0.0, 0.0)
    play_travel_deg: float = Field(default=0.5, gt=0, le=90)
    misalignment_arcsec: _Pair = (0.0, 0.0)
