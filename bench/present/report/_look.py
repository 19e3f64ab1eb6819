"""The report of a look at a log: what it holds, every axis at its full rate, what cannot be known from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bench.present.look_words import (
    clock_words,
    frequency_unit,
    motion_words,
    noise_words,
    noticed,
    nyquist_words,
)
from bench.present.report._decimation import thinned_spectrum
from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._numbers import DASH, moment, significant, unit_text
from bench.present.report._page import Cell, Fact, Figures, Key, Notes, Page, Section, Table, Verdict, named
from bench.present.report._palette import BLUE, GREEN, MUTED, ORANGE, PURPLE, SAND, Paint
from bench.present.report._parts import interval, made
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.look import AxisLook, Look

_PAINTS: dict[str, Paint] = {"x": BLUE, "y": ORANGE, "z": GREEN}
_COEFFICIENTS = ("Quantisation", "Random walk", "Instability", "Rate random walk", "Ramp")
_TERMS = [
    ("Mean", "Of all rests, 1σ from the means of 32 blocks, their correlation counted."),
    ("Allan deviation", "Overlapping, at the log's own rate, over the longest unbroken rest (IEEE Std 952)."),
    (
        "Fit",
        "The five coefficients describe the curve if they leave its 99.9 % interval by less than a fifth.",
    ),
    ("Line", "A bin that noise reaches once in 1000 spectra; amplitude of the sine, times the noise around."),
    ("Follows", "Part of the variance of each leg of temperature that a fit on the other legs foretells."),
]


def look_page(found: Look, *, checksum: str, created_utc: str) -> Page:
    """Return the report of a look at a log with that SHA-256."""
    unfit = [axis.channel.name for axis in found.axes if axis.allan is not None and not axis.allan.fits]
    sentences = [f"{clock_words(found)}.", f"{motion_words(found)}."]
    if unfit:
        sentences.append(f"The five noises do not describe the Allan deviation of {', '.join(unfit)}.")
    verdict = Verdict("Read", "good", sentences)
    if found.questions:
        verdict = Verdict("Some things cannot be known", "doubt", sentences)
    return Page(
        title=f"A look at {found.log.name}",
        kind="Gyros and accelerometers of a log, at its full rate",
        facts=[
            Fact("Log", found.log.name),
            Fact("SHA-256", checksum, code=True),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=verdict,
        sections=[
            Section("Not known from the log", [Notes(found.questions, "doubt")]),
            Section("How it was read", [Notes(found.remarks)]),
            Section("Axes", [_axes(found), _courses(found)]),
            Section("Noise", [_noise(found), *_allans(found)]),
            Section("Spectrum", [*_spectra(found), _lines(found)], nyquist_words(found)),
        ],
        terms=_TERMS,
        colophon=made(created_utc),
    )


def _axes(found: Look) -> Table:
    heads = (
        "Axis",
        "Kind",
        "Unit",
        ">Mean",
        ">1σ of the mean",
        ">1σ of samples",
        ">Drift [1/h]",
        ">1σ of drift",
    )
    rows = []
    for axis in found.axes:
        kind, unit, own = axis.channel.kind, unit_text(axis.channel.base_unit), axis.figures
        figures = (
            (own.mean, 5),
            (own.mean_sigma, 2),
            (own.sigma, 3),
            (own.drift_per_h, 3),
            (own.drift_sigma, 2),
        )
        cells = [significant(*figure) for figure in (*figures, (own.quantum, 3))]
        if not axis.clock_known:
            cells[3:5] = [DASH, DASH]
        rows.append(named(axis.channel.name, kind, unit, *cells, "; ".join(noticed(axis)) or DASH))
    return Table([*heads, ">Quantum", "Noticed"], rows, "Figures at rest, in the unit of the row.")


def _courses(found: Look) -> Figures:
    def lane(label: str, values: dict[str, tuple[Array, Paint]], height: float) -> Lane:
        curves = [
            Curve(name, np.arange(len(column)) / found.clock.per_s, column, paint)
            for name, (column, paint) in values.items()
        ]
        return Lane(label, curves, height)

    plots = [
        lane(label, {one.channel.axis or one.channel.name: (one.values, _paint(one)) for one in axes}, 120.0)
        for label, axes in _groups(found)
    ]
    for name, values in list(found.temperatures.items())[:1]:
        plots.append(lane("Temperature, °C", {name: (values, SAND)}, 90.0))
    shading = []
    for turn in found.motion.turns:
        shading += [(turn.start_s, turn.stop_s, f"turn {turn.axis}"), (turn.stop_s, turn.stop_s, "")]
    caption = "Extremes of every bucket of samples." + (" Shaded: the unit turns." if shading else "")
    label = "Time since the first row, s" if found.clock.known else "Row"
    return lanes("course", plots, label, caption, phases=shading)


def _groups(found: Look) -> list[tuple[str, list[AxisLook]]]:
    groups: dict[str, list[AxisLook]] = {}
    for axis in found.axes:
        label = f"{axis.channel.kind.capitalize()}, {unit_text(axis.channel.base_unit)}"
        groups.setdefault(label, []).append(axis)
    return list(groups.items())


def _noise(found: Look) -> Table:
    rows = []
    for axis in found.axes:
        if axis.allan is None:
            continue
        fit = Cell("fits", "good") if axis.allan.fits else Cell(noise_words(axis), "bad")
        for number, (name, part) in enumerate(zip(_COEFFICIENTS, axis.allan.coefficients.T, strict=True)):
            heads = (axis.channel.name, unit_text(axis.allan.unit)) if number == 0 else ("", "")
            value, low, high = part.tolist()
            rows.append(
                named(*heads, name, significant(value, 3), interval(low, high), fit if number == 0 else "")
            )
    times = "times in h" if found.clock.known else "3600 samples counting as an hour"
    caption = f"Coefficients with 95 % intervals, in the axis' unit, {times}."
    return Table(["Axis", "Unit", "Coefficient", ">Value", ">95 % interval", "Fit"], rows, caption)


def _allans(found: Look) -> list[Figures]:
    def panel(axis: AxisLook) -> Panel | None:
        if (allan := axis.allan) is None:
            return None
        tau = np.log10(allan.tau_s)
        with np.errstate(divide="ignore"):
            curves = [
                Curve("measured", tau, np.log10(allan.deviation), BLUE),
                Curve("low", tau, np.log10(allan.low), MUTED, ":"),
                Curve("high", tau, np.log10(allan.high), MUTED, ":"),
                Curve("fit", tau, np.log10(allan.fitted), ORANGE, "--"),
            ]
        return Panel(curves, axis.channel.name, noise_words(axis), description=axis.channel.name)

    keys = (Key("measured", BLUE), Key("95 % interval", MUTED), Key("five noises fitted", ORANGE))
    x_label = f"log10 of averaging time, {'s' if found.clock.known else 'samples'}"
    return _figures(found, "Allan deviation", panel, keys, x_label, "log10 of deviation, {}")


def _spectra(found: Look) -> list[Figures]:
    def panel(axis: AxisLook) -> Panel | None:
        if (spectrum := axis.spectrum) is None:
            return None
        curve = Curve("", *thinned_spectrum(spectrum.frequency_hz, spectrum.density), _paint(axis), width=0.9)
        return Panel(
            [curve], axis.channel.name, f"{spectrum.averages} segments", description=axis.channel.name
        )

    x_label = f"log10 of frequency, {frequency_unit(clock_known=found.clock.known)}"
    return _figures(found, "Amplitude density, extremes of buckets", panel, (), x_label, "log10, {}/√Hz")


def _figures(
    found: Look, what: str, panel: Callable[[AxisLook], Panel | None], keys: tuple[Key, ...],
    x_label: str, y_label: str,
) -> list[Figures]:  # fmt: skip
    figures = []
    for number, (label, axes) in enumerate(_groups(found)):
        if plots := [plot for plot in map(panel, axes) if plot is not None]:
            allan = axes[0].allan if what.startswith("Allan") else None
            unit = unit_text(allan.unit if allan else axes[0].channel.base_unit)
            caption = f"{what}: {label.split(',')[0].lower()}."
            figure_id = f"{what.split()[0].lower()}-{number}"
            figures.append(
                panels(figure_id, plots, caption, keys, x_label=x_label, y_label=y_label.format(unit))
            )
    return figures


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
    unit = frequency_unit(clock_known=found.clock.known)
    heads = ["Axis", f">Frequency [{unit}]", ">Amplitude", "Unit", ">Times the noise", "Shape"]
    caption = "Lines by the frequency that they have in the record; the 12 strongest of an axis."
    return Table(heads, rows, caption)


def _paint(axis: AxisLook) -> Paint:
    return _PAINTS.get(axis.channel.axis, PURPLE)
