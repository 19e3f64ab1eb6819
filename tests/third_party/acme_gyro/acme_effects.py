"""What the catalogue lacks: effects of bias, angle and rate, a disturbance, an effect of a temperature sensor."""

import math

import numpy as np

from simulators.effects import (
    DPH,
    ChannelEffect,
    Disturbance,
    Effect,
    Finding,
    Input,
    Parameter,
    Unit,
)

EVERY_S, LASTS_S = 100.0, 10.0


def kinks(rates):
    """A knee is looked for where the unit was turned faster than 40 deg/s."""
    fast = len(rates.rate) and np.abs(rates.rate).max() > 40.0 * 3600.0
    return tuple({"knee_dps": knee} for knee in (20.0, 30.0)) if fast else ()


def beyond_knee(s, shape):
    rate = s.input_rate_dph
    return 1e-6 * np.sign(rate) * np.maximum(np.abs(rate) - 3600.0 * shape["knee_dps"], 0.0)


def under_test_s(time_s):
    """Time of self-test until a time since power-on."""
    return LASTS_S * np.floor(time_s / EVERY_S) + np.minimum(np.mod(time_s, EVERY_S), LASTS_S)


def find_self_test(records):
    """Least squares of output less model against the part of each sample that is under test."""
    parts, rests = [], []
    for record in records:
        s = record.stimulus
        part = (under_test_s(s.time_s) - under_test_s(s.time_s - s.period_s)) / s.period_s
        rest = record.output_dph - record.predict(s)
        parts.append(part - part.mean())
        rests.append(np.nan_to_num(rest - np.nanmean(rest)))
    part, rest = np.concatenate(parts), np.concatenate(rests)
    size = float(part @ rest / (part @ part))
    sigma = float(np.std(rest - size * part) / np.sqrt(part @ part))
    if abs(size) < 8.0 * sigma:
        return None
    outputs = tuple(record.output_dph - size * own for record, own in zip(records, parts, strict=True))
    return Finding((size,), (sigma,), f"{size:.3g} deg/h for 10 s of every 100 s; taken out", outputs)


def self_test(values, draws):
    """The increments that a self-test adds, rad: one deg/h for one second is one arcsecond."""
    size_rad_s = math.radians(values[0] / 3600.0)
    return lambda path: size_rad_s * np.diff(under_test_s(path.edges_s))


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
    Effect(
        "acme_gear",
        tuple(Parameter(f"bias_dph_{part}", -10.0, 10.0, DPH) for part in ("cos", "sin")),
        lambda s, shape: s.harmonic(5),
        Input.ANGLE,
        "table angle, five times a turn",
        "acme, application note 14",
        "A gear of five teeth shakes the unit.",
    ),
    Effect(
        "acme_knee",
        (Parameter("beyond_ppm", -1e5, 1e5, Unit("ppm")),),
        beyond_knee,
        Input.RATE,
        "rate beyond a knee",
        "acme, application note 15",
        "The output has another slope beyond a rate.",
        ({"knee_dps": 20.0},),
        propose=kinks,
    ),
    Disturbance(
        "acme_self_test",
        (Parameter("offset_dph", -100.0, 100.0, DPH),),
        "acme, application note 16",
        "The unit tests itself, and its output is off so long.",
        find_self_test,
        self_test,
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
