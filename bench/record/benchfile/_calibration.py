"""`[[calibration]]` of a bench file: what a certificate says of an instrument, and when it is due again."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from drivers.base.errors import ConfigurationError, RecordError

Quantity = Literal[
    "time_base_ppm",
    "table_rate_ppm",
    "table_angle_deg",
    "table_level_deg",
    "table_wobble_deg",
    "azimuth_deg",
    "fixture_deg",
    "fixture_seat_deg",
    "latitude_deg",
    "unit_temp_c",
    "air_temp_c",
    "gravity_mps2",
    "supply_voltage_v",
]
Distribution = Literal["normal", "rectangular", "triangular", "arcsine"]
DIVISORS = {"rectangular": math.sqrt(3.0), "triangular": math.sqrt(6.0), "arcsine": math.sqrt(2.0)}
"""Half width over standard uncertainty (JCGM 100, 4.3.7 and 4.3.9; EA-4/02)."""


class Calibration(BaseModel):
    """What a certificate says of one quantity of the bench, in the unit that the quantity's name ends with."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)

    quantity: Quantity = Field(description=f"what was calibrated: {', '.join(get_args(Quantity))}")
    instrument: str = Field(min_length=1, description="maker, model and serial number, as text")
    certificate: str = Field(min_length=1, description="the number of the certificate, as text")
    issued_by: str = Field(default="", description="who issued it, as text")
    date: datetime.date = Field(strict=False, description="the day of the calibration, as 2026-05-04")
    due: datetime.date = Field(strict=False, description="the last day that it holds, as 2027-05-04")
    error: float = Field(default=0.0, description="what the instrument shows less what is true, a number")
    uncertainty: float = Field(
        gt=0.0, description="expanded uncertainty, or half the width where the distribution is not normal"
    )
    k: float | None = Field(
        default=None, gt=0.0, le=10.0, description="coverage factor of a normal uncertainty, 2 if left out"
    )
    distribution: Distribution = Field(
        default="normal", description=f"one of {', '.join(get_args(Distribution))}"
    )

    @model_validator(mode="after")
    def _agrees(self) -> Calibration:
        if self.due < self.date:
            raise ValueError(f"due on {self.due}, before its date {self.date}")
        if self.k is not None and self.distribution != "normal":
            raise ValueError(f"k goes with a normal distribution; {self.distribution} has a half width")
        return self

    @property
    def standard_uncertainty(self) -> float:
        """U / k, or the half width over the divisor of its distribution."""
        return self.uncertainty / DIVISORS.get(self.distribution, self.k or 2.0)


def require_quantities(names: Iterable[str], where: str) -> None:
    """Raise ConfigurationError for names that are no quantity of a bench."""
    if unknown := sorted(set(names) - set(get_args(Quantity))):
        raise ConfigurationError(
            "no such quantity of a bench",
            where=where,
            found=", ".join(unknown),
            expected=", ".join(get_args(Quantity)),
        )


def overdue(calibrations: Sequence[Calibration], utc: str) -> list[Calibration]:
    """Return those whose last day lies before a moment given as ISO 8601 in UTC."""
    return [item for item in calibrations if item.due.isoformat() < utc[:10]]


def calibrations_of(bench: Mapping[str, Any]) -> tuple[Calibration, ...]:
    """Return the certificates of a bench file kept as plain values, as a manifest has it; none in older runs."""
    try:
        return TypeAdapter(tuple[Calibration, ...]).validate_python(tuple(bench.get("calibration", ())))
    except (TypeError, ValidationError) as error:
        raise RecordError("the run's calibrations cannot be read", found=str(error)) from error
