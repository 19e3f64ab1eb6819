"""A run as a row of a list: what it was, how it ended, and its papers one click away."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from bench.present.panel._benches import Benches
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._texts import duration

_OUTCOMES = {"completed": "✓ completed", "invalid": "! invalid", "aborted": "✕ aborted"}


def listed(entry: Entry, folder: RunsFolder, benches: Benches) -> dict[str, Any]:
    """Return a run as a row for the page; `kind` is the colour of its outcome, `papers` (what, address)."""
    manifest = entry.manifest
    row: dict[str, Any] = {"run": entry.name, "outcome": "✕ cannot be read", "kind": "aborted"}
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
    papers = [("report", f"/report/{quote(entry.name)}")] if manifest.complete else []
    if run.parent.name == "runs" and run.parent != folder.root:
        papers += [paper for paper in folder.papers(run.parent.parent) if paper[0] == "certificate"]
    if manifest.complete and (queue := folder.queues.get(manifest.bench_name)):
        papers.append(("repeat", f"{queue}?run={quote(entry.name)}"))
    return row | {
        "procedure": manifest.procedure,
        "units": ", ".join(manifest.units.values()),
        "bench": manifest.bench_name + (" (emulated)" if manifest.emulated else ""),
        "started": manifest.started_utc[:16].replace("T", " "),
        "length": duration(manifest.duration_s),
        "outcome": outcome,
        "kind": kind,
        "why": why,
        "papers": papers,
    }
