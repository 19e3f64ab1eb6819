"""Heading changes of a platform INS: it has no rate, its drift shows in its position; where, which, how far.

The fit is `bench.analysis.heading`'s: start misalignment and drift, slow wander and the reference heading's own
swing are nuisance beside every explanation, as a gyro's bias is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.analysis.gap._model_file import ChannelTerm, Model
from bench.analysis.heading import (
    HeadingStudy,
    LaggedModel,
    PlatformLog,
    PositionCorrector,
    fit_reference,
    integrate,
    load_log,
    regressors,
    site_of_run,
    stays,
    study_heading,
    without_start,
)
from bench.record.recording import Run, checksum
from bench.record.run_folder import MANIFEST_FILE
from drivers.base.errors import ConfigurationError
from simulators.effects import ChannelEffect, catalogue

_SURE = 0.95
"""Highest probability stated: something else may resemble the effect."""
_AMBIGUOUS = 0.02
_CLEAR = 5.0
_DOUBTED = 0.1
"""Probability of no effect from which on none is named."""
_DRAWS = 2000
_HEADING_EFFECT, _STEPS = "heading_effect", "heading_steps"


@dataclass(frozen=True)
class HeadingPlace:
    """Position error at one stay, what the first stay foretells taken off: rms in arcsec before and after."""

    heading_deg: float
    hours: float
    rms_before_as: float
    rms_after_as: float
    share: float


@dataclass(frozen=True)
class PlatformShrinkage:
    """Part of the position error's energy that is gone on a held-out run, its 95 % interval over stays."""

    run_id: str
    share: float
    low: float
    high: float
    rms_before_as: float
    rms_after_as: float


@dataclass(frozen=True, eq=False)
class PlatformDiagnosis:
    """What was found; `term` is the cause with its values, None without one that has values.

    `causes` and `alternatives` map effects to their probability. `places` are the stays of the fitted run after
    its first. `unknown`: something is there that neither explains.
    """

    unit_id: str
    verdict: str
    causes: Mapping[str, float]
    alternatives: Mapping[str, float]
    null_probability: float
    unknown: bool
    term: ChannelTerm | None
    places: tuple[HeadingPlace, ...]
    held_out: tuple[PlatformShrinkage, ...]
    study: HeadingStudy
    run_checksums: Mapping[str, str]
    warnings: tuple[str, ...]

    def meaning_of(self, name: str) -> str:
        """Return the plain sentence of an effect named."""
        return _effect(name).meaning


def is_platform_run(folder: Path) -> bool:
    """Return whether a run folder is of a platform INS and has no gyro."""
    if not (folder / MANIFEST_FILE).exists():
        return False
    roles = {device.role for device in Run.open(folder).manifest.devices.values()}
    return "platform" in roles and "gyro" not in roles


def load_platform_run(folder: Path) -> tuple[str, str, PlatformLog, str]:
    """Return run id, unit, log and checksum of a platform's run folder."""
    manifest = Run.open(folder).manifest
    unit = next(iter(manifest.units.values()), "")
    return (
        manifest.run_id,
        unit,
        load_log(folder, site_of_run(folder))[0],
        checksum(folder / MANIFEST_FILE).sha256,
    )


def diagnose_platform(
    unit_id: str,
    logs: Mapping[str, PlatformLog],
    model: Model,
    held_out: Mapping[str, PlatformLog] | None = None,
    checksums: Mapping[str, str] | None = None,
) -> PlatformDiagnosis:
    """Diagnose runs of one platform against a model, without or with a `heading_effect` of its own.

    The longest run is fitted; the others, like `held_out` ones, judge it. RecordError for a run that cannot show
    a heading effect (fewer than three headings beside the first, less than a sidereal day at it).
    ConfigurationError if a held-out run was used for the model.
    """
    kept = dict(held_out or {})
    used = sorted(set(kept) & (set(logs) | set(model.fitted_on)))
    if used:
        raise ConfigurationError(
            "a run that the model was fitted on cannot judge it",
            found=", ".join(used),
            expected="held-out runs",
        )
    term = next((each for each in model.channel_terms if each.name == _HEADING_EFFECT), None)
    left = {name: _without_term(log, term) for name, log in {**logs, **kept}.items()}
    fitted = max(logs, key=lambda name: float(logs[name].time_s[-1] - logs[name].time_s[0]))
    others = {name: log for name, log in left.items() if name != fitted}
    study = study_heading(left[fitted], others)
    found = study.model.evidence
    none, temperature, steps = _log_evidence(study)
    weights = np.exp(np.array([none, temperature, steps]) - max(none, temperature, steps))
    null, *chances = (weights / weights.sum()).tolist()
    by_name = dict(zip((_HEADING_EFFECT, _STEPS), chances, strict=True))
    name = {"temperature": _HEADING_EFFECT, "heading": _STEPS, "none": ""}[found.cause]
    if null > _DOUBTED or (name and by_name[name] < 0.5):
        name = ""
    other = {_HEADING_EFFECT: _STEPS, _STEPS: _HEADING_EFFECT}.get(name, "")
    chance = min(by_name.get(name, 0.0), _SURE)
    alternatives = {other: by_name[other]} if name and by_name[other] > _AMBIGUOUS else {}
    verdict = "no gap" if not name else "explained in part" if found.mixed else "explained"
    if not name and null < 0.5:
        verdict = "unknown"
    warnings = [f"{finding.what}: {finding.consequence}" for finding in study.findings]
    return PlatformDiagnosis(
        unit_id,
        verdict,
        {name: chance} if name else {},
        alternatives,
        null,
        verdict in ("explained in part", "unknown"),
        _term(name, study.model, term),
        _places(fitted, left[fitted], study),
        tuple(_shrinkage(each, study, left[each]) for each in others) if name == _HEADING_EFFECT else (),
        study,
        {run: (checksums or {}).get(run, "") for run in logs},
        tuple(warnings),
    )


