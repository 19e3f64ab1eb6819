"""Where a gap lies: maps of runs, phases and operating regimes against the time scale, and curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from markupsafe import Markup

from bench.present.report._figures import Panel, panels
from bench.present.report._heat_map import HeatCell, heat_map
from bench.present.report._numbers import plain_name, significant
from bench.present.report._page import Block, Figures, Key, Notes

if TYPE_CHECKING:
    from bench.analysis.gap import Place, RateFinding


def where_blocks(found: RateFinding) -> list[Block]:
    """Return the maps by runs, by phases and by operating regime, or a note that there is no place."""
    blocks = rate_map("where", found, found.places, "The gap by runs and time scale")
    if not blocks:
        return [Notes(["No cell stands out of the noise floor."])]
    return [*blocks, *_phase_map(found), *_regime_maps(found)]


def rate_map(figure_id: str, found: RateFinding, places: Sequence[Place], caption: str) -> list[Block]:
    """Return a map of runs by time scale, nothing if no place stands out."""
    if not any(place.clear for place in places):
        return []
    text = f"{caption}: rms in °/h where significant, deeper the larger its share. Columns are periods."
    return [Figures([place_map(figure_id, places, found.bands, caption)], text)]


def place_map(figure_id: str, places: Sequence[Place], bands: Sequence[str], caption: str) -> Markup:
    """Return the drawing of a map of places by time scale, a line between profiles."""
    ordered = sorted(places, key=lambda place: (place.profile, place.start_s, place.part))
    rows = list(dict.fromkeys((place.profile, place.part) for place in ordered))
    names = {
        (profile, part): profile if part == "run" else ": ".join(filter(None, (profile, part)))
        for profile, part in rows
    }
    cells = {
        (names[place.profile, place.part], place.band): HeatCell(
            place.share, significant(place.rms, 2), place.clear
        )
        for place in places
    }
    columns = [band for band in bands if any(place.band == band for place in places)]
    starts = [k for k in range(1, len(rows)) if rows[k][0] != rows[k - 1][0]]
    return heat_map(figure_id, list(names.values()), columns, cells, groups=starts, description=caption)


def in_words(places: Sequence[Place]) -> list[Place]:
    """Return places of phases with the phases' names in words."""
    return [replace(place, part=plain_name(place.part)) for place in places]


def left_over_panels(figure_id: str, plots: Sequence[Panel], caption: str, keys: Sequence[Key]) -> Figures:
    """Return curves of what runs have left: a panel a run, two side by side, all on common axes."""
    columns = min(len(plots), 2)
    x_label = "Time since power-on, h"
    return panels(figure_id, plots, caption, keys, x_label=x_label, y_label="°/h", columns=columns)


def _phase_map(found: RateFinding) -> list[Block]:
    profiles = {place.profile for place in found.phases if place.clear}
    if not profiles:
        return []
    shown = in_words([place for place in found.phases if place.profile in profiles])
    caption = "The gap by phase and time scale"
    text = f"{caption}, in profiles with a gap: rms in °/h where significant."
    return [Figures([place_map("phases", shown, found.bands, caption)], text)]


def _regime_maps(found: RateFinding) -> list[Block]:
    drawn: list[Markup] = []
    for of in dict.fromkeys(place.of for place in found.regimes):
        regimes = [place for place in found.regimes if place.of == of]
        if len(regimes) < 2 or not any(place.p_value < 0.01 for place in regimes):
            continue
        columns = [f"{place.low:g}..{place.high:g}" for place in regimes]
        row = f"{of}, {regimes[0].unit}"
        cells = {
            (row, column): HeatCell(place.rms_dph, significant(place.rms_dph, 2), place.p_value < 0.01)
            for column, place in zip(columns, regimes, strict=True)
        }
        drawn.append(heat_map(f"regime-{len(drawn)}", [row], columns, cells, description=f"The gap by {of}"))
    if not drawn:
        return []
    return [Figures(drawn, "The gap by operating regime, all runs: rms in °/h where significant.")]
