"""Heading changes of a platform INS: it has no rate, its drift shows in its position; where, which, how far.

The fit is `bench.analysis.heading`'s: start misalignment and drift, slow wander and the reference heading's own
swing are nuisance beside every explanation, as a gyro's bias is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.analysis.gap._findings import AMBIGUOUS, Cause, Finding, Shrinkage
from bench.analysis.gap._model_file import ChannelTerm, Model
from bench.analysis.gap._signal import Signal
from bench.analysis.heading import (
    HeadingStudy,
    Judgement,
    LaggedModel,
    PlatformLog,
    PositionCorrector,
    fit_reference,
    integrate,
    judge,
    load_log,
    regressors,
    site_of_run,
    stays,
    study_heading,
    without_start,
)
from bench.record.recording import Run
from bench.record.run_folder import is_run
from drivers.base.arrays import Array
from simulators.effects import ChannelEffect, catalogue

_SURE = 0.95
"""Highest probability stated: something else may resemble the effect."""
_CLEAR = 5.0
_DOUBTED = 0.1
"""Probability of no effect from which on none is named."""
_DRAWS = 2000
_HEADING_EFFECT, _STEPS = "heading_effect", "heading_steps"


@dataclass(frozen=True)
class PositionRun:
    """A platform's run: its position error over time."""

    run_id: str
    unit_id: str
    log: PlatformLog
    checksum: str = ""


@dataclass(frozen=True)
class HeadingPlace:
    """Position error at one stay, what the first stay foretells taken off: rms in arcsec before and after."""

    heading_deg: float
    hours: float
    rms_before_as: float
    rms_after_as: float
    share: float


@dataclass(frozen=True, eq=False, kw_only=True)
class PositionFinding(Finding[ChannelTerm | None]):
    """What was found; the cause `heading_steps` has no values, so no term.

    `stays` are those of the fitted run after its first. `unknown`: neither effect explains all that is there.
    """

    null_probability: float
    unknown: bool
    stays: tuple[HeadingPlace, ...]
    study: HeadingStudy


def is_platform_run(folder: Path) -> bool:
    """Return whether a run folder is of a platform INS and has no gyro."""
    if not is_run(folder):
        return False
    roles = {device.role for device in Run.open(folder).manifest.devices.values()}
    return "platform" in roles and "gyro" not in roles


def load_platform_run(folder: Path) -> PositionRun:
    """Return a platform's run folder as the diagnosis sees it."""
    run = Run.open(folder)
    unit = next(iter(run.manifest.units.values()), "")
    return PositionRun(run.manifest.run_id, unit, load_log(folder, site_of_run(folder))[0], run.checksum)


@dataclass(frozen=True, eq=False)
class _Ready:
    """Logs by run, what the model has taken out; the longest, `fitted`, studied, the `others` judge it."""

    term: ChannelTerm | None
    fitted: str
    left: Mapping[str, PlatformLog]
    others: Mapping[str, PlatformLog]
    study: HeadingStudy


