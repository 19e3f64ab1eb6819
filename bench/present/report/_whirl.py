"""The report of a whirl fit: integrated residual, orbit, attitude, spectrum, lines, what is free."""

from __future__ import annotations

import math

import numpy as np
from markupsafe import Markup

from bench.present.report._decimation import decimate
from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._layout import render_page
from bench.present.report._numbers import DASH, column, duration, fixed, significant
from bench.present.report._page import (
    Block,
    Column,
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
)
from bench.present.report._palette import AFTER, BEFORE, GREEN, MUTED, PURPLE, Paint
from bench.present.report._parts import BEFORE_AFTER, before_after, made, named, warnings
from bench.present.report._plotting import drawing, place, svg
from bench.present.report._tables import checksum_table, runs_table, software_facts
from bench.present.report._whirl_content import WhirlContent, WhirlJudgement
from drivers.base.arrays import Array

TARGET = 100.0
"""By how many times the part locked to the rotation is to fall."""


def render_whirl(content: WhirlContent) -> str:
    """Return the report of a whirl fit as a self-contained HTML file."""
    first = content.runs[0] if content.runs else None
    facts = [
        Fact("Unit under test", content.unit_id),
        Fact("Bench", (first.bench_name if first else "") or DASH),
        Fact("Runs", ", ".join(run.run_id for run in content.runs) or DASH),
        Fact("Rotation", duration(sum(run.duration_s or 0.0 for run in content.runs))),
    ]
    if first and first.emulated:
        facts.append(Fact("Emulated devices", first.emulated))
    page = Page(
        title=f"Whirl of unit {content.unit_id}",
        kind="Whirl compensation report",
        facts=facts,
        verdict=_verdict(content),
        sections=_sections(content),
        colophon=made(content.created_utc),
    )
    return render_page(page)


def _verdict(content: WhirlContent) -> Verdict:
    factors = [_factor(judged) for judged in content.judgements]
    if not factors:
        return Verdict("Not judged", "doubt", ["There was no run to judge the compensation on."])
    least = min(factors)
    reached = least >= TARGET
    word = "Whirl removed" if reached else "Whirl reduced"
    where = "the run it was fitted on" if content.judged_on_fitted else "runs it was not fitted on"
    sentences = [
        f"On {where}, the part of the carrier's roll and pitch that is locked to the rotation angle falls by "
        f"{fixed(least, 0)} times or more; {fixed(TARGET, 0)} times is the target."
    ]
    if content.judged_on_fitted:
        sentences.append("Judge it on another run before it is used.")
    first = content.judgements[0]
    headlines = [
        Headline(
            "Locked to the angle, rms",
            significant(first.locked_after_arcsec),
            "arcsec",
            significant(first.locked_before_arcsec),
            first.run_id,
        ),
        Headline(
            "All oscillation, rms",
            significant(first.total_after_arcsec),
            "arcsec",
            significant(first.total_before_arcsec),
            "about a mean of two turns",
        ),
    ]
    good = reached and not content.judged_on_fitted
    return Verdict(word, "good" if good else "doubt", sentences, headlines)


def _factor(judged: WhirlJudgement) -> float:
    return (
        judged.locked_before_arcsec / judged.locked_after_arcsec if judged.locked_after_arcsec else math.inf
    )


def _sections(content: WhirlContent) -> list[Section]:
    return [
        warnings(content.findings),
        Section("Judgement", _judgement_table(content)),
        Section(
            "Attitude before and after",
            [_attitude(judged, at) for at, judged in enumerate(content.judgements)],
        ),
        Section("Integrated residual and its fit", [_residual(content)]),
        Section("Orbit", [_orbit(content)]),
        Section("Spectrum of the remainder", [_spectrum(content)]),
        Section("Lines", [*_line_table(content), Facts([Fact(*pair) for pair in content.facts])]),
        Section(
            "What is free, and what could not be told",
            [Notes([content.free, content.gauge, *content.declared])],
        ),
        Section("Runs", runs_table(content.runs)),
        Section("Provenance", _provenance(content)),
    ]


def _judgement_table(content: WhirlContent) -> list[Block]:
    rows = []
    for judged in content.judgements:
        patent = judged.locked_patent_arcsec
        values = [judged.locked_before_arcsec, patent, judged.locked_after_arcsec, _factor(judged)]
        values += [judged.locked_before_arcsec / patent if patent else None]
        values += [judged.total_before_arcsec, judged.total_after_arcsec]
        rows.append(named(judged.run_id, *(significant(value) for value in values)))
    heads = [
        Column("Run"),
        Column("Locked, before", "arcsec", True),
        Column("second-order integral fit", "arcsec", True),
        Column("direct fit", "arcsec", True),
        Column("times less, direct", "", True),
        Column("integral", "", True),
        Column("All, before", "arcsec", True),
        Column("after", "arcsec", True),
    ]
    caption = (
        "Rms an axis of the carrier's tilt about its mean over two turns; locked: what repeats with the rotation "
        "angle, lines −6 to 6. The second-order integral fit is the patent's own form; it cannot hold lines +1 "
        "and −2."
    )
    return [Table(heads, rows, caption)] if rows else []