def platform_closed(found: PlatformDiagnosis, model: Model) -> Model:
    """Return the model with the heading effect in it, and the run that it was fitted on."""
    if found.term is None:
        return model
    others = (each for each in model.channel_terms if each.name != found.term.name)
    terms = (*others, found.term)
    return replace(
        model,
        name=f"{model.name}+{found.term.name}",
        channel_terms=terms,
        fitted_on=dict(found.run_checksums),
    )


def _log_evidence(study: HeadingStudy) -> tuple[float, float, float]:
    """Return log evidence of no effect, of temperature's and of steps (Schwarz: half a log of hours a value)."""
    found = study.model.evidence
    scale = max(1.0, found.residual**2)
    occam = 0.5 * math.log(max(study.model.hours, 2.0))
    return (
        -0.5 * found.none / scale,
        -0.5 * found.temperature / scale - 10.0 * occam - _CLEAR,
        -0.5 * found.steps / scale - 3.0 * study.model.headings * occam - _CLEAR,
    )


def _without_term(log: PlatformLog, term: ChannelTerm | None) -> PlatformLog:
    """Return the log less the position error that a model's heading effect makes."""
    if term is None:
        return log
    first = stays(log)[0]
    rows = slice(first.start, first.stop)
    reference = fit_reference(log.sidereal_rad[rows], log.temp_c[rows])
    step_s = float(np.median(np.diff(log.time_s)))
    known = np.isfinite(log.temp_c)
    temp_c = np.interp(log.time_s, log.time_s[known], log.temp_c[known])
    drivers = regressors(log.sidereal_rad, temp_c, step_s, reference, 3600.0 * term.values[9], "lag9")
    drift = drivers @ np.array(term.values[:9]).reshape(3, 3).T
    corrector = PositionCorrector(log.latitude_deg, log.delay_s)
    north, east = corrector.correction(log.time_s, log.sidereal_rad, integrate(log.time_s, drift))
    return replace(log, north_as=log.north_as - north, east_as=log.east_as - east)


def _term(name: str, model: LaggedModel, before: ChannelTerm | None) -> ChannelTerm | None:
    """Return the fitted heading effect; one that the model had is counted in where the lags agree."""
    if name != _HEADING_EFFECT:
        return None
    effect = _effect(name)
    gains, sigmas = model.gain.ravel(), model.sigma.ravel()
    if before is not None:
        gains = gains + np.array(before.values[:9])
    lag_h = model.tau_s / 3600.0
    return ChannelTerm(effect, (*gains.tolist(), lag_h), (*sigmas.tolist(), 0.1 * lag_h))


def _effect(name: str) -> ChannelEffect:
    effect = catalogue()[name]
    assert isinstance(effect, ChannelEffect)
    return effect


def _places(name: str, log: PlatformLog, study: HeadingStudy) -> tuple[HeadingPlace, ...]:
    first, *rest = stays(log)
    judged = next((each for each in study.judgements if not each.held_out), None)
    if judged is None:
        left = without_start(name, log, first, np.zeros((len(log.time_s), 3)))
        before = after = left.north_as**2 + left.east_as**2
    else:
        before = judged.north_before_as**2 + judged.east_before_as**2
        after = judged.north_after_as**2 + judged.east_after_as**2
    total = float(np.nansum(before[first.stop :])) or 1.0
    return tuple(
        HeadingPlace(
            stay.heading_deg,
            stay.duration_s / 3600.0,
            float(np.sqrt(np.nanmean(before[stay.start : stay.stop]))),
            float(np.sqrt(np.nanmean(after[stay.start : stay.stop]))),
            float(np.nansum(before[stay.start : stay.stop])) / total,
        )
        for stay in rest
    )


def _shrinkage(name: str, study: HeadingStudy, log: PlatformLog) -> PlatformShrinkage:
    judged = next(each for each in study.judgements if each.name == name)
    before = judged.north_before_as**2 + judged.east_before_as**2
    after = judged.north_after_as**2 + judged.east_after_as**2
    parts = [slice(stay.start, stay.stop) for stay in stays(log)[1:]]
    sums = np.array([(np.nansum(before[part]), np.nansum(after[part])) for part in parts])
    # what differs between stays says how well the share is known
    drawn = np.random.default_rng(1).integers(0, len(sums), (_DRAWS, len(sums)))
    shares = 1.0 - sums[drawn, 1].sum(axis=1) / np.maximum(sums[drawn, 0].sum(axis=1), 1e-12)
    low, high = np.quantile(shares, (0.025, 0.975)).tolist()
    share = 1.0 - float(sums[:, 1].sum()) / max(float(sums[:, 0].sum()), 1e-12)
    return PlatformShrinkage(name, share, low, high, judged.rms_before_as, judged.rms_after_as)
