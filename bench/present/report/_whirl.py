"""The report of a whirl fit: integrated residual, orbit, attitude, spectrum, lines, what is free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from bench.present.report._decimation import decimate
from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._numbers import DASH, column, duration, fixed, significant
from bench.present.report._page import (
    Block,
    Definitions,
    Fact,
    Facts,
    Figures,
    Headline,
    Notes,
    Page,
    Section,
    Table,
    Verdict,
    named,
)
from bench.present.report._palette import AFTER, BEFORE, GREEN, MUTED, PURPLE, Paint
from bench.present.report._parts import BEFORE_AFTER, before_after, made, warnings
from bench.present.report._plotting import drawing, place, svg
from bench.present.report._run_content import RunContent, run_content
from bench.present.report._tables import checksum_table, runs_table, software_facts
from bench.record.recording import Run, checksum
from drivers.base.arrays import Array
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.whirl import Estimate, Judgement, WhirlStudy

TARGET = 100.0
"""By how many times the part locked to the rotation is to fall."""
_PLOT_STEP_S = 0.5
_SPECTRUM = np.arange(-8.0, 8.0 + 1e-9, 0.02)


@dataclass(frozen=True, eq=False)
class _Course:
    """A run before and after: carrier tilt about x + j y less its two-turn mean, (n,) arcsec.

    `locked`: times and tilt of its rests.
    """

    run_id: str
    time_s: Array
    angle_rad: Array
    before: NDArray[np.complex128]
    after: NDArray[np.complex128]
    locked: list[tuple[Array, NDArray[np.complex128]]]


def whirl_page(study: WhirlStudy, runs: Sequence[Run], compensation_file: Path) -> Page:
    """Return the report of a whirl fit; `runs` were fitted or judged, `compensation_file` was written."""
    from bench.analysis.whirl import FREE_PART, MEANING  # scipy behind it is slow to import

    contents = [
        run_content(run, "fitted" if run.manifest.run_id in study.compensation.runs else "held out")
        for run in runs
    ]
    unit_id, gauge = study.compensation.unit_id, study.compensation.gauge
    first = contents[0]
    facts = [
        Fact("Unit under test", unit_id),
        Fact("Bench", first.manifest.bench_name or DASH),
        Fact("Runs", ", ".join(run.run_id for run in contents)),
        Fact("Rotation", duration(sum(run.manifest.duration_s or 0.0 for run in contents))),
        Fact("Emulated devices", first.emulated),
    ]
    courses = [_course(judged) for judged in study.judgements]
    sections = [
        warnings([finding.text for finding in study.findings]),
        Section("Judgement", _judgement_table(study.judgements)),
        Section("Attitude before and after", [_attitude(course, n) for n, course in enumerate(courses, 1)]),
        Section("Integrated residual and its fit", [_residual(study)]),
        Section("Orbit", [_orbit(study)]),
        Section("Spectrum of the remainder", [_spectrum(courses[0])]),
        Section("Lines", [*_line_table(study), Facts(_fit_facts(study))]),
        Section(
            "What is free, and what could not be told",
            [Notes([FREE_PART, f"gauge {gauge}: {MEANING[gauge]}", *study.fit.declared])],
        ),
        Section("Runs", runs_table(contents)),
        Section("Provenance", _provenance(study, contents, compensation_file)),
    ]
    return Page(
        title=f"Whirl of unit {unit_id}",
        kind="Whirl compensation report",
        facts=facts,
        verdict=_verdict(study),
        sections=sections,
        colophon=made(utc_now()),
    )


def _course(judged: Judgement) -> _Course:
    from bench.analysis.whirl import remove_slow

    record = judged.record
    step = max(1, round(_PLOT_STEP_S / record.period_s))
    before, where = remove_slow(judged.tilt_before, record.time_s, record.angle_rad)
    after, _ = remove_slow(judged.tilt_after, record.time_s, record.angle_rad)
    time_s, angle_rad = record.time_s[where][::step], record.angle_rad[where][::step]
    locked = [(at_s[::step], tilt[::step]) for at_s, tilt in judged.locked]
    return _Course(record.run_id, time_s, angle_rad, before[::step], after[::step], locked)


def _verdict(study: WhirlStudy) -> Verdict:
    least = min(_factor(judged) for judged in study.judgements)
    reached = least >= TARGET
    word = "Whirl removed" if reached else "Whirl reduced"
    where = "the run it was fitted on" if study.judged_on_fitted else "runs it was not fitted on"
    sentences = [
        f"On {where}, the part of the carrier's roll and pitch that is locked to the rotation angle falls by "
        f"{fixed(least, 0)} times or more; {fixed(TARGET, 0)} times is the target."
    ]
    if study.judged_on_fitted:
        sentences.append("Judge it on another run before it is used.")
    first = study.judgements[0]
    headlines = [
        Headline(
            "Locked to the angle, rms",
            significant(first.after.locked_arcsec),
            "arcsec",
            significant(first.before.locked_arcsec),
            first.record.run_id,
        ),
        Headline(
            "All oscillation, rms",
            significant(first.after.total_arcsec),
            "arcsec",
            significant(first.before.total_arcsec),
            "about a mean of two turns",
        ),
    ]
    good = reached and not study.judged_on_fitted
    return Verdict(word, "good" if good else "doubt", sentences, headlines)


def _factor(judged: Judgement) -> float:
    before, after = judged.before.locked_arcsec, judged.after.locked_arcsec
    return before / after if after else math.inf


def _judgement_table(judgements: Sequence[Judgement]) -> list[Block]:
    rows = []
    for judged in judgements:
        before, after = judged.before, judged.after
        patent = None if judged.patent is None else judged.patent.locked_arcsec
        values = [before.locked_arcsec, patent, after.locked_arcsec, _factor(judged)]
        values += [before.locked_arcsec / patent if patent else None, before.total_arcsec, after.total_arcsec]
        values += [max(judged.rests_arcsec, default=None)]
        rows.append(named(judged.record.run_id, *(significant(value) for value in values)))
    heads = ["Run", ">Locked, before [arcsec]", ">second-order integral fit [arcsec]", ">direct fit [arcsec]"]
    heads += [
        ">times less, direct",
        ">integral",
        ">All, before [arcsec]",
        ">after [arcsec]",
        ">at rest [arcsec]",
    ]
    caption = (
        "Rms an axis of the carrier's tilt about its mean over two turns; locked: what repeats with the rotation "
        "angle, lines −6 to 6. At rest: the mechanism locked before and after, about a straight line. The "
        "second-order integral fit is the patent's own form; it cannot hold lines +1 and −2."
    )
    return [Table(heads, rows, caption)]


def _attitude(course: _Course, number: int) -> Figures:
    run_id, minutes = course.run_id, course.time_s / 60.0
    y_after = Curve("about y", minutes, course.after.imag, GREEN)
    gap = np.array([np.nan])
    rest_s = np.concatenate([np.append(at_s, gap) for at_s, _ in course.locked] or [gap])
    rest = np.concatenate([np.append(tilt, gap + 0j) for _, tilt in course.locked] or [gap + 0j])
    at_rest = [
        Curve(f"{axis}, locked", rest_s / 60.0, part, MUTED)
        for axis, part in (("x", rest.real), ("y", rest.imag))
        if course.locked
    ]
    plots = [
        before_after("arcsec", minutes, course.before.real, course.after.real, height=150.0, of="about x"),
        before_after("arcsec", minutes, course.before.imag, course.after.imag, height=150.0, of="about y"),
        Lane("arcsec", [Curve("about x after", minutes, course.after.real, AFTER), y_after, *at_rest], 110.0),
    ]
    return lanes(
        f"attitude-{number}",
        plots,
        "time, min",
        f"Run {run_id}: carrier tilt about the body's axes less its two-turn mean; below, what is left, "
        "and grey the mechanism locked before and after.",
        BEFORE_AFTER,
        description=f"carrier tilt of run {run_id} before and after compensation",
    )


def _residual(study: WhirlStudy) -> Figures:
    from bench.analysis.whirl import integrated_residual

    time_s, tilt, fitted_tilt = integrated_residual(study.fit)
    minutes = time_s / 60.0
    plots = [
        Lane(
            f"about {axis}, arcsec",
            [
                Curve("measured", minutes, measured, MUTED, width=2.2),
                Curve("fit", minutes, fitted, PURPLE, "--"),
            ],
        )
        for axis, measured, fitted in (("x", tilt.real, fitted_tilt.real), ("y", tilt.imag, fitted_tilt.imag))
    ]
    return lanes(
        "residual",
        plots,
        "time, min",
        "Residual rate of the horizontal gyros, turned into body axes and integrated, Earth rate and drift out. "
        "Both begin at zero: the constant is free.",
        description="integrated residual rate in body axes and its fit",
    )


def _orbit(study: WhirlStudy) -> Figures:
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    orbit = study.compensation.tilt_arcsec(angle) * np.exp(-1j * angle)
    x, y = orbit.imag, orbit.real  # theta_y is the tilt about x_s, theta_x about y_s
    size = 330.0
    reach = 1.08 * float(max(np.abs(x).max(), np.abs(y).max(), 1e-9))
    with drawing(size, size) as figure:
        axes = place(figure, 52.0, 10.0, size - 62.0, size - 52.0)
        axes.plot(x, y, color=AFTER.light)
        axes.plot(x[:1], y[:1], "o", color=BEFORE.light, markersize=6)
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_xlabel("θx, arcsec")
        axes.set_ylabel("θy, arcsec")
        drawn: Markup = svg(figure, "orbit", "whirl orbit, theta x against theta y")
    return Figures(
        [drawn],
        "Tilt of the gyros' frame over one turn in rotating axes, θx against θy; the dot is table angle zero.",
        columns=2,
    )


def _spectrum(course: _Course) -> Figures:
    from bench.analysis.whirl import tilt_spectrum

    before, after = (
        tilt_spectrum(tilt, course.angle_rad, _SPECTRUM) for tilt in (course.before, course.after)
    )
    return lanes(
        "spectrum",
        [_decades("before", before, BEFORE), _decades("after", after, AFTER)],
        "line m, turns of the tilt a turn of the table",
        "Amplitude of the carrier's tilt by line, positive lines turning with the table; logarithm to base ten. "
        "A peak off the whole numbers is a bearing's cage or rollers.",
        description="amplitude of the carrier tilt against line, before and after",
    )


def _decades(label: str, amplitude: Array, paint: Paint) -> Lane:
    with np.errstate(divide="ignore"):
        level = np.log10(amplitude)
    x, y = decimate(_SPECTRUM, np.where(np.isfinite(level), level, np.nan), 450)
    return Lane("log₁₀ arcsec", [Curve(label, x, y, paint)], 130.0)


def _line_table(study: WhirlStudy) -> list[Block]:
    fit = study.fit
    sd = column((float(value) for value in fit.sd_arcsec), 2)
    rows = [
        named(
            f"{line:+g}".replace("-", "−"),
            fixed(amplitude.real, 3),
            fixed(amplitude.imag, 3),
            fixed(abs(amplitude), 3),
            spread,
            significant(float(evidence)),
        )
        for line, amplitude, spread, evidence in zip(
            fit.lines, fit.amplitudes_arcsec.tolist(), sd, fit.statistic, strict=True
        )
    ]
    heads = ["Line m", ">About x [arcsec]", ">About y [arcsec]", ">Amplitude [arcsec]"]
    heads += [">sd an axis [arcsec]", ">Evidence"]
    caption = "Body tilt = Σ a exp(j m ψ). Evidence is |a|² / (2 sd²), Exp(1) where there is no line."
    meaning = Definitions(
        [
            ("line +1", "a constant tilt of the unit against the spin axis"),
            ("line −1", "a tilt that goes round against the table, once a turn"),
            ("lines 2, 3", "the spin axis itself swings, once and twice a turn in rotating axes"),
        ]
    )
    return [Table(heads, rows, caption), meaning]


def _fit_facts(study: WhirlStudy) -> list[Fact]:
    fit = study.fit
    drift = _with_sd(fit.drift_dph[0], "°/h") if fit.drift_dph else "not separable from line +1"
    facts = [
        Fact("Rate that stands still in the body", _with_sd(fit.body_rate_dph[0], "°/h")),
        Fact("Azimuth of y from Earth rate", f"{study.heading_deg:.3f}°"),
        Fact("Angle random walk an axis", f"{fit.noise_arcsec_per_sqrt_s / 60.0:.5f} °/√h"),
        Fact("Drift", drift),
        Fact("Separation of drift and line +1", f"condition number {fit.separation:.3g}"),
    ]
    if fit.play_arcsec is not None:
        travels = ", ".join(f"{travel:.2g}" for travel in sorted(fit.travels_deg))
        facts.append(Fact("Jump of tilt with the sense of rotation", _with_sd(fit.play_arcsec, "arcsec")))
        facts.append(Fact("Taken up over", f"{travels}° of the table"))
    return facts


def _with_sd(estimate: Estimate, unit: str) -> str:
    x, y = estimate.value.real, estimate.value.imag
    return f"{x:.4f} about x, {y:.4f} about y, ± {estimate.sd:.4f} {unit}"


def _provenance(study: WhirlStudy, runs: Sequence[RunContent], compensation_file: Path) -> list[Block]:
    checksums = {compensation_file.name: checksum(compensation_file).sha256}
    checksums |= {run.run_id: run.checksum for run in runs}
    return [
        *software_facts(study.compensation.software, runs[0].manifest.bench_file_sha256),
        *checksum_table(checksums, "Checksums of the compensation file and of the runs' manifests."),
    ]
