"""What comes into a gyro's record whatever is done to the gyro: found in the record itself, before any fit."""

from __future__ import annotations

from simulators.effects._effect import DPH, Disturbance, Parameter, Unit

DISTURBANCES = (
    Disturbance(
        "impulses",
        (
            Parameter("impulses_per_h", 0.0, 3600.0, Unit("1/h")),
            Parameter("impulse_arcsec", 0.0, 1e5, Unit("arcsec")),
        ),
        "outliers of single samples against their neighbours",
        "Now and then a sample or two stand far off their neighbours: shocks, lost counts, interference.",
    ),
    Disturbance(
        "vibration_or_mains_line",
        (Parameter("amplitude_dph", 0.0, 1e6, DPH), Parameter("frequency_hz", 0.0, 1e4, Unit("Hz"))),
        "IEEE Std 952, sinusoidal noise",
        "A steady line of one frequency, as of vibration or mains, seen at its alias where samples are slow.",
    ),
)
