"""The report of a look at a log: what it holds, every axis at its full rate, what cannot be known from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.present.look_words import (
    clock_words,
    motion_words,
    noise_words,
    noticed,
    nyquist_words,
)  # fmt: skip
from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._numbers import DASH, moment, significant, unit_text
from bench.present.report._page import Cell, Fact, Figures, Key, Notes, Page, Section, Table, Verdict, named
from bench.present.report._palette import BLUE, GREEN, MUTED, ORANGE, PURPLE, SAND, Paint
from bench.present.report._parts import interval, made

if TYPE_CHECKING:
    from bench.analysis.look import AxisLook, Look

_PAINTS: dict[str, Paint] = {"x": BLUE, "y": ORANGE, "z": GREEN}
_COEFFICIENTS = ("Quantisation", "Random walk", "Instability", "Rate random walk", "Ramp")
_MOST_POINTS = 400
_TERMS = [
    ("Mean", "Of all rests, 1σ from the means of 32 blocks, their correlation counted."),
    ("Allan deviation", "Overlapping, at the log's own rate, over the longest unbroken rest (IEEE Std 952)."),
    (
        "Fit",
        "The five coefficients describe the curve if they leave its 99.9 % interval by less than a fifth.",
    ),
    (
        "Line",
        "A bin that noise reaches once in 1000 spectra; amplitude of the sine, and times the noise around.",
    ),
    ("Follows", "Part of the variance of each leg of temperature that a fit on the other legs foretells."),
]


def look_page(found: Look, *, checksum: str, created_utc: str) -> Page:
    """Return the report of a look at a log with that SHA-256."""
    unfit = [axis.channel.name for axis in found.axes if axis.allan is not None and not axis.allan.fits]
    sentences = [f"{clock_words(found)}.", f"{motion_words(found)}."]
    if unfit:
        sentences.append(f"The five noises do not describe the Allan deviation of {', '.join(unfit)}.")
    return Page(
        title=f"A look at {found.log.name}",
        kind="Gyros and accelerometers of a log, at its full rate",
        facts=[
            Fact("Log", found.log.name),
            Fact("SHA-256", checksum, code=True),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=Verdict(
            "Some things cannot be known" if found.questions else "Read", "doubt" if found.questions else "good",
            sentences,
        ),
        sections=[
            Section("Not known from the log", [Notes(found.questions, "doubt")]),
            Section("How it was read", [Notes(found.remarks)]),
            Section("Axes", [_axes(found), _courses(found)]),
            Section("Noise", [_noise(found), *_allans(found)]),
            Section("Spectrum", [*_spectra(found), _lines(found)], nyquist_words(found)),
        ],
        terms=_TERMS,
        colophon=made(created_utc),
    )  # fmt: skip


def _axes(found: Look) -> Table:
    rows = [
        named(
            axis.channel.name,
            axis.channel.kind,
            unit_text(axis.channel.base_unit),
            significant(axis.figures.mean, 5),
            significant(axis.figures.mean_sigma, 2),
            significant(axis.figures.sigma, 3),
            significant(axis.figures.drift_per_h, 3),
            significant(axis.figures.drift_sigma, 2),
            significant(axis.figures.quantum, 3),
            "; ".join(noticed(axis)) or DASH,
        )
        for axis in found.axes
    ]
    heads = [
        "Axis",
        "Kind",
        "Unit",
        ">Mean",
        ">1σ of the mean",
        ">1σ of samples",
        ">Drift [1/h]",
        ">1σ of drift",
    ]
    return Table([*heads, ">Quantum", "Noticed"], rows, "Figures at rest, in the unit of the row.")


def _courses(found: Look) -> Figures:
    plots = []
    for label, axes in _groups(found):
        curves = []
        for axis in axes:
            x = np.arange(len(axis.values)) / found.clock.per_s
            curves.append(Curve(axis.channel.axis or axis.channel.name, x, axis.values, _paint(axis)))
        plots.append(Lane(label, curves, height=120.0))
    plots += [
        Lane("Temperature, °C", [Curve(name, np.arange(len(values)) / found.clock.per_s, values, SAND)], 90.0)
        for name, values in list(found.temperatures.items())[:1]
    ]
    turns = [(turn.start_s, turn.stop_s, f"turn {turn.axis}") for turn in found.motion.turns]
    caption = "Extremes of every bucket of samples." + (" Shaded: the unit turns." if turns else "")
    shading = [part for turn in turns for part in (turn, (turn[1], turn[1], ""))]
    return lanes("course", plots, _time_label(found), caption, phases=shading)


def _groups(found: Look) -> list[tuple[str, list[AxisLook]]]:
    groups: dict[str, list[AxisLook]] = {}
    for axis in found.axes:
        label = f"{axis.channel.kind.capitalize()}, {unit_text(axis.channel.base_unit)}"
        groups.setdefault(label, []).append(axis)
    return list(groups.items())


def _time_label(found: Look) -> str:
    return "Time since the first row, s" if found.clock.known else "Row"


def _noise(found: Look) -> Table:
    rows = []
    for axis in found.axes:
        allan = axis.allan
        if allan is None:
            continue
        fit = Cell("fits", "good") if allan.fits else Cell(noise_words(axis), "bad")
        parts = zip(
            _COEFFICIENTS, allan.coefficients, allan.coefficient_low, allan.coefficient_high, strict=True
        )
        for number, (name, value, low, high) in enumerate(parts):
            heading = (axis.channel.name, unit_text(allan.unit)) if number == 0 else ("", "")
            cells = (name, significant(value, 3), interval(low, high))
            rows.append(named(*heading, *cells, fit if number == 0 else ""))
    caption = "Coefficients with 95 % intervals, in the axis' unit, times in h."
    return Table(["Axis", "Unit", "Coefficient", ">Value", ">95 % interval", "Fit"], rows, caption)


def _allans(found: Look) -> list[Figures]:
    figures = []
    for number, (label, axes) in enumerate(_groups(found)):
        plots = []
        for axis in axes:
            if axis.allan is None:
                continue
            tau = np.log10(axis.allan.tau_s)
            with np.errstate(divide="ignore"):
                curves = [
                    Curve("measured", tau, np.log10(axis.allan.deviation), BLUE),
                    Curve("low", tau, np.log10(axis.allan.low), MUTED, ":"),
                    Curve("high", tau, np.log10(axis.allan.high), MUTED, ":"),
                    Curve("fit", tau, np.log10(axis.allan.fitted), ORANGE, "--"),
                ]
            plots.append(Panel(curves, axis.channel.name, noise_words(axis), description=axis.channel.name))
        if plots:
            keys = (Key("measured", BLUE), Key("95 % interval", MUTED), Key("five noises fitted", ORANGE))
            unit = unit_text(axes[0].allan.unit if axes[0].allan else axes[0].channel.base_unit)
            caption = f"Allan deviation: {label.split(',')[0].lower()}."
            x_label = f"log10 of averaging time, {'s' if found.clock.known else 'samples'}"
            y_label = f"log10 of deviation, {unit}"
            figures.append(panels(f"allan-{number}", plots, caption, keys, x_label=x_label, y_label=y_label))
    return figures


def _spectra(found: Look) -> list[Figures]:
    figures = []
    for number, (label, axes) in enumerate(_groups(found)):
        plots = []
        for axis in axes:
            if axis.spectrum is None:
                continue
            x, y = _thinned(axis.spectrum.frequency_hz, axis.spectrum.density)
            note = f"{axis.spectrum.averages} segments"
            plots.append(
                Panel([Curve("", x, y, _paint(axis), width=0.9)], axis.channel.name, note, description=label)
            )
        if plots:
            unit = axes[0].channel.base_unit
            x_label = "log10 of frequency, Hz" if found.clock.known else "log10 of frequency, 1/sample"
            caption = f"Amplitude density: {label.split(',')[0].lower()}, extremes of buckets."
            figures.append(
                panels(
                    f"psd-{number}",
                    plots,
                    caption,
                    (),
                    x_label=x_label,
                    y_label=f"log10, {unit_text(unit)}/√Hz",
                )
            )
    return figures


def _thinned(frequency: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return log10 of frequency and amplitude density: lowest and highest of buckets equal in log frequency."""
    x, y = np.log10(frequency), 0.5 * np.log10(density)
    if len(x) <= _MOST_POINTS:
        return x, y
    bucket = np.floor((x - x[0]) / (x[-1] - x[0]) * (_MOST_POINTS / 2)).astype(int)
    starts = np.flatnonzero(np.diff(bucket, prepend=-1))
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    return np.repeat(x[starts], 2), np.stack([low, high], axis=1).ravel()


def _lines(found: Look) -> Table:
    rows = [
        named(
            axis.channel.name,
            significant(line.frequency_hz, 5),
            significant(line.amplitude, 3),
            unit_text(axis.channel.base_unit),
            significant(line.times_noise, 2),
            "band" if line.broad else "line",
        )
        for axis in found.axes
        for line in (axis.spectrum.lines if axis.spectrum else ())
    ]
    heads = ["Axis", ">Frequency [Hz]", ">Amplitude", "Unit", ">Times the noise", "Shape"]
    return Table(
        heads, rows, "Lines by the frequency that they have in the record; the 12 strongest of an axis."
    )


def _paint(axis: AxisLook) -> Paint:
    return _PAINTS.get(axis.channel.axis, PURPLE)
