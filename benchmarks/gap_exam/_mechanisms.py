"""What the catalogue calls the effects of folders whose seals do not say so, as the second plant's."""

from __future__ import annotations

NAMES: dict[str, tuple[str, ...]] = {
    "shupe": ("shupe",),
    "grad": ("gradient",),
    "biasT": ("bias_quadratic", "bias_cubic"),
    "cross": ("shupe_cross",),
    "hyst": ("hysteresis",),
    "lagT": ("thermal_lag", "relaxation"),
    "warmup": ("warm_up",),
    "sfT": ("scale_factor_temperature", "scale_factor_quadratic"),
    "sfasym": ("scale_factor_asymmetry",),
    "sfnl": ("scale_factor_nonlinearity",),
    "misal": ("axis_misalignment",),
    "azim": ("azimuth_error",),
    "wobble": ("table_wobble_once", "table_wobble_twice"),
    "ripple": ("table_wobble_once", "table_wobble_twice", "table_rate_ripple"),
    "latency": ("time_offset",),
    "skew": ("clock_skew",),
    "satur": ("saturation",),
    "dead": ("dead_zone", "lock_in"),
    "magn": ("heading_sensitivity", "acceleration_sensitivity"),
    "gsens": ("acceleration_sensitivity",),
    "vib": ("vibration_or_mains_line",),
    "modehop": ("mode_hop",),
    "spike": ("impulses",),
    "arw": ("noise_level",),
    "bi": ("bias_instability",),
    "rrw": ("rate_random_walk",),
    "quant": ("quantisation",),
    "drop": ("lost_frames",),
}
BESIDE: dict[str, tuple[str, ...]] = {
    "misal": ("azimuth_error", "table_tilt"),
    "azim": ("axis_misalignment", "table_tilt"),
}
"""What is no false cause with an effect, as Earth rate on a level axis does not tell them apart."""
CHANGING = ("telegraph", "pressure", "spike")
DISTURBANCES = ("vibration_or_mains_line", "impulses")
"""Reported beside the noise, but causes like others."""
