"""What is said beside a finding in the rate: what it rests on, and what else it may be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.analysis.gap._data import SIGMA_OF_SECOND_DIFFERENCES, GapRun, unseen
from bench.analysis.gap._findings import Cause
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._prepare import Prepared
from bench.analysis.gap._stochastic import DATA_SHEET
from simulators.effects import Input

_LONG_S = 3600.0
_DENIED = 3.0
"""Deviations that the model states from which on a parameter that was fitted again is another one."""


def of_noise(model: Model, runs: Sequence[GapRun]) -> list[str]:
    """Say which white noise logs without finer rows show by themselves, beside the model's."""
    if any(run.fast for run in runs):
        return []  # the rows say it
    arws = [white_arw(run) for run in runs]
    return [
        f"white noise from sample to sample is as of {float(np.median(arws)):.3g} deg/sqrt(h), "
        f"the model has {model.noise.arw_deg_per_sqrt_h:.3g}"
    ]


def white_arw(run: GapRun) -> float:
    """Return the angle random walk, deg/sqrt(h), that the median second difference of a run's samples shows."""
    left = run.output_dph - run.stimulus.input_rate_dph
    sigma_dph = float(np.nanmedian(np.abs(np.diff(left, 2)))) * SIGMA_OF_SECOND_DIFFERENCES
    return sigma_dph * math.sqrt(run.stimulus.period_s) / 60.0


def of_codes(causes: Sequence[Cause[Term]], below: bool, runs: Sequence[GapRun]) -> list[str]:
    """Say what turns the output by less than a code of the table's angle: causes not named, and the rest."""
    if not causes and not below:
        return []
    names = ", ".join([*(cause.name for cause in causes), *(["what else is left"] if below else [])])
    return [
        f"no gap that these runs show: {names}; it turns the output by less than "
        f"{max(run.code_arcsec for run in runs):.2g} arcsec, the step in which the table's angle is logged"
    ]


def of_time(causes: Sequence[Cause[Term]], runs: Sequence[GapRun]) -> list[str]:
    """Say what a cause that follows the time since power-on is where nobody told that time."""
    names = [cause.name for cause in causes if Input.TIME in cause.term.effect.inputs]
    if not names or all(run.power_on_told for run in runs):
        return []
    return [
        "when the unit was switched on is not told (power_on_s in the mapping): "
        f"{' and '.join(names)} may be any drift that settles"
    ]


def of_same(model: Model, runs: Sequence[GapRun]) -> list[str]:
    """Say on what a further effect rests that is sought in the runs that a model was fitted on."""
    same = [run.run_id for run in runs if model.fitted_on.get(run.run_id) == run.checksum]
    if not same:
        return []
    return [
        f"the model was fitted on {', '.join(same)}: what is found beside its terms rests on the same recording, "
        "and is what these left of it; judge it on another (--held-out)"
    ]


def of_nominal(model: Model, fitted: Model) -> list[str]:
    """Say which parameters of the nominal model these runs deny: what it says of them is off by far.

    They are fitted again within what the model says of them, so that they are no gap; 3 of its deviations are.
    """
    said = []
    for told, found in zip(model.terms, fitted.terms, strict=True):
        for parameter, before, sigma, now in zip(
            told.effect.parameters, told.values, told.sigmas, found.values, strict=True
        ):
            if abs(now - before) > _DENIED * sigma:
                said.append(
                    f"the nominal model is wrong: {told.name}, {parameter.name} is {now:.4g} in these runs, not "
                    f"{before:.4g} +- {sigma:.2g}; correct it, or say how far it may be off (sigma)"
                )
    return said


def of_floor(data: Prepared) -> list[str]:
    """Say what the noise floor rests on, and what runs as short or as alike as these cannot show."""
    notes = []
    if not data.floor.from_repeats:
        notes.append("no repeated runs: the noise floor rests on " + data.noise.source)
    if data.noise.source == DATA_SHEET:
        notes.append("no repeats and no quiet run: a wrong data sheet would look like a gap")
    runs = [run for group in data.groups for run in group.flat]
    hidden = {text for run in runs if (text := unseen(run.stimulus))}
    notes += sorted(hidden)
    if not hidden and all(np.ptp(run.stimulus.warm_k) < 2.0 for run in runs):
        notes.append("temperature hardly changes in these runs: no effect of temperature can be seen")
    longest = max(len(each.runs[0][0].stimulus) * each.runs[0][0].stimulus.period_s for each in data.groups)
    if longest < _LONG_S:
        notes.append(
            f"the longest run has {longest:.0f} s: what takes longer than {longest / 2.0:.0f} s (thermal lags, "
            "relaxation, bias instability) is not told from the run's own bias"
        )
    return notes
