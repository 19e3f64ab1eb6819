"""`gyrobench fit whirl` and `heading-effect`: errors that turn with a mechanism or with a platform's heading."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Argument, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import FitFolder, FittedRuns, GyroToFit, Json, TestRuns
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.heading import Form, HeadingStudy
    from bench.analysis.whirl import Gauge, WhirlStudy

WHIRL_FILE, HEADING_FILE, REPORT_FILE = "compensation.whirl", "heading.gyrocomp", "report.html"


def whirl(
    runs: FittedRuns,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("whirl"),
    gauge: Annotated[str, Option(help="how the unobservable constant tilt is fixed")] = "mean",
    installation_arcsec: Annotated[
        tuple[float, float] | None,
        Option(help="known angles of the x and of the y gyro towards z; taken out of their rates"),
    ] = None,
    base: Annotated[
        list[Path] | None,
        Option(
            help="rate of a base that moves, from a reference on it: the name of a unit of the runs that stood "
            "on it, or one log for each run, in order"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit the whirl of a rotating INS from gyro and angle.

    The compensation corrects the attitude.
    """
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.whirl import study_whirl_runs
    from bench.present.report import whirl_page, write_report
    from bench.record.recording import Run

    if gauge not in ("mean", "start"):
        raise ConfigurationError("no such gauge", where="--gauge", found=gauge, expected="mean or start")
    console = Terminal(as_json=as_json)
    opened = [Run.open(folder) for folder in (*runs, *(test or []))]
    with console.status("fitting whirl"):
        fitted, judging = opened[: len(runs)], opened[len(runs) :]
        named = cast("Gauge", gauge)
        study = study_whirl_runs(
            fitted, judging, gyro, gauge=named, installation_arcsec=installation_arcsec, bases=base or ()
        )
    with saved_together(out) as part:
        study.compensation.save(part / WHIRL_FILE)
        write_report(part / REPORT_FILE, whirl_page(study, opened, part / WHIRL_FILE))
    _print_whirl(console, study)
    for text in (*study.compensation.declared, *(finding.text for finding in study.findings)):
        console.say(f"- {text}")
    if study.judged_on_fitted:
        console.print("no --test run: the figures are on the runs that were fitted", style="yellow")
    console.say(f"files in {out}")
    fit = study.fit
    lines = [
        {"line": line, "x_arcsec": value.real, "y_arcsec": value.imag, "sd_arcsec": sd}
        for line, value, sd in zip(fit.lines, fit.amplitudes_arcsec, fit.sd_arcsec, strict=True)
    ]
    judged = [
        {
            "run_id": row.record.run_id,
            "before_arcsec": row.before.locked_arcsec,
            "after_arcsec": row.after.locked_arcsec,
            "total_after_arcsec": row.after.total_arcsec,
            "rests_arcsec": list(row.rests_arcsec),
        }
        for row in study.judgements
    ]
    told = [*study.compensation.declared, *(finding.text for finding in study.findings)]
    on_fitted = study.judged_on_fitted
    console.say_json("result", lines=lines, runs=judged, told=told, judged_on_fitted=on_fitted, folder=out)


def _print_whirl(console: Terminal, study: WhirlStudy) -> None:
    """Print the fitted lines with their significance, and the carrier's oscillation before and after, by run."""
    fit = study.fit
    lines = [
        (f"{line:+g}", f"{value.real:.4f}", f"{value.imag:.4f}", f"{sd:.4f}", f"{evidence:,.1f}")
        for line, value, sd, evidence in zip(
            fit.lines, fit.amplitudes_arcsec, fit.sd_arcsec, fit.statistic, strict=True
        )
    ]
    console.table(("line m", "about x arcsec", "about y arcsec", "sd an axis", "|a|^2 / 2 sd^2"), lines)
    rows = [
        (
            row.record.run_id,
            f"{row.before.locked_arcsec:.3f}",
            "-" if row.patent is None else f"{row.patent.locked_arcsec:.3f}",
            f"{row.after.locked_arcsec:.3f}",
            f"{row.locked_factor:.0f}",
            f"{row.after.total_arcsec:.3f}",
        )
        for row in study.judgements
    ]
    locked = "locked to the angle, arcsec rms: before"
    console.table(("run", locked, "patent", "after", "times less", "total after"), rows)


