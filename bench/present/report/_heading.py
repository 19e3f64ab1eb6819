"""The report of a heading-effect fit: temperature against drift, coefficients, errors before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Panel, lanes, panels
from bench.present.report._numbers import DASH, fixed, moment, significant
from bench.present.report._page import (
    Block,
    Cell,
    Fact,
    Facts,
    Headline,
    Key,
    Notes,
    Page,
    Section,
    Table,
    Tone,
    Verdict,
    named,
)
from bench.present.report._palette import MUTED, PURPLE
from bench.present.report._parts import BEFORE_AFTER, before_after, made, warnings
from bench.present.report._tables import checksum_table

if TYPE_CHECKING:
    from bench.analysis.heading import (
        HeadingStudy,
        Judgement,
        LaggedModel,
        ModulusTest,
        NineCoefficients,
        SecondChoice,
        Settling,
    )

_HOUR = 3600.0
_SIGNIFICANT = 0.05
_AXES = "xyz"


def heading_page(
    study: HeadingStudy, title: str, checksums: Mapping[str, str], *, created_utc: str, model_file: str = ""
) -> Page:
    """Return the report; `checksums` of the logs by file name, `model_file` empty if none was written."""
    model = study.model
    return Page(
        title=f"Heading effect: {title}",
        kind="Heading compensation report",
        facts=[
            Fact("Calibration", f"{model.headings} headings beside the reference, {fixed(model.hours, 0)} h"),
            Fact("Reference heading", f"{fixed(model.reference_heading_deg, 1)}°"),
            Fact("Latitude in the equations", f"{fixed(model.latitude_deg, 3)}°"),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=_verdict(study),
        sections=[
            warnings(_findings(study)),
            Section("Position before and after", _errors(study)),
            Section("Reduction of heading sensitivity", _reductions(study.judgements)),
            Section("Temperature and drift", _temperature(study)),
            Section("Lagged model", _lagged(model, model_file)),
            Section("Time constants", _time_constants(study.settling)),
            Section("Second temperature", _second(study.second)),
            Section("Accelerometers", _modulus(study.modulus)),
            Section("Nine coefficients", _nine(study.nine, study.nine_refused)),
            Section("Where the drift comes from", _evidence(study)),
            Section("Provenance", checksum_table(checksums, "Logs and their checksums.")),
        ],
        terms=_TERMS,
        colophon=made(created_utc, "Errors are computed minus true position."),
    )


def _verdict(study: HeadingStudy) -> Verdict:
    cause = study.model.evidence.cause
    if cause == "none":
        return Verdict(
            "No heading effect", "plain", ["Nothing beyond the noise of the run depends on heading."]
        )
    if cause == "heading":
        return Verdict(
            "Not driven by temperature",
            "bad",
            [
                "The drift steps with heading at once and does not follow the temperature. Compensating with "
                "temperature would add error: there is no compensation."
            ],
        )
    if cause == "unexplained":
        share = fixed(100.0 * study.model.evidence.other_share, 0)
        return Verdict(
            "Not explained by the temperature measured",
            "bad",
            [
                f"{share} % of the heading effect goes with heading and not with the measured temperature. "
                "Compensating with it could add error: there is no compensation."
            ],
        )
    judgements = [row for row in study.judgements if row.method == study.model.form]
    held = [row for row in judgements if row.held_out]
    shown = held or judgements
    median = float(np.median([row.reduction_percent for row in shown]))
    sentences = [
        f"The {study.model.form} model takes {fixed(median, 1)} % off the heading sensitivity of the "
        "position error"
        + (f" on {len(held)} held-out logs (median)." if held else " of the log that it was fitted on.")
    ]
    if not held:
        least = fixed(study.model.evidence.least_reduction_percent, 0)
        sentences.append(
            f"No held-out log was given. At other headings a reduction of {least} % or more is to be expected."
        )
    tone: Tone = "doubt" if not held else "good" if median > 0.0 else "bad"
    before, after = (
        float(np.sqrt(np.mean([getattr(row, name) ** 2 for row in shown])))
        for name in ("rms_before_as", "rms_after_as")
    )
    headlines = [
        Headline("Position error, rms", significant(after / 60.0), "′", before=significant(before / 60.0)),
        Headline("Reduction", fixed(median, 1), "%", note="held out" if held else "on the fitted log"),
        Headline("Core time constant", fixed(study.model.tau_s / _HOUR, 2), "h"),
    ]
    return Verdict("Compensated", tone, sentences, headlines)


def _findings(study: HeadingStudy) -> list[str]:
    texts = [f"{finding.what}: {finding.consequence}." for finding in study.findings]
    texts += [mixed_text(study)] if study.model.evidence.mixed else []
    texts += [
        f"{row.name}: regressors beyond the calibrated range for {fixed(100 * row.outside_share, 0)} "
        "% of the time."
        for row in study.judgements
        if row.outside_share > 0.01
    ]
    return texts


def mixed_text(study: HeadingStudy) -> str:
    """Say that temperature explains a part only."""
    share = fixed(100.0 * study.model.evidence.other_share, 0)
    return (
        f"{share} % of the heading effect goes with heading at once and not with the measured temperature "
        "(friction, magnetic field, or a gradient that no sensor sees): that part stays after compensation."
    )


def _errors(study: HeadingStudy) -> list[Block]:
    blocks: list[Block] = []
    judgements = [row for row in study.judgements if row.method == study.model.form]
    for number, row in enumerate(judgements):
        hours = (row.time_s - row.time_s[0]) / _HOUR
        plots = [
            before_after(f"{name} error, ′", hours, before / 60.0, after / 60.0)
            for name, before, after in (
                ("Latitude", row.north_before_as, row.north_after_as),
                ("Longitude", row.east_before_as, row.east_after_as),
            )
        ]
        caption = (
            f"{row.name}: position error before and after {row.method}, less what the first stay foretells; "
            "longitude error times cos(latitude)."
        )
        blocks.append(lanes(f"errors-{number}", plots, "Time, h", caption, BEFORE_AFTER))
    return blocks


def _reductions(judgements: Sequence[Judgement]) -> list[Block]:
    rows = [
        named(
            judged.name,
            "held out" if judged.held_out else "fitted on",
            judged.method,
            significant(judged.rms_before_as / 60.0),
            significant(judged.rms_after_as / 60.0),
            Cell(fixed(judged.reduction_percent, 1), "plain" if judged.reduction_percent > 0.0 else "bad"),
        )
        for judged in judgements
    ]
    heads = ["Log", "Role", "Model", ">Before [′]", ">After [′]", ">Reduction [%]"]
    return [Table(heads, rows, "Rms position error after the first turn, both channels together.")]


def _temperature(study: HeadingStudy) -> list[Block]:
    course = study.course
    if not len(course.time_s):
        return []
    calm = np.where(course.settled, 1e3, np.nan)
    plots = [
        Panel(
            [
                Curve("after a turn", course.change_k, 1e3 * drift_dph, MUTED, width=0.8),
                Curve("settled", course.change_k, calm * drift_dph, PURPLE, width=3.0),
            ],
            f"axis {axis}",
            description=f"Drift about {axis} against temperature change",
        )
        for axis, drift_dph in zip(_AXES, course.drift_dph.T, strict=True)
    ]
    caption = (
        "Drift over the moving window against the mean temperature change of the last sidereal day. A function "
        "of temperature would be a line; loops and crossings are why a polynomial in temperature does not "
        "compensate it."
    )
    keys = [Key("settled", PURPLE), Key("after a turn", MUTED)]
    x_label, y_label = "Temperature change, K", "Drift, 10⁻³ °/h"
    return [
        panels("temperature-drift", plots, caption, keys, x_label=x_label, y_label=y_label, x_margin=0.05)
    ]


def _lagged(model: LaggedModel, model_file: str) -> list[Block]:
    heads = ["Term", *(f">{name} {axis} [10⁻³ °/h/K]" for axis in _AXES for name in ("k", "σ"))]
    pairs = np.stack((model.gain, model.sigma), axis=1).reshape(6, -1)
    rows = [
        named(term, *(fixed(1e3 * value, 3) for value in values))
        for term, values in zip(model.terms, pairs.T, strict=True)
    ]
    facts = [
        Fact("Time constant", f"{fixed(model.tau_s / _HOUR, 2)} h"),
        Fact("Reference temperature", f"{fixed(model.reference.coefficients[0], 3)} °C"),
    ]
    facts += [Fact("File", model_file)] if model_file else []
    return [Facts(facts), Table(heads, rows, "Gains of the lagged temperature change x, 1 sigma.")]


def _time_constants(found: Settling) -> list[Block]:
    rows = [
        named(
            name,
            *(
                (DASH, DASH, DASH)
                if constant is None
                else (
                    fixed(constant.tau_s / _HOUR, 2),
                    fixed(constant.sigma_s / _HOUR, 2),
                    fixed(constant.change_k, 2) if constant.change_k else DASH,
                )
            ),
        )
        for name, constant in (
            ("Temperature, start-up curve", found.start_up),
            ("Temperature, after turns", found.turns),
            ("Drift behind the temperature", found.core),
        )
    ]
    caption = (
        "How fast the measured temperature settles, by two ways that must agree, and by how much the drift "
        "follows it. A stay should outlast the slower of the two, and the window. — : the log does not show it."
    )
    return [Table(["Of what", ">τ [h]", ">σ [h]", ">Largest change [K]"], rows, caption)]


def _second(choice: SecondChoice | None) -> list[Block]:
    if choice is None:
        return []
    if not choice.left_out_as:
        return [Notes(["Fewer than four stays to leave out: the second temperature is not used."])]
    names = {
        "none": "first temperature alone",
        "temperature": "with the second",
        "gradient": "with their difference",
    }
    stayed = range(len(choice.left_out_as["none"]))
    heads = ["Input", *(f">Stay {number + 1} [″]" for number in stayed), "Used"]
    used = choice.kind or "none"
    rows = [
        named(names[kind], *(fixed(value, 1) for value in left), "yes" if kind == used else "")
        for kind, left in choice.left_out_as.items()
    ]
    caption = (
        "Position error that is left on each stay when it is left out of the fit, rms. The simplest input within "
        "one standard error of the best is used."
    )
    return [Table(heads, rows, caption)]


def _modulus(test: ModulusTest | None) -> list[Block]:
    if test is None:
        return []
    heads = [
        "Heading",
        *(f">{term} [µg]" for name in ("Mean", "Cosine", "Sine") for term in (name, "σ")),
        ">p",
    ]
    rows = []
    for heading, change, sigma, p_value in zip(
        test.headings_deg, test.change_ug, test.sigma_ug, test.p_value, strict=True
    ):
        values = [fixed(value, 2) for value in np.stack((change, sigma), axis=1).ravel()]
        tone: Tone = "bad" if p_value < test.limit else "plain"
        rows.append(named(f"{fixed(heading, 0)}°", *values, Cell(significant(p_value), tone)))
    caption = (
        "Change of the modulus of specific force from the reference heading, over the sidereal angle. No tilt "
        "changes it: what is found is the accelerometers' own error. A heading is called changed below "
        f"p = {test.limit:.2g}."
    )
    return [Table(heads, rows, caption)]


def _nine(nine: NineCoefficients | None, refused: str) -> list[Block]:
    if nine is None:
        return [Notes([refused] if refused else [])]
    heads = ["Coefficient", ">Value [10⁻³ °/h/K]", ">σ [10⁻³ °/h/K]", ">p", "Significant at 5 %"]
    rows = []
    for axis in range(3):
        for column, term in enumerate(("b0", "ac", "as")):
            sigma = None if nine.sigma_dph_per_k is None else 1e3 * float(nine.sigma_dph_per_k[axis, column])
            p_value = None if nine.p_value is None else float(nine.p_value[axis, column])
            word = DASH if p_value is None else "yes" if p_value < _SIGNIFICANT else "no"
            gain = fixed(1e3 * float(nine.gain_dph_per_k[axis, column]), 3)
            rows.append(named(f"{_AXES[axis]} {term}", gain, fixed(sigma, 3), fixed(p_value, 3), word))
    caption = (
        f"Mean drift of {nine.headings} steady headings against the Fourier terms of their temperature; "
        f"condition {fixed(nine.condition, 1)}."
    )
    if nine.p_value is None:
        caption += " Three headings determine the nine exactly: nothing is left over to judge them by."
    return [Table(heads, rows, caption)]


def _evidence(study: HeadingStudy) -> list[Block]:
    evidence = study.model.evidence
    facts = [
        Fact("Cost without a heading effect", fixed(evidence.none, 0)),
        Fact("Cost with temperature", fixed(evidence.temperature, 0)),
        Fact("Cost with a constant drift at each heading", fixed(evidence.steps, 0)),
        Fact("Heading effect left to constant drifts", f"{fixed(100.0 * evidence.other_share, 1)} %"),
    ]
    return [Facts(facts)]


_TERMS = [
    (
        "Heading sensitivity",
        "Position error after the first turn, less what misalignment and drift of the first stay foretell.",
    ),
    ("Reduction", "1 − rms after / rms before, latitude and longitude together."),
    ("Cost", "Sum of squared residuals in units of the assumed noise, with the priors' own terms."),
    ("b0, ac, as", "Mean, cosine and sine over the sidereal angle of the temperature's change."),
]
