"""`gyrobench gap diagnose` and `gyrobench gap close`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.analysis.common.state_file import save_file
from bench.analysis.gap import (
    Cause,
    Diagnosis,
    GapRun,
    Model,
    Shrinkage,
    Suggestion,
    closed_model,
    diagnose,
    differences,
    load_gap_runs,
    model_text,
    read_mapped_runs,
    read_model,
    shrinkage,
    suggest,
    with_channels,
)
from bench.present.cli._console import Terminal
from bench.present.cli._gap_channels import channel_facts, diagnosed_channels, print_channels
from bench.present.cli._gap_platform import of_platform, platform_close_command, platform_diagnose_command
from bench.present.report import GapContent, render_gap
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

_SIGNIFICANT = 0.01
_SHOWN = 8


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
    if of_platform([*runs, *(path for path in held_out if path.exists())]):
        platform_diagnose_command(runs, model, held_out, as_json, report)
        return
    console = Terminal()
    nominal = read_model(model)
    with console.status("diagnosing"):
        given, kept, held_out = _parted(_load(runs, gyro), held_out, gyro)
        found = diagnose(given, nominal)
        shrunk = _judged(found, kept, nominal) if kept else None
        following = suggest(found, given[0].stimulus.latitude_deg)
        channels = diagnosed_channels(runs, held_out, gyro, nominal)
    if then is not None and following:
        folder = _run_next(console, following[0], found, then, as_json)
        gap_diagnose_command([*runs, folder], model, held_out, gyro, as_json, report)
        return
    if report is not None:
        before = Model(nominal.name, found.model.terms, found.model.noise)
        shown = differences(kept or given, before, closed_model(found))
        content = GapContent(found, shrunk, shown, bool(kept), utc_now(), model.name, following, channels)
        report.parent.mkdir(parents=True, exist_ok=True)
        save_file(report, render_gap(content))
    if as_json:
        facts = _facts(found, shrunk, following) | {"channels": [channel_facts(each) for each in channels]}
        console.print_json(json.dumps(facts))
        return
    _print(console, found, shrunk)
    print_channels(console, channels)
    for each in following[:2]:
        console.print(
            f"  next: {each.procedure} ({each.parameters}, {each.hours:.1f} h): {each.decides}, "
            f"expected log odds {each.log_odds:.3g}",
            highlight=False,
        )
    if then is not None:
        console.print("  nothing was run: no procedure of the bench would decide more")
    if report is not None:
        console.print(f"report: {report}", highlight=False, soft_wrap=True)


def _run_next(
    console: Console, suggestion: Suggestion, found: Diagnosis, then: NextRun, as_json: bool
) -> Path:
    from bench.present.cli._gap_rehearse import run_suggestion

    if not as_json:
        named = ", ".join(cause.name for cause in found.causes) or "no cause named"
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
    if of_platform(runs):
        platform_close_command(runs, model, out)
        return
    console = Terminal()
    nominal = read_model(model)
    found = diagnose(_load(runs, gyro), nominal)
    channels = diagnosed_channels(runs, (), gyro, nominal)
    beside = [cause.effect.name for each in channels for cause in each.causes]
    disturbances = [term.name for term in found.disturbed.terms]
    names = "+".join([*(cause.name for cause in found.causes), *disturbances, *beside])
    if not names:
        console.print(f"{found.verdict}: there is no effect to put into the model", style="yellow")
        return
    own = replace(closed_model(found), channel_terms=nominal.channel_terms, accuracy=nominal.accuracy)
    closed = replace(with_channels(own, channels), name=f"{nominal.name}+{names}")
    path = out or model.with_name(f"{model.stem}+{names}.toml")
    save_file(path, model_text(closed))
    console.print(f"{path}", highlight=False)


def _load(folders: Sequence[Path], gyro: str | None) -> list[GapRun]:
    """Read run folders, and mapping files (.toml) of recordings made elsewhere."""
    runs: list[GapRun] = []
    for path in folders:
        runs += read_mapped_runs(path) if path.suffix == ".toml" else load_gap_runs(path, gyro)
    return runs


def _parted(
    given: Sequence[GapRun], held_out: Sequence[Path], gyro: str | None
) -> tuple[list[GapRun], list[GapRun], list[Path]]:
    """Return the runs to diagnose, those to judge on, and which of `held_out` are files.

    A held-out run is one of those given, by its id, or a folder or mapping file of its own.
    """
    ids = {run.run_id for run in given}
    named = {str(path) for path in held_out} & ids
    files = [path for path in held_out if str(path) not in named]
    for path in files:
        if not path.exists():
            raise ConfigurationError(
                "there is no such run to hold out",
                where="--held-out",
                found=str(path),
                expected="a run folder, a mapping file, or one of the runs given: " + ", ".join(sorted(ids)),
            )
    kept = [run for run in given if run.run_id in named] + _load(files, gyro)
    rest = [run for run in given if run.run_id not in named]
    if not rest:
        raise ConfigurationError(
            "every run is held out", where="--held-out", expected="at least one run to diagnose"
        )
    return rest, kept, files


def _judged(found: Diagnosis, held_out: Sequence[GapRun], nominal: Model) -> Shrinkage:
    before = Model(nominal.name, found.model.terms, found.model.noise)
    return shrinkage(before, closed_model(found), held_out, found.floor)


def _print(console: Console, found: Diagnosis, shrunk: Shrinkage | None) -> None:
    console.print(Text.assemble(f"unit {found.unit_id}: ", (found.verdict, "bold")))
    for cause in found.causes:
        console.print(f"  {_sentence(cause, found.model.noise.coarseness)}", highlight=False)
    for name, probability in found.stochastic.items():
        parts = [f"  {name} ({100 * probability:.0f} %)", found.size_of(name)]
        console.print(": ".join(filter(None, parts)), highlight=False)
    if found.unknown_probability > 0.5:
        near = ", ".join(cause.name for cause in found.resembles) or "nothing in the catalogue"
        chance = f"{100 * found.unknown_probability:.0f} %"
        console.print(
            f"  something that the catalogue lacks ({chance}); it resembles {near}", highlight=False
        )
        for part in found.unknown_parts:
            console.print(f"  {part.sentence}", highlight=False)
    console.print(_map("where", [p for p in found.places if p.p_value < _SIGNIFICANT][:_SHOWN]))
    if any(p.p_value < _SIGNIFICANT for p in found.left_places):
        console.print(_map("left", [p for p in found.left_places if p.p_value < _SIGNIFICANT][:_SHOWN]))
    console.print(_closing(shrunk), highlight=False)
    if shrunk is not None and shrunk.caution and found.causes:
        console.print(f"  {shrunk.caution}", style="bold red", highlight=False)
    for warning in found.warnings:
        console.print(f"  {warning}", style="yellow", highlight=False)
    if found.unidentifiable:
        names = ", ".join(found.unidentifiable)
        console.print(f"  not to be seen in these runs: {names}", style="dim", highlight=False)


def _sentence(cause: Cause, coarseness: float) -> str:
    values = cause.term.fitted(coarseness, "+-")
    rivals = ", ".join(f"{name} {100 * value:.0f} %" for name, value in cause.alternatives.items())
    told = f"; in its place could stand {rivals}" if rivals else ""
    return f"{cause.name} ({100 * cause.probability:.0f} %): {cause.meaning} {values}{told}"


def _map(title: str, places: Sequence[Any]) -> Table:
    table = Table("profile", "runs", "time scale", "rms deg/h", "share %", "energy / floor", title=title)
    for place in places:
        table.add_row(
            place.profile,
            place.parity,
            place.band,
            f"{place.rms_dph:.4f}",
            f"{100 * place.share:.0f}",
            f"{place.energy_ratio:.1f}",
        )
    return table


def _closing(shrunk: Shrinkage | None) -> str:
    if shrunk is None:
        return "no held-out runs: how far the gap shrinks is not known"
    if not shrunk.cells:
        return "no gap above the floor on the held-out runs"
    return (
        f"on held-out runs {100 * shrunk.share:.1f} % of the reducible gap is gone "
        f"({100 * shrunk.low:.1f} to {100 * shrunk.high:.1f} %): "
        f"{shrunk.rms_before_dph:.4f} -> {shrunk.rms_after_dph:.4f} deg/h rms above the floor"
    )


def _facts(
    found: Diagnosis, shrunk: Shrinkage | None, following: Sequence[Suggestion] = ()
) -> dict[str, Any]:
    return {
        "unit": found.unit_id,
        "verdict": found.verdict,
        "causes": [_cause_facts(cause) for cause in found.causes],
        "resembles": [_cause_facts(cause) for cause in found.resembles],
        "stochastic": dict(found.stochastic),
        "stochastic_coefficients": {
            name: found.noise.rises[name] for name in found.stochastic if name in found.noise.rises
        },
        "disturbances": [
            {
                "name": term.name,
                "parameters": _by_name(term.effect, term.values),
                "sigma": _by_name(term.effect, term.sigmas),
            }
            for term in found.disturbed.terms
        ],
        "unknown_probability": found.unknown_probability,
        "no_gap_probability": found.null_probability,
        "sets": {" + ".join(sorted(names)): value for names, value in found.set_probabilities.items()},
        "places": [vars(place) for place in found.places],
        "phases": [vars(place) for place in found.phases],
        "regimes": [vars(place) for place in found.regimes],
        "unknown_parts": [
            {key: value for key, value in vars(part).items() if key != "term"} for part in found.unknown_parts
        ],
        "next": [vars(each) for each in following],
        "left": [vars(place) for place in found.left_places],
        "unidentifiable": dict(found.unidentifiable),
        "warnings": list(found.warnings),
        "runs": dict(found.run_checksums),
        "held_out": None if shrunk is None or not shrunk.cells else _shrinkage_facts(shrunk),
    }


def _cause_facts(cause: Cause) -> dict[str, Any]:
    effect = cause.term.variant.effect
    return {
        "name": cause.name,
        "probability": cause.probability,
        "alternatives": dict(cause.alternatives),
        "parameters": _by_name(effect, cause.term.values),
        "sigma": _by_name(effect, cause.term.sigmas),
        "shape": dict(cause.term.variant.shape),
        "explained_where_it_acts": cause.credibility,
    }


def _by_name(effect: Any, values: Sequence[float]) -> dict[str, float]:
    return dict(zip((parameter.name for parameter in effect.parameters), values, strict=True))


def _shrinkage_facts(shrunk: Shrinkage) -> dict[str, Any]:
    return {
        "share": shrunk.share,
        "caution": shrunk.caution,
        "interval_95": [shrunk.low, shrunk.high],
        "rms_before_dph": shrunk.rms_before_dph,
        "rms_after_dph": shrunk.rms_after_dph,
        **{
            key: {name: value for name, value in shares.items() if value == value}
            for key, shares in (
                ("by_profile", shrunk.by_profile),
                ("by_runs", shrunk.by_runs),
                ("by_phase", shrunk.by_phase),
            )
        },
    }
