"""Stochastic effects: each raises one coefficient of the noise model, or loses samples."""

from __future__ import annotations

from simulators.effects._effect import DPH, NoiseEffect, Parameter, Unit

_SHARE = Unit("share")

NOISE_EFFECTS = (
    NoiseEffect(
        "noise_level",
        Parameter("arw_deg_per_sqrt_h", 0.0, 10.0, Unit("deg/sqrt(h)")),
        "IEEE Std 952, angle random walk",
        "White rate noise is higher than the model says.",
    ),
    NoiseEffect(
        "bias_instability",
        Parameter("bias_instability_dph", 0.0, 100.0, DPH),
        "IEEE Std 952, bias instability (flicker)",
        "Bias wanders with equal power per octave of time.",
    ),
    NoiseEffect(
        "rate_random_walk",
        Parameter("rate_random_walk_dph_per_sqrt_h", 0.0, 100.0, DPH.per("sqrt(h)")),
        "IEEE Std 952, rate random walk",
        "Bias walks randomly, further the longer one waits.",
    ),
    NoiseEffect(
        "quantisation",
        Parameter("quantum_arcsec", 0.0, 1000.0, Unit("arcsec")),
        "IEEE Std 952, quantisation noise",
        "The angle is read in steps; the rate is noisy at short times only.",
    ),
    NoiseEffect(
        "lost_frames",
        Parameter("lost_fraction", 0.0, 1.0, _SHARE),
        "device's own frame counter",
        "Frames of the gyro's stream do not arrive.",
    ),
    NoiseEffect(
        "arrival_jitter",
        Parameter("jitter_ms", 0.0, 1e4, Unit("ms")),
        "arrival times of the stream",
        "Frames arrive at uneven times; samples stamped on arrival would be as uneven.",
        "time_stamps",
    ),
    NoiseEffect(
        "late_frames",
        Parameter("late_fraction", 0.0, 1.0, _SHARE),
        "arrival times of the stream",
        "Frames arrive a twentieth of a second late and more, in blocks.",
        "time_stamps",
    ),
)
