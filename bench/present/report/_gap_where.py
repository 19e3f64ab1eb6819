"""Where a gap lies: maps of runs, phases and operating regimes against the time scale, and curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup

from bench.present.report._figures import Curve, Panel, panels
from bench.present.report._heat_map import HeatCell, heat_map
from bench.present.report._numbers import plain_name, significant
from bench.present.report._page import Block, Figures, Key, Notes
from bench.present.report._palette import AFTER, BEFORE
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.gap import Place, RateFinding


OF_RUNS = ": rms in °/h where significant, deeper the larger its share. Columns are periods."


def where_blocks(found: RateFinding) -> list[Block]:
    """Return the maps by runs, by phases and by operating regime, or a note that there is no place."""
    caption = "The gap by runs and time scale"
    blocks = gap_map("where", found.places, found.bands, caption, OF_RUNS)
    if not blocks:
        return [Notes(["No cell stands out of the noise floor."])]
    profiles = {place.profile for place in found.phases if place.clear}
    phases = [place for place in found.phases if place.profile in profiles]
    about = ", in profiles with a gap: rms in °/h where significant."
    blocks += gap_map("phases", phases, found.bands, "The gap by phase and time scale", about)
    return blocks + _regime_maps(found)


def gap_map(
    figure_id: str, places: Sequence[Place], bands: Sequence[str], caption: str, more: str = ""
) -> list[Block]:
    """Return a map of places by time scale, a line between profiles; nothing if no place stands out."""
    if not any(place.clear for place in places):
        return []
    ordered = sorted(places, key=lambda place: (place.profile, place.start_s, place.part))
    several = len({place.profile for place in places}) > 1
    names = {
        (place.profile, place.part): place.profile
        if place.part == "run"
        else ": ".join(filter(None, (place.profile if several else "", plain_name(place.part))))
        for place in ordered
    }
    cells = {
        (names[place.profile, place.part], place.band): HeatCell(
            place.share, significant(place.rms, 2), place.clear
        )
        for place in places
    }
    columns = [band for band in bands if any(place.band == band for place in places)]
    profiles = [profile for profile, _ in names]
    starts = [k for k in range(1, len(profiles)) if profiles[k] != profiles[k - 1]]
    drawn = heat_map(figure_id, list(names.values()), columns, cells, groups=starts, description=caption)
    return [Figures([drawn], caption + more)]


def before_closed(time_s: Array, before: Array, closed: Array | None) -> list[Curve]:
    """Return what a run differs by from the nominal model, and from the closed one if there is one."""
    hours = time_s / 3600.0
    curves = [Curve("nominal", hours, before, BEFORE)]
    return curves if closed is None else [*curves, Curve("closed", hours, closed, AFTER)]


def keys_of(curves: Sequence[Curve], closed: str = "with the effects in it") -> list[Key]:
    """Return the legend of `before_closed`."""
    return [Key("nominal model", BEFORE), Key(closed, AFTER)][: len(curves)]


def left_over_panels(figure_id: str, plots: Sequence[Panel], caption: str, keys: Sequence[Key]) -> Figures:
    """Return curves of what runs have left: a panel a run, two side by side, all on common axes."""
    columns = min(len(plots), 2)
    x_label = "Time since power-on, h"
    return panels(figure_id, plots, caption, keys, x_label=x_label, y_label="°/h", columns=columns)


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
