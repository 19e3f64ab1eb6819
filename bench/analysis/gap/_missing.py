"""What a nominal model lacks as an FMU: the terms of a closed model, run step by step as a lab runs them."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.fmu import write_fmu
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._simulation import take_own
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import (
    PPM,
    REFERENCE_C,
    Causal,
    Effect,
    Input,
    Stimulus,
    Variant,
    catalogue,
    effect_named,
    own_file,
)

_ROUNDING_S = 1e-6
_INPUTS = {
    "rate_dps": (0.0, "true rate along the sensitive axis, the Earth's included, deg/s, mean of the step"),
    "table_rate_dps": (0.0, "rate of the table, deg/s, mean of the step"),
    "table_angle_deg": (0.0, "angle of the table in the middle of the step, turns counted, deg"),
    "elevation_deg": (90.0, "sensitive axis above the horizon, deg"),
    "t_in_c": (REFERENCE_C, "temperature of the gyro, degC, at the begin of the step"),
    "t_out_c": (REFERENCE_C, "temperature of its case, degC, at the begin of the step"),
}
_SMOOTHING = (0.0, "temperatures are means over so many seconds before; 60 for recorded ones with noise, s")
_LATITUDE = "latitude of the place, deg"
_OF_TEMPERATURE = {
    "t_in_c": Input.T_IN | Input.WARMING | Input.GRADIENT,
    "t_out_c": Input.T_OUT | Input.GRADIENT,
}


def write_missing_fmu(closed: Model, nominal: Model, runs: Sequence[GapRun], file: Path) -> None:
    """Write what a closed model adds to the nominal one as an FMU, output `missing_dph`.

    Its inputs are those of `INPUTS` that the missing terms follow; the place is that of the first of `runs`.
    Effects of a user's own file go with it.
    ConfigurationError if no term of the gyro's rate is missing, for one that knows more than the past, for a
    file that cannot be written, and without PythonFMU.
    """
    terms = missing_terms(closed, nominal)
    own = sorted({path for path in (own_file(term["effect"]) for term in terms) if path is not None})
    latitude_deg = runs[0].stimulus.latitude_deg if runs else 0.0
    given = {"terms": terms, "latitude_deg": latitude_deg, "own": [path.name for path in own]}
    names = ", ".join(dict.fromkeys(str(term["effect"]) for term in terms))
    write_fmu(file, MissingTerms, given, f"What the model {nominal.name} lacks: {names}.", own)


def missing_terms(closed: Model, nominal: Model) -> list[dict[str, Any]]:
    """Return what the terms of one model add to another's, as plain JSON values: effect, values, shape.

    ConfigurationError if that is nothing.
    """
    totals: dict[tuple[str, tuple[tuple[str, float], ...]], Array] = {}
    for model, sign in ((closed, 1.0), (nominal, -1.0)):
        for term in model.terms:
            key = term.name, tuple(term.variant.shape.items())  # their order counts
            totals[key] = totals.get(key, np.zeros(len(term.values))) + sign * np.asarray(term.values)
    found = [
        {"effect": name, "values": values.tolist(), "shape": dict(shape)}
        for (name, shape), values in totals.items()
        if values.any()
    ]
    if not found:
        others = [term.name for term in closed.disturbances]
        others += [term.name for term in closed.channel_terms]
        raise ConfigurationError(
            "nothing is missing that an FMU could add to the rate",
            where=closed.name,
            found=", ".join(others) or "noise",
            expected="a term that follows temperatures, time, rate, angle or attitude",
            remedy="close without --fmu: the model file then has what is missing",
        )
    return found


class MissingTerms:
    """Missing terms at work (`bench.analysis.common.fmu.Stepped`).

    Terms of temperatures and time go on once a second; between two steps temperatures are taken as straight.
    Time counts from power-on, which is where the simulation starts. ConfigurationError for a term that no plant
    can have, or whose effect there is not.
    """

    outputs: Mapping[str, tuple[float, str]] = {"missing_dph": (0.0, "what the output lacks, deg/h")}
    step_s = 1.0
    any_step = True

    def __init__(self, given: Mapping[str, Any], folder: Path) -> None:
        for name in given["own"]:
            if any(term["effect"] not in catalogue() for term in given["terms"]):
                take_own(folder / name)
        terms = [(_variant(term), tuple(map(float, term["values"]))) for term in given["terms"]]
        _check_causal([variant for variant, _ in terms])
        self._slow = [(variant, variant.stepper(values)) for variant, values in _of(terms, Causal.TICK)]
        self._by_rate, self._by_sample = _of(terms, Causal.RATE), _of(terms, Causal.SAMPLE)
        wanted = _wanted([variant for variant, _ in terms])
        self.inputs: Mapping[str, tuple[float, str]] = {name: _INPUTS[name] for name in wanted}
        parameters = {"smoothing_s": _SMOOTHING} if {"t_in_c", "t_out_c"} & set(wanted) else {}
        if self._by_sample:
            parameters["latitude_deg"] = (float(given["latitude_deg"]), _LATITUDE)
        self.parameters: Mapping[str, tuple[float, str]] = parameters
        self._begin_s: float | None = None
        self._before = (0.0, np.full(2, REFERENCE_C))
        self._seconds = 0
        self._last: deque[Array] = deque()
        self._bias_dph = self._scale_ppm = 0.0

    def step(self, time_s: float, step_s: float, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the mean over the step of what is missing, deg/h."""
        if self._begin_s is None:
            self._begin_s = time_s
        self._follow(time_s - self._begin_s, values)
        rate_dph = DPH_PER_DPS * values.get("rate_dps", 0.0)
        total = self._bias_dph + 1e-6 * self._scale_ppm * rate_dph
        for variant, own in self._by_rate:
            total += float(variant.response_dph(own, np.array([rate_dph]))[0])
        if self._by_sample:
            stimulus = _sample(time_s - self._begin_s + step_s, step_s, values)
            total += sum(float(np.asarray(own) @ one.columns(stimulus)[:, 0]) for one, own in self._by_sample)
        return {"missing_dph": total}

    def _follow(self, now_s: float, values: Mapping[str, float]) -> None:
        """Do the seconds up to now; temperatures have gone straight from those of the step before."""
        now = np.array([values.get(name, REFERENCE_C) for name in _OF_TEMPERATURE])
        before_s, before = self._before
        window = max(1, round(values.get("smoothing_s", 0.0)))
        while self._seconds <= now_s + _ROUNDING_S:
            part = (self._seconds - before_s) / (now_s - before_s) if now_s > before_s else 1.0
            self._last.append(before + min(part, 1.0) * (now - before))
            while len(self._last) > window:
                self._last.popleft()
            t_in_c, t_out_c = np.mean(self._last, axis=0).tolist() if window > 1 else self._last[-1].tolist()
            added = [(variant.effect.unit == PPM, step(t_in_c, t_out_c)) for variant, step in self._slow]
            self._scale_ppm = sum(value for is_scale, value in added if is_scale)
            self._bias_dph = sum(value for is_scale, value in added if not is_scale)
            self._seconds += 1
        self._before = now_s, now


