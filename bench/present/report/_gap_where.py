"""Maps of where a gap lies: by runs, phases and operating regimes, each against the time scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from bench.present.report._heat_map import HeatCell, heat_map
from bench.present.report._numbers import significant
from bench.present.report._page import Block, Figures, Notes

if TYPE_CHECKING:
    from bench.analysis.gap import Place, RateFinding


def where_blocks(found: RateFinding) -> list[Block]:
    """Return the maps by runs, by phases and by operating regime, or a note that there is no place."""
    blocks = place_map("where", found.places, "The gap by runs and time scale")
    if not blocks:
        return [Notes(["No cell stands out of the noise floor."])]
    return [*blocks, *_phase_map(found.phases), *_regime_maps(found)]


def place_map(figure_id: str, places: Sequence[Place], caption: str) -> list[Block]:
    """Return a map of runs by time scale, nothing if no place stands out."""
    if not any(place.clear for place in places):
        return []
    rows = list(dict.fromkeys((place.profile, place.part) for place in sorted(places, key=_row_order)))
    names = {each: each[0] if each[1] == "run" else f"{each[0]}: {each[1]}" for each in rows}
    columns = [band for band in _bands() if any(place.band == band for place in places)]
    cells = {
        (names[place.profile, place.part], place.band): HeatCell(
            place.share, significant(place.rms, 2), place.clear
        )
        for place in places
    }
    starts = [k for k in range(1, len(rows)) if rows[k][0] != rows[k - 1][0]]
    drawn = heat_map(figure_id, list(names.values()), columns, cells, groups=starts, description=caption)
    text = f"{caption}: rms in °/h where significant, deeper the larger its share. Columns are periods."
    return [Figures([drawn], text)]


def _row_order(place: Place) -> tuple[str, str]:
    return place.profile, place.part


def _bands() -> tuple[str, ...]:
    from bench.analysis.gap import BANDS

    return BANDS


def _phase_map(phases: Sequence[Place]) -> list[Block]:
    if not any(place.clear for place in phases):
        return []
    shown = sorted({place.profile for place in phases if place.clear})
    order = {
        (place.profile, place.part): None for place in sorted(phases, key=lambda p: (p.profile, p.start_s))
    }
    rows = [each for each in order if each[0] in shown]
    names = {each: f"{each[0]}: {each[1].replace('_', ' ')}" for each in rows}
    cells = {
        (names[place.profile, place.part], place.band): HeatCell(
            place.share, significant(place.rms, 2), place.clear
        )
        for place in phases
        if (place.profile, place.part) in names
    }
    starts = [k for k in range(1, len(rows)) if rows[k][0] != rows[k - 1][0]]
    caption = "The gap by phase and time scale"
    drawn = heat_map(
        "phases", list(names.values()), list(_bands()), cells, groups=starts, description=caption
    )
    return [Figures([drawn], f"{caption}, in profiles with a gap: rms in °/h where significant.")]


def _regime_maps(found: RateFinding) -> list[Block]:
    drawn: list[Markup] = []
    for of in dict.fromkeys(place.of for place in found.regimes):
        own = [place for place in found.regimes if place.of == of]
        if len(own) < 2 or not any(place.p_value < 0.01 for place in own):
            continue
        columns = [f"{place.low:g}..{place.high:g}" for place in own]
        row = f"{of}, {own[0].unit}"
        cells = {
            (row, column): HeatCell(place.rms_dph, significant(place.rms_dph, 2), place.p_value < 0.01)
            for column, place in zip(columns, own, strict=True)
        }
        drawn.append(heat_map(f"regime-{len(drawn)}", [row], columns, cells, description=f"The gap by {of}"))
    if not drawn:
        return []
    return [Figures(drawn, "The gap by operating regime, all runs: rms in °/h where significant.")]
