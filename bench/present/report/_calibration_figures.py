"""The figures of a calibration's report: sigmas and estimates over a run, each state by position."""

from __future__ import annotations

import numpy as np

from bench.present.report._calibration_content import CalibrationContent, calibration_model
from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._heat_map import gain_map
from bench.present.report._page import Block, Figures, Key
from bench.present.report._palette import BLUE, FLOOR, GREEN, MUTED, ORANGE, PURPLE, SAND

_PAINTS = (BLUE, ORANGE, GREEN, PURPLE, SAND, MUTED)
_FULL_DECADES = 3.0
_REACH = 4.0
"""Estimates over time are drawn to so many targets."""
_LANES = {
    "Gyro bias": "eps_x eps_y eps_z",
    "Acc. bias": "nabla_x nabla_y nabla_z",
    "K_g, scale": "Kg_xx Kg_yy Kg_zz",
    "K_g, angles": "Kg_yx Kg_zx Kg_xy Kg_zy Kg_xz Kg_yz",
    "K_a, scale": "Ka_xx Ka_yy Ka_zz",
    "K_a, angles": "Ka_yx Ka_zx Ka_zy",
    "K_2": "K2_x K2_y K2_z",
}
"""The states that are drawn together."""


def convergence(content: CalibrationContent) -> Block:
    position = np.arange(1.0, len(content.course) + 1.0)
    ratio = np.log10(content.course / content.target)
    by_name = dict(zip(calibration_model().STATE_NAMES, ratio.T, strict=True))
    plots = []
    for title, states in _LANES.items():
        curves = [
            Curve(state, position, by_name[state], paint)
            for state, paint in zip(states.split(), _PAINTS, strict=False)
        ]
        curves.append(Curve("target", position, np.zeros(len(position)), MUTED, "--", 1.0))
        plots.append(Lane(title, curves, height=105.0))
    caption = (
        "Decimal logarithm of sigma over target after each dwell; below the broken line the target is "
        "reached."
    )
    about = "Sigma over target after each position"
    return lanes("convergence", plots, "Position", caption, description=about)


def estimates_over_time(content: CalibrationContent) -> list[Block]:
    """Return every estimate with two of its sigma after each rest, about the truth or the last estimate."""
    estimate = content.estimate
    if estimate is None:
        return []
    model = calibration_model()
    target = content.evaluation.task.target_sigma
    about = estimate.parameters if content.truth is None else content.truth
    minutes = estimate.course_s / 60.0
    off, spread = ((part / target).T for part in (estimate.course_parameters - about, 2.0 * estimate.course))
    plots = [
        Panel(
            [
                Curve("estimate", minutes, np.clip(off[number], -_REACH, _REACH), BLUE),
                Curve(
                    "two sigma", minutes, np.clip(off[number] + spread[number], -_REACH, _REACH), MUTED, "--"
                ),
                Curve(
                    "two sigma", minutes, np.clip(off[number] - spread[number], -_REACH, _REACH), MUTED, "--"
                ),
            ],
            f"{name}, target {target[number] / model.UNIT_SIZE[6 + number]:g} {model.STATE_UNITS[6 + number]}",
            floor=1.0,
            description=f"estimate of {name} and its sigma over time",
        )
        for number, name in enumerate(model.PARAMETER_NAMES)
    ]
    of = "last estimate" if content.truth is None else "truth"
    caption = (
        f"Estimates less the {of}, in targets, after each rest, and two sigma on both sides; shaded: one target. "
        f"What is beyond {_REACH:g} targets lies on the border."
    )
    keys = [Key("estimate", BLUE), Key("two sigma", MUTED), Key("one target", FLOOR, "band")]
    y_label = f"less the {of}, targets"
    return [panels("estimates", plots, caption, keys, x_label="time, min", y_label=y_label)]


def heat_map(content: CalibrationContent) -> Block:
    caption = (
        "How far each state is known after each dwell: empty as its prior, full a thousand times better. "
        "Above: the body axis that points up."
    )
    decades = np.clip(np.log10(content.prior / content.course) / _FULL_DECADES, 0.0, 1.0)
    up_axes, about = content.evaluation.schedule.up_axes(), "Gain of every state after every position"
    return Figures([gain_map("heat-map", calibration_model().STATE_NAMES, up_axes, decades, about)], caption)
