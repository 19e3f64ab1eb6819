"""Effects on the drift of a platform that keeps its attitude in inertial space, over heading and temperature."""

from __future__ import annotations

from simulators.effects._channel import ChannelEffect
from simulators.effects._effect import DPH, Parameter, Unit

_GAINS = tuple(
    Parameter(f"{axis}{term}_dph_per_k", -1.0, 1.0, DPH.per("K"))
    for axis in "xyz"
    for term in ("", "_cos", "_sin")
)
PLATFORM_EFFECTS = (
    ChannelEffect(
        "heading_effect",
        "platform_drift",
        (*_GAINS, Parameter("core_lag_h", 0.1, 48.0, Unit("h"))),
        (*(0.0,) * 9, 6.0),
        "change of the platform's temperature against the reference heading, times gravity's turn in its axes",
        "temperature change after a lag, and its cos and sin over the sidereal angle: nine gains",
        "The platform's temperature changes with heading, and its gyros drift with it where gravity pulls.",
        emulated_by="platform",
    ),
    ChannelEffect(
        "heading_steps",
        "platform_drift",
        (Parameter("step_rms_dph", 0.0, 1.0, DPH),),
        (0.0,),
        "heading itself",
        "friction of bearings, cables, magnetic field",
        "The platform's drift steps with heading and does not follow its temperature.",
    ),
)
