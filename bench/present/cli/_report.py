"""`gyrobench report`: the report of a run, the certificate of several."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from bench.present.cli._options import Json

if TYPE_CHECKING:
    from bench.present.cli._console import Terminal
    from bench.present.report import CertificateContent

app = Typer()

NOT_PASSED = 4
"""Exit code for a certificate that says so."""
_STYLES = {"passed": "bold green", "not passed": "bold red", "undecided": "yellow", "not judged": "yellow"}


@app.command()
def report(
    run: Annotated[list[Path], Argument(help="a run folder; several, or --limits: a test certificate")],
    out: Annotated[
        Path | None, Option(help="HTML file; default report.html or certificate.html beside the runs")
    ] = None,
    limits: Annotated[Path | None, Option(help="limits to judge by: a TOML file with a limits table")] = None,
    dcc: Annotated[
        Path | None,
        Option(help="write a DCC (PTB's XML) too: TOML file with number, laboratory, customer, person"),
    ] = None,
    atml: Annotated[
        bool, Option("--atml", help="write ATML test results (IEEE 1636.1) too, beside the certificate")
    ] = False,
    pdf: Annotated[bool, Option("--pdf", help="print a PDF too (needs Chromium or Chrome)")] = False,
    as_json: Json = False,
) -> None:
    """Write the report of a run, or the certificate of several.

    The commands that fit write their own reports.

    Exit code 4 if the certificate says "not passed".
    """
    from bench.campaign import CampaignFolder
    from bench.present import report as reports
    from bench.present.cli._console import Terminal
    from bench.record.figure_limits import NO_LIMITS, load_limits
    from bench.record.signing import bench_key, sign_file

    console, units = Terminal(as_json=as_json), []
    run = _without_reports(run)
    judged = load_limits(limits) if limits else None
    of_campaign = len(run) == 1 and (run[0] / reports.CAMPAIGN_FILE).exists()
    facts = reports.load_laboratory(dcc) if dcc else None
    verdict, written = "", dict[str, Path]()
    if len(run) == 1 and not of_campaign and judged is None and facts is None and not atml:
        path = reports.report_run(run[0], out)
    else:
        path = out or (run[0] if of_campaign else run[0].parent) / reports.CERTIFICATE_FILE
        with console.status("verifying records"):
            if of_campaign:
                certificate = reports.certify_campaign(CampaignFolder(run[0]), path, judged)
            else:
                certificate = reports.certify(run, path, judged or NO_LIMITS)
        say_certificate(console, certificate)
        verdict = certificate.verdict
        if facts is not None:
            written["dcc"] = reports.write_dcc(path.with_suffix(".xml"), certificate, facts)
        if atml:
            written["atml"] = reports.write_atml(path.with_suffix(".atml.xml"), certificate)
        units = _unit_facts(certificate)
    if pdf:
        written["pdf"] = reports.write_pdf(path)
    made = [path, *written.values()]
    console.say_all(made, soft_wrap=True)
    if verdict and (key := bench_key()) is not None:
        console.say_all((sign_file(each, key) for each in made), soft_wrap=True)
    forms = {form: written.get(form) for form in ("pdf", "dcc", "atml")}
    console.say_json("result", file=path, **forms, verdict=verdict or None, units=units)
    sys.exit(NOT_PASSED if verdict == "not passed" else 0)


def _without_reports(named: list[Path]) -> list[Path]:
    """Return what may be a run: `runs/*` names the certificate of the last time, too, which is a file."""
    return [place for place in named if not place.is_file()] or named


def _unit_facts(content: CertificateContent) -> list[dict[str, object]]:
    keys = ("name", "limited", "judgement")
    return [
        {
            "unit": unit.unit_id,
            "verdict": unit.verdict,
            "against": list(unit.against),
            "figures": [{key: getattr(figure, key) for key in keys} for figure in unit.figures],
        }
        for unit in content.units
    ]


def say_certificate(console: Terminal, content: CertificateContent) -> None:
    """Print every unit's verdict and what stands against it."""
    from rich.text import Text

    rows = []
    for unit in content.units:
        met = sum(figure.judgement == "pass" for figure in unit.figures)
        limited = sum(figure.limited for figure in unit.figures)
        rows.append((unit.unit_id, Text(unit.verdict, _STYLES[unit.verdict]), f"{met} of {limited}"))
    console.table(("unit", "verdict", "limits met"), rows, content.title)
    for unit in content.units:
        failed = [f"{f.name}: {f.judgement}" for f in unit.figures if f.judgement in ("fail", "not measured")]
        console.say_all((f"{unit.unit_id}: {text}" for text in [*unit.against, *failed]), style="red")
