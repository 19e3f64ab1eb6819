"""`gyrobench gap diagnose` and `close` for heading changes of a platform INS."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.analysis.common.state_file import save_file
from bench.analysis.gap import (
    Model,
    PlatformDiagnosis,
    diagnose_platform,
    is_platform_run,
    load_platform_run,
    model_text,
    platform_closed,
    read_model,
)
from bench.present.cli._console import Terminal
from bench.present.report import HeadingContent, render_heading
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError


def of_platform(runs: Sequence[Path]) -> bool:
    """Return whether the runs are of a platform INS; ConfigurationError for a mixture with gyros."""
    kinds = {path: is_platform_run(path) for path in runs if path.is_dir()}
    if any(kinds.values()) and not (all(kinds.values()) and len(kinds) == len(runs)):
        raise ConfigurationError(
            "runs of a platform and of a gyro under one model",
            found=", ".join(str(path) for path in runs),
            expected="runs of one unit",
            remedy="diagnose each unit by itself",
        )
    return any(kinds.values())


def platform_diagnose_command(
    runs: Sequence[Path], model: Path, held_out: Sequence[Path], as_json: bool, report: Path | None
) -> None:
    """Say which effect the platform's drift over headings comes from, and how far the gap closes with it."""
    console = Terminal()
    with console.status("diagnosing"):
        found = _diagnosed(runs, read_model(model), held_out)
    if report is not None:
        report.parent.mkdir(parents=True, exist_ok=True)
        content = HeadingContent(found.study, found.unit_id, utc_now(), dict(found.run_checksums))
        save_file(report, render_heading(content))
    if as_json:
        console.print_json(json.dumps(_facts(found)))
        return
    _print(console, found)
    if report is not None:
        console.print(f"report: {report}", highlight=False, soft_wrap=True)


def platform_close_command(runs: Sequence[Path], model: Path, out: Path | None) -> None:
    """Write the nominal model with the heading effect that the runs show."""
    console = Terminal()
    nominal = read_model(model)
    found = _diagnosed(runs, nominal, ())
    if found.term is None:
        named = "".join(f", {name}" for name in found.causes)
        console.print(
            f"{found.verdict}{named}: there is no effect to put into the model",
            style="yellow",
            highlight=False,
        )
        return
    path = out or model.with_name(f"{model.stem}+{found.term.name}.toml")
    save_file(path, model_text(platform_closed(found, nominal)))
    console.print(f"{path}", highlight=False)


def _diagnosed(runs: Sequence[Path], nominal: Model, held_out: Sequence[Path]) -> PlatformDiagnosis:
    loaded = [load_platform_run(path) for path in runs]
    judges = [load_platform_run(path) for path in held_out]
    units = sorted({unit for _, unit, _, _ in (*loaded, *judges)})
    if len(units) > 1:
        raise ConfigurationError(
            "runs of different units under one model",
            found=", ".join(units),
            expected="runs of one unit",
            remedy="diagnose each unit by itself; coefficients differ between units",
        )
    return diagnose_platform(
        units[0],
        {name: log for name, _, log, _ in loaded},
        nominal,
        {name: log for name, _, log, _ in judges},
        {name: text for name, _, _, text in loaded},
    )


def _print(console: Console, found: PlatformDiagnosis) -> None:
    console.print(Text.assemble(f"unit {found.unit_id}: ", (found.verdict, "bold")))
    for name, probability in found.causes.items():
        rivals = ", ".join(f"{each} {100 * value:.0f} %" for each, value in found.alternatives.items())
        told = f"; in its place could stand {rivals}" if rivals else ""
        console.print(
            f"  {name} ({100 * probability:.0f} %): {found.meaning_of(name)}{_fitted(found)}{told}",
            highlight=False,
        )
    if found.unknown:
        console.print("  part of the gap follows neither temperature nor heading alone", highlight=False)
    table = Table(
        "heading", "hours", "before arcsec", "after arcsec", "share %", title="where: position error rms"
    )
    for place in found.places:
        table.add_row(
            f"{place.heading_deg:.0f} deg",
            f"{place.hours:.0f}",
            f"{place.rms_before_as:.1f}",
            f"{place.rms_after_as:.1f}",
            f"{100 * place.share:.0f}",
        )
    console.print(table)
    for each in found.held_out:
        console.print(
            f"on held-out run {each.run_id} {100 * each.share:.1f} % of the position error's energy is gone "
            f"({100 * each.low:.1f} to {100 * each.high:.1f} %): {each.rms_before_as:.1f} -> "
            f"{each.rms_after_as:.1f} arcsec rms",
            highlight=False,
        )
    if not found.held_out and found.term is not None:
        console.print("no held-out runs: how far the gap shrinks is not known", highlight=False)
    for warning in found.warnings:
        console.print(f"  {warning}", style="yellow", highlight=False)


def _fitted(found: PlatformDiagnosis) -> str:
    if found.term is None:
        return ""
    rows = zip(found.term.effect.parameters, found.term.values, found.term.sigmas, strict=True)
    return " " + ", ".join(f"{p.name} = {value:.3g} +- {sigma:.1g}" for p, value, sigma in rows)


def _facts(found: PlatformDiagnosis) -> dict[str, Any]:
    term = found.term
    names = [parameter.name for parameter in term.effect.parameters] if term else []
    return {
        "unit": found.unit_id,
        "verdict": found.verdict,
        "causes": dict(found.causes),
        "alternatives": dict(found.alternatives),
        "no_gap_probability": found.null_probability,
        "steps_beside": found.unknown,
        "parameters": dict(zip(names, term.values, strict=True)) if term else {},
        "sigma": dict(zip(names, term.sigmas, strict=True)) if term else {},
        "places": [vars(place) for place in found.places],
        "held_out": [vars(each) for each in found.held_out],
        "warnings": list(found.warnings),
        "runs": dict(found.run_checksums),
    }
