"""The part of a gap report on what is faster than the means: spectra of the rows, lines and bands in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._decimation import thinned_spectrum
from bench.present.report._figures import Curve, Panel, panels
from bench.present.report._gap_where import gap_map
from bench.present.report._numbers import DASH, fixed, plain_name, significant
from bench.present.report._page import Block, Key, Notes, Table, named
from bench.present.report._palette import BLUE, MUTED, ORANGE

if TYPE_CHECKING:
    from bench.analysis.gap import FastFinding

_MOST_PANELS = 6


def fast_blocks(found: FastFinding | None) -> list[Block]:
    """Return what the rows' noise is, a map, spectra of the phases with most of the gap, and a table of lines."""
    if found is None:
        return []
    sentences = [
        f"{found.verdict.capitalize()}: {found.floor.sentence}.",
        *(f"{note}." for note in found.notes),
    ]
    if found.lines:
        sentences.append(found.alias_sentence)
    blocks: list[Block] = [Notes(sentences, "plain" if found.verdict in ("no gap", "explained") else "doubt")]
    about = ": rms in °/h where significant."
    blocks += gap_map("fast", found.places, found.bands, "Above half the rate of the means, by phase", about)
    blocks.append(_spectra(found))
    if found.lines:
        blocks.append(_lines(found))
    return blocks


def _spectra(found: FastFinding) -> Block:
    energy: dict[tuple[str, str], float] = {}
    for place in found.places:
        key = place.profile, place.part
        energy[key] = max(energy.get(key, 0.0), place.energy_ratio)
    shown = sorted(found.pools, key=lambda pool: -energy[pool.profile, pool.phase])[:_MOST_PANELS]
    several = len({pool.profile for pool in found.pools}) > 1
    plots = []
    for pool in shown:
        x, y = thinned_spectrum(pool.frequency_hz, pool.density)
        floor = 0.5 * np.log10(found.floor.density(pool.frequency_hz, pool.row_s))
        curves = [
            Curve("rows", x, y, BLUE, width=0.9),
            Curve("floor", np.log10(pool.frequency_hz), floor, ORANGE, "--"),
            Curve("means", np.full(2, np.log10(0.5)), np.array([y.min(), y.max()]), MUTED, ":"),
        ]
        title = pool.name if several else plain_name(pool.phase)
        plots.append(Panel(curves, title, f"runs: {pool.runs}", description=pool.name))
    keys = (Key("rows", BLUE), Key("noise of the rows", ORANGE), Key("0.5 Hz", MUTED))
    more = "" if len(shown) == len(found.pools) else f" The {len(shown)} phases with most of the gap."
    return panels(
        "fast-spectra", plots, f"Amplitude density of the rows by phase, extremes of buckets.{more}", keys,
        x_label="log10 of frequency, Hz", y_label="log10, °/h/√Hz",
    )  # fmt: skip


def _lines(found: FastFinding) -> Table:
    rows = []
    held = next(iter(found.held_out), None)
    for line in found.lines:
        most = max(line.amplitudes_dph, key=lambda name: line.amplitudes_dph[name])
        rows.append(
            named(
                "band" if line.broad else "line",
                significant(line.frequency_hz, 5),
                significant(line.width_hz, 2) if line.broad else DASH,
                significant(line.amplitude_dph, 3),
                "all phases" if line.everywhere else most,
                str(line.order) if line.order else DASH,
            )
        )
    heads = ["Shape", ">Frequency [Hz]", ">Width [Hz]", ">Amplitude [°/h]", "Where", ">Times a turn"]
    caption = "Lines and bands; amplitude of a sine of the same power, largest of all phases."
    if held is not None:
        caption += (
            f" In held-out runs {fixed(100.0 * held.share, 1)} % of the lines' power is what was found."
        )
    return Table(heads, rows, caption)
