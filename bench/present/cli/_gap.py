"""`gyrobench gap diagnose` and `gyrobench gap close`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from bench.analysis.common.state_file import save_file
from bench.analysis.gap import (
    Diagnosis,
    Recordings,
    Suggestion,
    closed_model,
    diagnose,
    diagnosis_facts,
    differences,
    model_text,
    read_model,
    read_recordings,
    suggest,
)
from bench.present.cli._console import Terminal
from bench.present.cli._gap_text import print_position, print_rate
from bench.present.report import GapContent, HeadingContent, render_gap, render_heading
from drivers.base.clock import utc_now


@dataclass(frozen=True)
class NextRun:
    """Where and how the suggested procedure is to be run: on the bench, or on a lab emulated after it."""

    bench: Path
    runs: Path
    plant: Path | None
    emulated: bool
    seed: int | None
    yes: bool


def gap_diagnose_command(
    runs: Sequence[Path],
    model: Path,
    held_out: Sequence[Path],
    gyro: str | None,
    as_json: bool,
    report: Path | None = None,
    then: NextRun | None = None,
) -> None:
    """Say where simulation and bench part, which effect is missing, and how far the gap closes with it.

    `then`: run what would decide most, and diagnose again with that run among the others.
    """
    console = Terminal()
    nominal = read_model(model)
    with console.status("diagnosing"):
        given = read_recordings(runs, held_out, gyro)
        found = diagnose(given.runs, nominal, given.held_out, given.missing)
        following = suggest(found)
    if then is not None and following:
        folder = _run_next(console, following[0], found, then, as_json)
        gap_diagnose_command([*runs, folder], model, held_out, gyro, as_json, report)
        return
    if report is not None:
        report.parent.mkdir(parents=True, exist_ok=True)
        save_file(report, _page(found, given, following, model))
    if as_json:
        console.print_json(json.dumps(diagnosis_facts(found, following)))
        return
    if found.position is not None:
        print_position(console, found.unit_id, found.position)
    else:
        print_rate(console, found, following)
    if then is not None:
        console.print("  nothing was run: no procedure of the bench would decide more")
    if report is not None:
        console.print(f"report: {report}", highlight=False, soft_wrap=True)


def _page(found: Diagnosis, given: Recordings, following: Sequence[Suggestion], model: Path) -> str:
    if found.position is not None:
        runs = dict(found.run_checksums)
        return render_heading(HeadingContent(found.position.study, found.unit_id, utc_now(), runs))
    shown = differences(given.shown, found.model, closed_model(found))
    return render_gap(GapContent(found, shown, utc_now(), model.name, following))


def _run_next(
    console: Console, suggestion: Suggestion, found: Diagnosis, then: NextRun, as_json: bool
) -> Path:
    from bench.present.cli._gap_rehearse import run_suggestion

    if not as_json:
        named = ", ".join(cause.name for cause in found.rate.causes) or "no cause named"
        console.print(
            f"so far: {found.verdict}, {named}; now {suggestion.procedure} ({suggestion.parameters}, "
            f"{suggestion.hours:.1f} h of bench time) to decide {suggestion.decides}",
            highlight=False,
        )
    return run_suggestion(
        suggestion,
        then.bench,
        then.runs,
        then.plant,
        emulated=then.emulated,
        seed=then.seed,
        yes=then.yes,
        as_json=as_json,
    )


def gap_close_command(runs: Sequence[Path], model: Path, gyro: str | None, out: Path | None) -> None:
    """Write the nominal model with the effects that the runs show: fitted parameters, uncertainties, runs."""
    console = Terminal()
    given = read_recordings(runs, gyro=gyro)
    found = diagnose(given.runs, read_model(model), missing=given.missing)
    if not found.closing:
        named = "".join(f", {cause.name}" for cause in found.causes)
        console.print(
            f"{found.verdict}{named}: there is no effect to put into the model",
            style="yellow",
            highlight=False,
        )
        return
    path = out or model.with_name(f"{model.stem}+{'+'.join(found.closing)}.toml")
    save_file(path, model_text(closed_model(found)))
    console.print(f"{path}", highlight=False)
