"""What is known of the errors of a bench: of its certificates, or assumed of a class and named so."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.analysis.common.uncertainty import Contribution
from bench.record.benchfile import Calibration

ASSUMED: Mapping[str, float] = {
    "time_base_ppm": 50.0,
    "table_rate_ppm": 10.0,
    "table_angle_deg": 0.003,
    "table_level_deg": 0.02,
    "table_wobble_deg": 0.003,
    "azimuth_deg": 2.0,
    "fixture_deg": 0.05,
    "fixture_seat_deg": 0.005,
    "latitude_deg": 0.01,
    "unit_temp_c": 1.0,
    "air_temp_c": 0.5,
    "gravity_mps2": 1e-3,
}
"""Half widths of a rectangular distribution that a bench without a certificate is taken to have: a free quartz, a
servo rate table with its encoder (10 arcsec), a spirit level, the axis set to east by hand, a milled fixture, a
seat that takes a unit again within 20 arcsec, a platinum resistor of class B at -40 degC (IEC 60751), normal
gravity of the latitude (anomalies of 100 mGal)."""
ASSUMED_ORIGIN = "assumed"
EAST_ORIGIN = "Earth rate"
_UNITS = {"c": "degC", "mps2": "m/s2"}
"""Last word of a quantity's name -> its unit, where they differ."""


@dataclass(frozen=True)
class BenchErrors:
    """What is known of the errors of a bench: certificates, and how well the Earth rate told the azimuth."""

    calibrations: Sequence[Calibration] = ()
    azimuth_sigma_deg: float | None = None

    def of(
        self, quantity: str, sensitivity: float, *, difference: bool = False, signed: bool = True
    ) -> Contribution:
        """Return a quantity as an input; of a `difference` of two readings a common error drops out.

        Where the sign of the sensitivity is not known, a known error counts as uncertainty (JCGM 100, F.2.4.5).
        """
        word = quantity.rsplit("_", 1)[1]
        unit = _UNITS.get(word, word)
        if quantity == "azimuth_deg" and self.azimuth_sigma_deg is not None:
            return Contribution(
                quantity, self.azimuth_sigma_deg, sensitivity, unit, 0.0, "A", origin=EAST_ORIGIN
            )
        known = next((item for item in self.calibrations if item.quantity == quantity), None)
        standard, error, shape, origin = (
            ASSUMED[quantity] / math.sqrt(3.0),
            0.0,
            "rectangular",
            ASSUMED_ORIGIN,
        )
        if known is not None:
            standard, error = known.standard_uncertainty, known.error
            shape, origin = known.distribution, known.certificate
        if difference:
            standard, error, shape = math.sqrt(2.0) * standard, 0.0, "normal"
        if not signed:
            standard, error = math.hypot(standard, error), 0.0
        return Contribution(quantity, standard, sensitivity, unit, error, distribution=shape, origin=origin)
