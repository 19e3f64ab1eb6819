"""`gyrobench fit heading-effect`: the heading effect of a platform INS from its log."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from bench.present.cli._options import FitFolder, TestRuns
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.heading import Form, HeadingStudy

MODEL_FILE = "heading.gyrocomp"


def heading_effect(
    log: Annotated[Path, typer.Argument(help="log (CSV or Parquet), or run folder, to calibrate on")],
    latitude_deg: Annotated[
        float | None, typer.Option("--latitude-deg", help="latitude of the bench; default the run folder's")
    ] = None,
    longitude_deg: Annotated[
        float | None, typer.Option("--longitude-deg", help="its longitude, east positive; default the run's")
    ] = None,
    test: TestRuns = None,
    out: FitFolder = Path("heading-fit"),
    column: Annotated[
        list[str] | None, typer.Option("--column", help="quantity=column of the log; repeat for several")
    ] = None,
    epoch_s: Annotated[float | None, typer.Option(help="s since 1970 (UTC) at time 0 of the log")] = None,
    damping: Annotated[float, typer.Option(help="damping ratio of the platform's Schuler loop")] = 0.0,
    form: Annotated[
        str, typer.Option(help="lag9 or lag15; the paper's form is always shown beside")
    ] = "lag9",
    window_h: Annotated[float, typer.Option(help="moving window of the paper's form")] = 35.901708,
) -> None:
    """Heading effect of a space-stable platform from position errors and platform temperature.

    Exit code 4 if temperature is not what drives the drift: then there is a report and no compensation.
    """
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.heading import HeadingCompensation, checksum_of_log, study_heading_logs, unit_of_log
    from bench.present.cli._console import Terminal
    from bench.present.report import heading_page, mixed_text, write_report
    from drivers.base.clock import utc_now

    console = Terminal()
    if form not in ("lag9", "lag15"):
        raise ConfigurationError(f"there is no model {form!r}", where="--form", expected="lag9 or lag15")
    study, checksums = study_heading_logs(
        log,
        test or [],
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        epoch_s=epoch_s,
        damping=damping,
        columns=_columns(column or []),
        form=cast("Form", form),
        window_s=3600.0 * window_h,
    )
    evidence = study.model.evidence
    caused = evidence.cause == "temperature"
    model_file = MODEL_FILE if caused else ""
    page = heading_page(study, log.stem, checksums, created_utc=utc_now(), model_file=model_file)
    with saved_together(out, MODEL_FILE) as part:
        if caused:
            runs = dict([checksum_of_log(log)])
            HeadingCompensation.from_fit(study.model, unit_of_log(log), runs).save(part / MODEL_FILE)
        write_report(part / "report.html", page)
    for finding in study.findings:
        console.say(f"{finding.what}: {finding.consequence}", style="yellow")
    if not caused:
        console.say(_not_temperature(study), style="bold red")
        sys.exit(4)
    if evidence.mixed:
        console.say(mixed_text(study), style="yellow")
    console.print(_judgements(study))
    console.say(f"time constant {study.model.tau_s / 3600.0:.2f} h; files in {out}")


def _columns(pairs: Sequence[str]) -> dict[str, str]:
    """Return quantity -> column of `quantity=column` texts; ConfigurationError for anything else."""
    named = {}
    for pair in pairs:
        quantity, equals, column = pair.partition("=")
        if not equals or not quantity or not column:
            raise ConfigurationError(
                "a column that is not quantity=column",
                where="--column",
                found=pair,
                expected="e.g. temp_c=coil_temp",
            )
        named[quantity.strip()] = column.strip()
    return named


def _not_temperature(study: HeadingStudy) -> str:
    """Say what drives the drift instead."""
    if study.model.evidence.cause == "none":
        return "no heading effect beyond the noise of this run: nothing to compensate"
    return (
        "the drift steps with heading and does not follow the temperature (friction, magnetic field, cables?): "
        "compensating with temperature would add error, no compensation was written"
    )


def _judgements(study: HeadingStudy) -> Table:
    """Return the position errors before and after each model, a row for each log and model."""
    from rich.table import Table

    table = Table("log", "model", "before arcmin", "after arcmin", "reduction %")
    for row in study.judgements:
        table.add_row(
            row.name + ("" if row.held_out else " (fitted on)"),
            row.method,
            f"{row.rms_before_as / 60.0:.3f}",
            f"{row.rms_after_as / 60.0:.3f}",
            f"{row.reduction_percent:.1f}",
        )
    return table
