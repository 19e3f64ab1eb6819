"""`gyrobench report`: the report of a run, the certificate of several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.campaign import CampaignFolder
from bench.present.certificate import certificate_content
from bench.present.cli._console import Terminal
from bench.present.report import (
    CertificateContent,
    UnitVerdict,
    render_certificate,
    render_run,
    run_content,
    write_pdf,
    write_report,
)
from bench.record.figure_limits import NO_LIMITS, Limits, load_limits
from bench.record.recording import Run
from bench.record.run_folder import url_of
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

REPORT_FILE = "report.html"
CERTIFICATE_FILE = "certificate.html"
CAMPAIGN_FILE = "campaign.toml"
NOT_PASSED = 4
"""Exit code for a certificate that says so."""
_STYLES = {"passed": "bold green", "not passed": "bold red", "not judged": "yellow"}


def report_command(folders: Sequence[Path], out: Path | None, limits: Path | None, pdf: bool) -> int:
    """Write the report of one run folder, or the certificate of several or against limits."""
    console = Terminal()
    if len(folders) == 1 and (folders[0] / CAMPAIGN_FILE).exists():
        campaign = CampaignFolder(folders[0])
        path = out or campaign.path / CERTIFICATE_FILE
        verdict = certify_campaign(campaign, console, path, load_limits(limits) if limits else None)
    elif len(folders) == 1 and limits is None:
        path, verdict = run_report(folders[0], out), None
    else:
        path = out or folders[0].parent / CERTIFICATE_FILE
        verdict = certify(folders, load_limits(limits) if limits else NO_LIMITS, path, console)
    console.print(f"{path}", highlight=False, soft_wrap=True)
    if pdf:
        console.print(f"{write_pdf(path)}", highlight=False, soft_wrap=True)
    return NOT_PASSED if verdict == "not passed" else 0


def run_report(folder: Path, out: Path | None = None) -> Path:
    """Write the report of a run folder and return its path; a fit's report is written by the fit itself."""
    run = Run.open(folder) if url_of(folder) else None
    if run is None and not (folder / "manifest.json").exists():
        raise ConfigurationError(
            "no run to report on",
            where=str(folder),
            found="no manifest.json",
            expected="a run folder",
            remedy="`gyrobench fit` writes the report of a fit into its own folder",
        )
    return write_report(
        out or (Path(folder.name) if run else folder) / REPORT_FILE,
        render_run(run_content(run or Run.open(folder), created_utc=utc_now())),
    )


def certify_campaign(
    folder: CampaignFolder, console: Console, path: Path | None = None, limits: Limits | None = None
) -> UnitVerdict:
    """Write the certificate of a campaign: its limits, every planned run, the units of its file."""
    campaign = folder.campaign
    states = folder.states()
    return certify(
        [state.folder or folder.runs / state.run.name for state in states],
        limits or Limits(campaign.limits, CAMPAIGN_FILE, campaign.sha256),
        path or folder.path / CERTIFICATE_FILE,
        console,
        title=campaign.title,
        expected_units=[unit.serial for unit in campaign.unit],
    )


def certify(
    folders: Sequence[Path],
    limits: Limits,
    path: Path,
    console: Console,
    *,
    title: str = "",
    expected_units: Sequence[str] = (),
) -> UnitVerdict:
    """Write the certificate of planned run folders, print it and return its verdict.

    A certificate that was there before is removed before anything is computed.
    """
    if not any(folder.is_dir() for folder in folders):
        raise ConfigurationError(
            "no run to certify",
            where=", ".join(map(str, folders)),
            found="no such folder",
            expected="run folders",
        )
    path.unlink(missing_ok=True)
    with console.status("verifying records"):
        content = certificate_content(folders, limits, title=title, expected_units=expected_units)
    write_report(path, render_certificate(content))
    say_certificate(console, content)
    return content.verdict


def say_certificate(console: Console, content: CertificateContent) -> None:
    """Print every unit's verdict and what stands against it."""
    table = Table("unit", "verdict", "limits met", title=content.title)
    for unit in content.units:
        met = sum(figure.judgement == "pass" for figure in unit.figures)
        limited = sum(figure.limited for figure in unit.figures)
        table.add_row(unit.unit_id, Text(unit.verdict, _STYLES[unit.verdict]), f"{met} of {limited}")
    console.print(table)
    for unit in content.units:
        failed = [f"{f.name}: {f.judgement}" for f in unit.figures if f.judgement in ("fail", "not measured")]
        for text in [*unit.against, *failed]:
            console.print(f"{unit.unit_id}: {text}", style="red", highlight=False)
