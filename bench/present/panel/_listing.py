"""A run as a row of a list: what it was, how it ended, and its papers one click away."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from bench.present.panel._benches import Benches
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._texts import duration
from bench.record.run_notes import RunNote

_LONGEST_NOTE = 160
_OUTCOMES = {"completed": "✓ completed", "invalid": "! invalid", "aborted": "✕ aborted"}


def listed(entry: Entry, folder: RunsFolder, benches: Benches) -> dict[str, Any]:
    """Return a run as a row for the page; `kind` is the colour of its outcome, `papers` (what, address)."""
    manifest = entry.manifest
    row: dict[str, Any] = dict.fromkeys(
        ("procedure", "units", "bench", "started", "length", "why", "noted"), ""
    )
    row |= {"run": entry.name, "outcome": "✕ cannot be read", "kind": "aborted", "serials": [], "papers": []}
    if manifest is None:
        return row | {"why": entry.problem}
    run = folder.root / entry.name
    outcome, kind, why = _OUTCOMES.get(manifest.outcome, ""), manifest.outcome, manifest.reason
    if not manifest.complete:
        outcome, kind, why = "✕ not closed", "aborted", "its process has ended: `gyrobench runs recover`"
        if benches.goes_on(run):
            outcome, kind, why = "● running", "running", ""
    if aside := folder.set_aside(run):
        outcome, kind, why = "✕ set aside", "aborted", aside
    papers = [("curves", f"/curves?run={quote(entry.name, safe='')}")]
    papers += [("report", f"/report/{quote(entry.name)}")] if manifest.complete else []
    if run.parent.name == "runs" and run.parent != folder.root:
        papers += [paper for paper in folder.papers(run.parent.parent) if paper[0] == "certificate"]
    if manifest.complete and (queue := folder.queues.get(manifest.bench_name)):
        papers.append(("repeat", f"{queue}?run={quote(entry.name)}"))
    return row | {
        "procedure": manifest.procedure,
        "units": ", ".join(manifest.units.values()),
        "serials": list(dict.fromkeys(manifest.units.values())),
        "bench": manifest.bench_name + (" (emulated)" if manifest.emulated else ""),
        "started": manifest.started_utc[:16].replace("T", " "),
        "length": duration(manifest.duration_s),
        "outcome": outcome,
        "kind": kind,
        "why": why,
        "papers": papers,
        "noted": _noted(folder.notes(run)),
    }


def _noted(notes: Sequence[RunNote]) -> str:
    """Return the newest note in a line, and how many there are."""
    if not notes:
        return ""
    newest = notes[-1]
    text = newest.text if len(newest.text) <= _LONGEST_NOTE else f"{newest.text[:_LONGEST_NOTE]}…"
    count = f" ({len(notes)} notes)" if len(notes) > 1 else ""
    return f"{newest.by}: {text or 'a picture'}{count}"