def heading_effect(
    log: Annotated[Path, Argument(help="log (CSV or Parquet), or run folder, to calibrate on")],
    latitude_deg: Annotated[
        float | None, Option(help="latitude of the bench; default the run folder's")
    ] = None,
    longitude_deg: Annotated[
        float | None, Option(help="its longitude, east positive; default the run's")
    ] = None,
    test: TestRuns = None,
    out: FitFolder = Path("heading-fit"),
    column: Annotated[list[str] | None, Option(help="quantity=column of the log; repeat for several")] = None,
    epoch_s: Annotated[float | None, Option(help="s since 1970 (UTC) at time 0 of the log")] = None,
    damping: Annotated[float, Option(help="damping ratio of the platform's Schuler loop")] = 0.0,
    form: Annotated[str, Option(help="lag9 or lag15; the paper's form is always shown beside")] = "lag9",
    window_h: Annotated[float, Option(help="moving window of the paper's form")] = 35.901708,
    as_json: Json = False,
) -> None:
    """Fit the heading effect of a space-stable platform.

    It is fitted to position errors and platform temperature.

    Exit code 4 if temperature is not what drives the drift: then there is a report and no compensation.
    """
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.heading import HeadingCompensation, checksum_of_log, study_heading_logs, unit_of_log
    from bench.present.cli._settings import parse_settings
    from bench.present.report import heading_page, mixed_text, write_report

    console = Terminal(as_json=as_json)
    if form not in ("lag9", "lag15"):
        raise ConfigurationError(f"there is no model {form!r}", where="--form", expected="lag9 or lag15")
    refusal = "a column that is not quantity=column"
    columns = parse_settings(column or [], "--column", refusal, "temp_c=coil_temp")
    study, checksums = study_heading_logs(
        log,
        test or [],
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        epoch_s=epoch_s,
        damping=damping,
        columns=columns,
        form=cast("Form", form),
        window_s=3600.0 * window_h,
    )
    evidence = study.model.evidence
    caused = evidence.cause == "temperature"
    model_file = HEADING_FILE if caused else ""
    page = heading_page(study, log.stem, checksums, created_utc=utc_now(), model_file=model_file)
    with saved_together(out, HEADING_FILE) as part:
        if caused:
            runs = dict([checksum_of_log(log)])
            HeadingCompensation.from_fit(study.model, unit_of_log(log), runs).save(part / HEADING_FILE)
        write_report(part / "report.html", page)
    console.say_json("result", **_heading_facts(study), folder=out)
    console.say_all((f"{finding.what}: {finding.consequence}" for finding in study.findings), style="yellow")
    if not caused:
        console.say(_not_temperature(study), style="bold red")
        sys.exit(4)
    if evidence.mixed:
        console.say(mixed_text(study), style="yellow")
    rows = [
        (
            row.name + ("" if row.held_out else " (fitted on)"),
            row.method,
            f"{row.rms_before_as / 60.0:.3f}",
            f"{row.rms_after_as / 60.0:.3f}",
            f"{row.reduction_percent:.1f}",
        )
        for row in study.judgements
    ]
    console.table(("log", "model", "before arcmin", "after arcmin", "reduction %"), rows)
    console.say(f"reduction to expect at other headings: at least {evidence.least_reduction_percent:.0f} %")
    for text in _heading_texts(study):
        console.say(text)
    console.say(f"files in {out}")


def _heading_texts(study: HeadingStudy) -> list[str]:
    """Say the time constants, what became of a second temperature, and what the accelerometers show."""
    found = study.settling
    heat = [
        f"{constant.tau_s / 3600.0:.2f} +- {constant.sigma_s / 3600.0:.2f} h {where}"
        for constant, where in ((found.start_up, "from the start-up curve"), (found.turns, "after turns"))
        if constant is not None
    ]
    core = found.core
    texts = [
        f"time constants: the drift follows the temperature by {core.tau_s / 3600.0:.2f} +- "
        f"{core.sigma_s / 3600.0:.2f} h; the temperature settles with "
        + (" and ".join(heat) or "one not shown")
    ]
    if study.second is not None:
        used = {None: "is not used", "temperature": "is used", "gradient": "is used, less the first"}
        left = [
            f"{name} {float((values**2).mean() ** 0.5):.1f}"
            for name, values in study.second.left_out_as.items()
        ]
        why = (
            f"arcsec left on stays left out: {', '.join(left)}"
            if left
            else "fewer than four stays to judge by"
        )
        texts.append(f"second temperature {used[study.second.kind]} ({why})")
    if study.modulus is not None:
        word = "goes with heading" if study.modulus.changed else "does not depend on heading"
        texts.append(f"modulus of specific force {word} (least p {study.modulus.p_value.min():.2g})")
    return texts


def _heading_facts(study: HeadingStudy) -> dict[str, object]:
    """Return what drives the drift, and each log's error before and after; `tau_h` where temperature does."""
    keys = ("name", "method", "held_out", "rms_before_as", "rms_after_as", "reduction_percent")
    caused = study.model.evidence.cause == "temperature"
    return {
        "cause": study.model.evidence.cause,
        "least_reduction_percent": study.model.evidence.least_reduction_percent if caused else None,
        "tau_h": study.model.tau_s / 3600.0 if caused else None,
        "time_constants_h": {
            name: None if constant is None else [constant.tau_s / 3600.0, constant.sigma_s / 3600.0]
            for name in ("start_up", "turns", "core")
            for constant in (getattr(study.settling, name),)
        },
        "second": None if study.second is None else study.second.kind or "none",
        "modulus_changed": None if study.modulus is None else study.modulus.changed,
        "logs": [{key: getattr(row, key) for key in keys} for row in study.judgements],
        "findings": [f"{finding.what}: {finding.consequence}" for finding in study.findings],
    }


def _not_temperature(study: HeadingStudy) -> str:
    """Say what drives the drift instead."""
    if study.model.evidence.cause == "none":
        return "no heading effect beyond the noise of this run: nothing to compensate"
    if study.model.evidence.cause == "unexplained":
        return (
            f"{100.0 * study.model.evidence.other_share:.0f} % of the heading effect does not follow "
            "the measured temperature (a gradient that no sensor sees, friction, a magnetic field?): "
            "compensating with it could add error, no compensation was written"
        )
    return (
        "the drift steps with heading and does not follow the temperature (friction, magnetic field, cables?): "
        "compensating with temperature would add error, no compensation was written"
    )