def _variant(term: Mapping[str, Any]) -> Variant:
    effect = effect_named(str(term["effect"]), term["shape"])
    if not isinstance(effect, Effect):
        raise ConfigurationError(
            "the catalogue lacks an effect of this FMU",
            where="effects installed here",
            found=str(term["effect"]),
            expected="the package that brings the effect, installed where the FMU runs",
        )
    return Variant(effect, dict(term["shape"]))


def _of(
    terms: list[tuple[Variant, tuple[float, ...]]], causal: Causal
) -> list[tuple[Variant, tuple[float, ...]]]:
    return [term for term in terms if term[0].effect.causal is causal]


def _check_causal(variants: list[Variant]) -> None:
    """Raise ConfigurationError for terms that need more than a plant can have, all of them by name."""
    names = [variant.effect.name for variant in variants if not _is_causal(variant.effect)]
    if names:
        raise ConfigurationError(
            "a step-by-step simulation cannot have these terms",
            where="the FMU",
            found=", ".join(dict.fromkeys(names)),
            expected="terms of temperatures and time alone, or of rate, angle and attitude alone",
            remedy="close without --fmu and take what is missing from the columns (`missing_dph`)",
        )


def _is_causal(effect: Effect) -> bool:
    try:
        return effect.causal in Causal
    except ConfigurationError:
        return False


def _wanted(variants: list[Variant]) -> list[str]:
    """Return the names of the inputs that variants follow."""
    wanted = set()
    for effect in (variant.effect for variant in variants):
        if effect.causal is Causal.SAMPLE:
            wanted |= {"table_rate_dps", "table_angle_deg", "elevation_deg"}
        elif effect.causal is Causal.RATE or effect.unit == PPM:
            wanted.add("rate_dps")
        wanted |= {name for name, flags in _OF_TEMPERATURE.items() if (effect.inputs | effect.also) & flags}
    return [name for name in _INPUTS if name in wanted]


def _sample(end_s: float, step_s: float, values: Mapping[str, float]) -> Stimulus:
    """Return the one step, as a formula of angle and attitude sees it."""
    middle, half = values["table_angle_deg"], 0.5 * values["table_rate_dps"] * step_s
    room = np.array([REFERENCE_C])
    return Stimulus(
        np.array([end_s]), room, room, np.array([middle - half, middle + half]),
        np.array([values["elevation_deg"]]), values["latitude_deg"], step_s,
    )  # fmt: skip
