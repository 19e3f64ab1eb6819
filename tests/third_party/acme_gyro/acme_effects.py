"""An effect that the catalogue lacks, for the diagnosis and for nominal models: bias that follows sin of T_in."""

import numpy as np

from simulators.effects import Effect, Parameter

EFFECTS = (
    Effect(
        "acme_etalon",
        (Parameter("bias_dph", -10.0, 10.0),),
        lambda s, shape: np.sin(2.0 * np.pi * s.warm_k / shape["period_k"])[None, :],
        "sine of T_in",
        "acme, application note 12",
        "An etalon in the coupler lets bias swing with temperature.",
        ({"period_k": 7.0}, {"period_k": 12.0}),
    ),
)
