"""A spring-restrained rate gyro of aircraft autopilots in an overhaul company's workshop.

A synchronous motor spins the rotor, a torsion bar restrains the gimbal, silicone oil damps it, an E-I pick-off
reads it; a voltage-to-frequency converter behind the demodulator counts rate in gates of half a second. Values
as of data sheets of the kind: full scale 30 deg/s, threshold 0.01 deg/s, linearity 0.5 %.
"""

from __future__ import annotations

from benchmarks.gap_exam._family import Family, Layout, Sheet
from benchmarks.gap_exam._spring_bench import campaign, read, rows
from benchmarks.gap_exam._spring_effects import EFFECTS, LATITUDE_DEG

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.12,
    bias_instability_dph=2.5,
    rate_random_walk_dph_per_sqrt_h=5.0,
    quantum_arcsec=3.0,
    sf_sigma_ppm=3000.0,
    slope_sigma_dph=60.0,
    turn_on_sigma_dph=30.0,
)
NOISY = {
    "rotor_bearings": (1.6, 3.0, "noise_level"),
    "flex_wander": (3.0, 8.0, "rate_random_walk"),
    "coarse_counter": (4.0, 10.0, "quantisation"),
}
"""Worn rotor bearings, a flex pivot that works loose, a converter set to a coarse pulse."""

SPRING = Family(
    "spring_restrained",
    LATITUDE_DEG,
    SHEET,
    Layout(".csv", ("rate_dps", "deg/s"), ("table_deg", "deg"), clock="1996-03-04T07:30:00"),
    EFFECTS,
    NOISY,
    campaign,
    rows,
    read,
)
