"""`gyrobench fit heading-effect`: the heading effect of a platform INS from its log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

from rich.table import Table

from bench.analysis.common.state_file import saved_together
from bench.analysis.heading import (
    Form,
    HeadingStudy,
    Site,
    earth_rotation_deg,
    load_log,
    platform_table,
    save_model,
    site_of_run,
    study_heading,
)
from bench.present.cli._console import Terminal
from bench.present.report import HeadingContent, mixed_text, render_heading, write_report
from bench.record.recording import checksum
from drivers.base.clock import utc_now
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import ConfigurationError

MODEL_FILE = "heading.gyrocomp"
REPORT_FILE = "report.html"


def heading_command(
    log: Path,
    latitude_deg: float | None,
    longitude_deg: float | None,
    tests: Sequence[Path] = (),
    out: Path = Path("heading-fit"),
    columns: Sequence[str] = (),
    epoch_s: float | None = None,
    damping: float = 0.0,
    form: str = "lag9",
    window_h: float = 1.5 * SIDEREAL_DAY_S / 3600.0,
) -> int:
    """Fit `log`, judge on `tests`, write compensation and report to `out`; return the exit code.

    `epoch_s`: s since 1970 (UTC) at time 0 of the logs. Exit code 4 when temperature is not what drives the
    drift: then there is a report and no compensation.
    """
    console = Terminal()
    if form not in ("lag9", "lag15"):
        raise ConfigurationError(f"there is no model {form!r}", where="--form", expected="lag9 or lag15")
    named = parse_columns(columns)

    def site(path: Path) -> Site:
        return site_at(path, latitude_deg, longitude_deg, epoch_s, damping)

    calibration, other = load_log(log, site(log), named)
    held_out = {path.stem: load_log(path, site(path), named)[0] for path in tests}
    study = study_heading(
        calibration, held_out, form=cast(Form, form), window_s=3600.0 * window_h, other_temp_c=other
    )
    caused = study.model.evidence.cause == "temperature"
    tables = [platform_table(path) if path.is_dir() else path for path in (log, *tests)]
    sums = {f"{path.parent.name}/{path.name}": checksum(path).sha256 for path in tables}
    content = HeadingContent(study, log.stem, utc_now(), sums, MODEL_FILE if caused else "")
    with saved_together(out, MODEL_FILE) as part:
        if caused:
            save_model(part / MODEL_FILE, study.model)
        write_report(part / REPORT_FILE, render_heading(content))
    for finding in study.findings:
        console.print(f"{finding.what}: {finding.consequence}", style="yellow", highlight=False)
    if not caused:
        console.print(not_temperature(study), style="bold red", highlight=False)
        return 4
    if study.model.evidence.mixed:
        console.print(mixed_text(study), style="yellow", highlight=False)
    console.print(judgement_table(study))
    console.print(f"time constant {study.model.tau_s / 3600.0:.2f} h; files in {out}", highlight=False)
    return 0


def site_at(
    log: Path, latitude_deg: float | None, longitude_deg: float | None, epoch_s: float | None, damping: float
) -> Site:
    """Return where a log was made: as told, or as a run folder's manifest has it."""
    zero_deg = None if epoch_s is None else earth_rotation_deg(epoch_s)
    if latitude_deg is not None and longitude_deg is not None:
        return Site(latitude_deg, longitude_deg, zero_deg, damping)
    if not log.is_dir():
        raise ConfigurationError(
            "where the platform stood is not known",
            where=str(log),
            expected="--latitude-deg and --longitude-deg, or a run folder, whose manifest has them",
        )
    run = site_of_run(log, damping)
    return Site(
        run.latitude_deg if latitude_deg is None else latitude_deg,
        run.longitude_deg if longitude_deg is None else longitude_deg,
        run.sidereal_zero_deg if epoch_s is None else zero_deg,
        damping,
    )


def parse_columns(pairs: Sequence[str]) -> dict[str, str]:
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


def not_temperature(study: HeadingStudy) -> str:
    """Say what drives the drift instead."""
    if study.model.evidence.cause == "none":
        return "no heading effect beyond the noise of this run: nothing to compensate"
    return (
        "the drift steps with heading and does not follow the temperature (friction, magnetic field, "
        "cables?): "
        "compensating with temperature would add error, no compensation was written"
    )


def judgement_table(study: HeadingStudy) -> Table:
    """Return the position errors before and after each model, a row for each log and model."""
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