def _attitude(judged: WhirlJudgement, at: int) -> Figures:
    minutes = judged.time_s / 60.0
    plots = [
        before_after("arcsec", minutes, judged.before_x, judged.after_x, height=150.0, of="about x"),
        before_after("arcsec", minutes, judged.before_y, judged.after_y, height=150.0, of="about y"),
        Lane(
            "arcsec",
            [
                Curve("about x after", minutes, judged.after_x, AFTER),
                Curve("about y", minutes, judged.after_y, GREEN),
            ],
            110.0,
        ),
    ]
    figure = lanes(
        f"attitude-{at + 1}",
        plots,
        "time, min",
        description=f"carrier tilt of run {judged.run_id} before and after compensation",
    )
    return Figures(
        [figure],
        f"Run {judged.run_id}: carrier tilt about the body's axes less its two-turn mean; below, the rest.",
        BEFORE_AFTER,
    )


def _residual(content: WhirlContent) -> Figures:
    minutes = content.residual_time_s / 60.0
    plots = [
        Lane(
            f"about {axis}, arcsec",
            [
                Curve("measured", minutes, measured, MUTED, width=2.2),
                Curve("fit", minutes, fitted, PURPLE, "--"),
            ],
        )
        for axis, measured, fitted in (
            ("x", content.residual_x, content.residual_fit_x),
            ("y", content.residual_y, content.residual_fit_y),
        )
    ]
    figure = lanes(
        "residual", plots, "time, min", description="integrated residual rate in body axes and its fit"
    )
    return Figures(
        [figure],
        "Residual rate of the horizontal gyros, turned into body axes and integrated, Earth rate and drift out. "
        "Both begin at zero: the constant is free.",
    )


def _orbit(content: WhirlContent) -> Figures:
    x, y = content.orbit_x, content.orbit_y
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


def _spectrum(content: WhirlContent) -> Figures:
    figure = lanes(
        "spectrum",
        [
            _decades("before", content.spectrum_lines, content.spectrum_before, BEFORE),
            _decades("after", content.spectrum_lines, content.spectrum_after, AFTER),
        ],
        "line m, turns of the tilt a turn of the table",
        description="amplitude of the carrier tilt against line, before and after",
    )
    return Figures(
        [figure],
        "Amplitude of the carrier's tilt by line, positive lines turning with the table; logarithm to base ten. "
        "A peak off the whole numbers is a bearing's cage or rollers.",
    )


def _decades(label: str, lines: Array, amplitude: Array, paint: Paint) -> Lane:
    with np.errstate(divide="ignore"):
        level = np.log10(amplitude)
    x, y = decimate(lines, np.where(np.isfinite(level), level, np.nan), 450)
    return Lane("log₁₀ arcsec", [Curve(label, x, y, paint)], 130.0)


def _line_table(content: WhirlContent) -> list[Block]:
    sd = column((row.sd_arcsec for row in content.lines), 2)
    rows = [
        named(
            f"{line.line:+g}".replace("-", "−"),
            fixed(line.x_arcsec, 3),
            fixed(line.y_arcsec, 3),
            fixed(math.hypot(line.x_arcsec, line.y_arcsec), 3),
            spread,
            significant(line.statistic),
        )
        for line, spread in zip(content.lines, sd, strict=True)
    ]
    heads = [
        Column("Line m"),
        Column("About x", "arcsec", True),
        Column("About y", "arcsec", True),
        Column("Amplitude", "arcsec", True),
        Column("sd an axis", "arcsec", True),
        Column("Evidence", "", True),
    ]
    caption = "Body tilt = Σ a exp(j m ψ). Evidence is |a|² / (2 sd²), Exp(1) where there is no line."
    meaning = Definitions(
        [
            ("line +1", "a constant tilt of the unit against the spin axis"),
            ("line −1", "a tilt that goes round against the table, once a turn"),
            ("lines 2, 3", "the spin axis itself swings, once and twice a turn in rotating axes"),
        ]
    )
    return [Table(heads, rows, caption), meaning]


def _provenance(content: WhirlContent) -> list[Block]:
    blocks = software_facts(content.software, content.runs[0].bench_file_sha256 if content.runs else "")
    files = {content.file_name: content.file_sha256} if content.file_name else {}
    checks = {run.run_id: run.checksum for run in content.runs}
    return [
        *blocks,
        *checksum_table(files | checks, "Checksums of the compensation file and of the runs' manifests."),
    ]
