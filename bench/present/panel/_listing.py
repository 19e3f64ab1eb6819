"""A run as a row of a list: what it was, how it ended, and its papers one click away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from bench.present.panel._benches import Benches
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._texts import duration
from bench.record.run_notes import RunNote

CERTIFICATE = "certificate"
"""What a limit that a campaign's certificate judged is called in a search."""
_LONGEST_NOTE = 160
_OUTCOMES = {"completed": "✓ completed", "invalid": "! invalid", "aborted": "✕ aborted"}


def listed(entry: Entry, folder: RunsFolder, benches: Benches) -> dict[str, Any]:
    """Return a run as a row for the page; `kind` is the colour of its outcome, `papers` (what, address).

    `left_open`: its process ended without closing it, and the record can be completed.
    """
    manifest = entry.manifest
    row: dict[str, Any] = dict.fromkeys(
        ("procedure", "units", "bench", "started", "length", "why", "outside", "noted"), ""
    )
    row |= {"run": entry.name, "outcome": "✕ cannot be read", "kind": "aborted", "serials": [], "papers": []}
    row["left_open"] = False
    if manifest is None:
        return row | {"why": entry.problem}
    run = folder.root / entry.name
    outcome, kind, why = _OUTCOMES.get(manifest.outcome, ""), manifest.outcome, manifest.reason
    left_open = False
    if not manifest.complete:
        why = "its process has ended: complete the record on the page of its curves"
        outcome, kind, left_open = "✕ not closed", "aborted", True
        if benches.goes_on(run):
            outcome, kind, why, left_open = "● running", "running", "", False
    if aside := folder.set_aside(run):
        outcome, kind, why = "✕ set aside", "aborted", aside
    papers = [("curves", f"/curves?run={quote(entry.name, safe='')}")]
    papers += [("report", f"/report/{quote(entry.name)}")] if manifest.complete else []
    if run.parent.name == "runs" and run.parent != folder.root:
        papers += [paper for paper in folder.papers(run.parent.parent) if paper[0] == "certificate"]
    if manifest.complete and (queue := folder.queues.get(manifest.bench_name)):
        papers.append(("repeat", f"{queue.address}?run={quote(entry.name)}"))
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
        "left_open": left_open,
        "papers": papers,
        "outside": "; ".join(outside(entry, folder).values()),
        "noted": _noted(folder.notes(run)),
    }


def outside(entry: Entry, folder: RunsFolder) -> dict[str, str]:
    """Return which limits a run breaks, in words by name: of its measurements, of its campaign's certificate."""
    if entry.manifest is None:
        return {}
    found = {
        str(row["name"]): f"{row['name']} {_told(row.get('value'))} {row.get('unit', '')}, {_range(row)}"
        for row in entry.manifest.measurements
        if row.get("passed") is False
    }
    if folder.certified(folder.root / entry.name) is False:
        found[CERTIFICATE] = "the certificate of its campaign: not passed"
    return found


def _range(row: Mapping[str, Any]) -> str:
    """Return the limits of a measurement as one says them."""
    low, high = row.get("low"), row.get("high")
    if low is not None and high is not None:
        return f"allowed {_told(low)} to {_told(high)}"
    return f"at least {_told(low)}" if low is not None else f"at most {_told(high)}"


def _told(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, int | float) else "not known"


def _noted(notes: Sequence[RunNote]) -> str:
    """Return the newest note in a line, and how many there are."""
    if not notes:
        return ""
    newest = notes[-1]
    text = newest.text if len(newest.text) <= _LONGEST_NOTE else f"{newest.text[:_LONGEST_NOTE]}…"
    count = f" ({len(notes)} notes)" if len(notes) > 1 else ""
    return f"{newest.by}: {text or 'a picture'}{count}"
