"""What the terms in a report mean and which standard they come from."""

from __future__ import annotations

STABILITY = (
    "Bias stability",
    "Sample standard deviation (n − 1) of the means of consecutive, non-overlapping 100 s stretches of "
    "the gyro's output, after GJB 2426A; taken here from the equilibrium before the shock to the end, "
    "shock, soak and recovery included. It is not the bias instability of IEEE Std 952, which is the "
    "flicker-noise coefficient read from the flat part of an Allan deviation.",
)
IMPROVEMENT = ("Improvement", "100 % × (1 − bias stability after / bias stability before compensation).")
ATTAINABLE = (
    "Attainable improvement",
    "The improvement that subtracting the true thermal drift would give. The rest is noise that no "
    "model of temperature can remove. The truth is known for emulated units only; elsewhere a dash is "
    "shown.",
)
FLOOR = (
    "Noise floor",
    "Standard deviation of 100 s means without any drift. For white noise alone it is 6 × N, with N the "
    "angle random walk in °/√h (IEEE Std 952); bias instability adds to it.",
)
PEAK = ("Peak", "Largest absolute 100 s mean of what is left after compensation.")
SCALE_FACTOR = (
    "Scale-factor error",
    "Change of the scale factor against its mean over the equilibrium before the shock, in parts per "
    "million. Scale factor: least-squares slope of output over input rate (IEEE Std 952), here at every "
    "point in time over runs at positive, negative and zero rate that went through the same "
    "temperatures.",
)
HELD_OUT = ("Held-out run", "A run that had no part in fitting or choosing a model.")
LOST = (
    "Frames lost, rejected",
    "Lost: missing by the gyro's own frame counter, other than while the procedure had it switched off. "
    "Rejected: arrived with a wrong checksum, length or format. Neither is filled in.",
)
CLOCK = (
    "Clock error",
    "Rate of the gyro's own clock against the bench's, from its frame counter fitted to the times of "
    "arrival.",
)
STANDARD_BIAS = (
    ("Bias stability", "1σ of averages over the stated time (GJB 2426A); not the bias instability."),
    (
        "Bias instability",
        "Flicker coefficient B; the flat part of the Allan deviation is 0.664 B (IEEE Std 952).",
    ),
)
"""The terms of bias as the reports of standard tests have them."""