class PositionSignal(Signal[PositionRun, _Ready, dict[str, float], PositionFinding]):
    """A platform's position error in arcsec, which has no rate; start misalignment and drift are nuisance.

    The longest run is fitted; the others, like held-out ones, judge it. RecordError for a run that cannot show
    a heading effect (fewer than three headings beside the first, less than a sidereal day at it).
    """

    def prepare(self, runs: Sequence[PositionRun], model: Model) -> _Ready:
        term = next(
            (channel_term for channel_term in model.channel_terms if channel_term.name == _HEADING_EFFECT),
            None,
        )
        left = {run.run_id: _without_term(run.log, term) for run in runs}
        fitted = max(runs, key=lambda run: float(run.log.time_s[-1] - run.log.time_s[0])).run_id
        others = {name: log for name, log in left.items() if name != fitted}
        return _Ready(term, fitted, left, others, study_heading(left[fitted], others))

    def which(self, data: _Ready) -> dict[str, float]:
        """Return the probability of no effect ("") and of each effect."""
        none, temperature, steps = _log_evidence(data.study)
        weights = np.exp(np.array([none, temperature, steps]) - max(none, temperature, steps))
        return dict(zip(("", _HEADING_EFFECT, _STEPS), (weights / weights.sum()).tolist(), strict=True))

    def finding(self, data: _Ready, sets: dict[str, float]) -> PositionFinding:
        found, null = data.study.model.evidence, sets[""]
        name = {"temperature": _HEADING_EFFECT, "heading": _STEPS, "none": ""}[found.cause]
        if null > _DOUBTED or sets[name] < 0.5:
            name = ""
        verdict = "no gap" if not name else "explained in part" if found.mixed else "explained"
        if not name and null < 0.5:
            verdict = "unknown"
        causes: tuple[Cause[ChannelTerm | None], ...] = ()
        if name:
            term = _term(data.study.model, data.term) if name == _HEADING_EFFECT else None
            other = {each: p for each, p in sets.items() if each not in ("", name) and p > AMBIGUOUS}
            causes = (Cause(name, _effect(name).meaning, min(sets[name], _SURE), term, other),)
        finding = PositionFinding(
            signal="position",
            unit="arcsec",
            verdict=verdict,
            causes=causes,
            terms=tuple(cause.term for cause in causes if cause.term is not None),
            warnings=tuple(f"{each.what}: {each.consequence}" for each in data.study.findings),
            null_probability=null,
            unknown=verdict in ("explained in part", "unknown"),
            stays=_places(data.fitted, data.left[data.fitted], data.study),
            study=data.study,
        )
        return _with_shares(finding, data.others)

    def judged(
        self,
        finding: PositionFinding,
        data: _Ready,
        sets: dict[str, float],
        held_out: Sequence[PositionRun],
    ) -> PositionFinding:
        kept = {run.run_id: _without_term(run.log, data.term) for run in held_out}
        study = data.study
        own = [
            each
            for name, log in kept.items()
            for each in judge(name, log, study.model, study.nine, held_out=True)
        ]
        finding = replace(finding, study=replace(study, judgements=(*study.judgements, *own)))
        return _with_shares(finding, {**data.others, **kept})


def _with_shares(finding: PositionFinding, others: Mapping[str, PlatformLog]) -> PositionFinding:
    """Return the finding judged on runs that were not fitted, if it has an effect with values."""
    names = others if finding.terms else {}
    return replace(finding, held_out=tuple(_shrinkage(name, finding.study, others[name]) for name in names))


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


def _term(model: LaggedModel, before: ChannelTerm | None) -> ChannelTerm:
    """Return the fitted heading effect; one that the model had is counted in where the lags agree."""
    gains, sigmas = model.gain.ravel(), model.sigma.ravel()
    if before is not None:
        gains = gains + np.array(before.values[:9])
    lag_h = model.tau_s / 3600.0
    effect = _effect(_HEADING_EFFECT)
    return ChannelTerm(effect, (*gains.tolist(), lag_h), (*sigmas.tolist(), 0.1 * lag_h))


def _effect(name: str) -> ChannelEffect:
    effect = catalogue()[name]
    assert isinstance(effect, ChannelEffect)
    return effect


def _places(name: str, log: PlatformLog, study: HeadingStudy) -> tuple[HeadingPlace, ...]:
    first, *rest = stays(log)
    judged = next((judgement for judgement in study.judgements if not judgement.held_out), None)
    if judged is None:
        left = without_start(name, log, first, np.zeros((len(log.time_s), 3)))
        before = after = left.north_as**2 + left.east_as**2
    else:
        before, after = _squares(judged)
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


def _squares(judged: Judgement) -> tuple[Array, Array]:
    """Return squares of the position error over time, before and after the correction, arcsec^2, (n,)."""
    return (
        judged.north_before_as**2 + judged.east_before_as**2,
        judged.north_after_as**2 + judged.east_after_as**2,
    )


def _shrinkage(name: str, study: HeadingStudy, log: PlatformLog) -> Shrinkage:
    judged = next(judgement for judgement in study.judgements if judgement.name == name)
    before, after = _squares(judged)
    parts = [slice(stay.start, stay.stop) for stay in stays(log)[1:]]
    sums = np.array([(np.nansum(before[part]), np.nansum(after[part])) for part in parts])
    # what differs between stays says how well the share is known
    drawn = np.random.default_rng(1).integers(0, len(sums), (_DRAWS, len(sums)))
    shares = 1.0 - sums[drawn, 1].sum(axis=1) / np.maximum(sums[drawn, 0].sum(axis=1), 1e-12)
    low, high = np.quantile(shares, (0.025, 0.975)).tolist()
    share = 1.0 - float(sums[:, 1].sum()) / max(float(sums[:, 0].sum()), 1e-12)
    return Shrinkage(share, low, high, judged.rms_before_as, judged.rms_after_as, name)
