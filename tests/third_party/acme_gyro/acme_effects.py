"""Effects that the catalogue lacks, for the diagnosis and for nominal models: of the bias, and of a sensor."""

import numpy as np

from simulators.effects import DPH, ChannelEffect, Effect, Input, Parameter, Unit

EFFECTS = (
    Effect(
        "acme_etalon",
        (Parameter("bias_dph", -10.0, 10.0, DPH),),
        lambda s, shape: np.sin(2.0 * np.pi * s.warm_k / shape["period_k"]),
        Input.T_IN,
        "sine of T_in",
        "acme, application note 12",
        "An etalon in the coupler lets bias swing with temperature.",
        ({"period_k": 7.0}, {"period_k": 12.0}),
    ),
    ChannelEffect(
        "acme_thermistor",
        "gyro_temperature",
        (Parameter("curvature_k", -10.0, 10.0, Unit("K")),),
        (0.0,),
        "square of the gyro's temperature over 25 degC",
        "acme, application note 13",
        "The thermistor was read with the curve of another type.",
        apply=lambda inputs, signal, values: signal + values[0] * ((signal - 25.0) / 50.0) ** 2,
    ),
)
