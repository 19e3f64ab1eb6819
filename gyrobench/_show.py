"""Results as plots in a notebook, from the same figures as their reports."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from bench.present.report import Page, gap_page, look_page, render_page, run_content, run_page
from bench.record.recording import Run
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.gap import Diagnosis
    from bench.analysis.look import Look


class Plots:
    """The plots of a result: a notebook shows them, `save(file)` writes them as one HTML page."""

    def __init__(self, page: Page) -> None:
        self._page = page

    def __repr__(self) -> str:
        count = sum(len(getattr(b, "svgs", ())) for section in self._page.sections for b in section.blocks)
        return f"<Plots: {self._page.title}, {count} plots; a notebook shows them, save(file) writes HTML>"

    def _repr_html_(self) -> str:
        page = escape(render_page(self._page), quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%; height:40em; border:0"></iframe>'

    def save(self, file: Path | str) -> Path:
        """Write the plots as an HTML page that needs no other file; return its path."""
        path = Path(file)
        path.write_text(render_page(self._page), encoding="utf-8")
        return path


def plot(result: Run | Look | Diagnosis) -> Plots:
    """Return the plots of a run, of a log looked at, or of a diagnosis: those of its report, without the tables.

    Of a run: rates, temperatures and table over bench time (h), 100 s means in deg/h. Of a log: Allan deviation,
    spectrum, temperature. Of a diagnosis: the gap by time scale and run, in deg/h.
    """
    page = _page(result)
    sections = [
        replace(section, blocks=[block for block in section.blocks if getattr(block, "svgs", ())])
        for section in page.sections
    ]
    kept = [section for section in sections if section.blocks]
    return Plots(replace(page, facts=(), sections=kept, terms=(), colophon=""))


def _page(result: Run | Look | Diagnosis) -> Page:
    if isinstance(result, Run):
        return run_page(run_content(result), utc_now())
    from bench.analysis.look import Look

    if isinstance(result, Look):
        return look_page(result, checksum="", created_utc=utc_now())
    return gap_page(result, (), created_utc=utc_now(), model_file="")
