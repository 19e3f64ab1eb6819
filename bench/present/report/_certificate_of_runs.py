"""From run folders and limits to the test certificate: a record is verified before any figure of it counts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from bench.control.run_record import decode_run
from bench.present.report._budget import budget_tables
from bench.present.report._certificate import (
    CertificateContent,
    CertifiedFigure,
    UnitCertificate,
    certificate_page,
)
from bench.present.report._file import write_report
from bench.present.report._run_content import RunContent, run_content
from bench.present.report._standard import allan_figure
from bench.record.events.run import Measured
from bench.record.figure_limits import FIGURES, FURTHER, NO_LIMITS, Decision, Limit, Limits, own_figure
from bench.record.recording import Run, read_manifest, verify
from bench.record.run_folder import url_of
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.figures import Figure, StandardFigures
    from bench.campaign import CampaignFolder

CERTIFICATE_FILE = "certificate.html"
CAMPAIGN_FILE = "campaign.toml"
_OVER_RUNS = "all runs"


def check_record(folder: Path) -> str:
    """Return "verified", or in a sentence what is wrong with a run's record."""
    if not url_of(folder) and not folder.is_dir():
        return "missing: there is no such run folder"
    try:
        report = verify(folder, decode_run)
    except BenchError as error:
        return f"cannot be read: {error}"
    return "verified" if report.passed else "; ".join(f"{p.path}: {p.text}" for p in report.problems)


def certify(
    folders: Sequence[Path],
    path: Path,
    limits: Limits = NO_LIMITS,
    *,
    title: str = "",
    expected_units: Iterable[str] = (),
) -> CertificateContent:
    """Write the certificate of planned run folders to `path` and return what it says.

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
    content = certificate_content(folders, limits, title=title, expected_units=expected_units)
    write_report(path, certificate_page(content))
    return content


def certify_campaign(
    campaign: CampaignFolder, path: Path | None = None, limits: Limits | None = None
) -> CertificateContent:
    """Write the certificate of a campaign: its limits, every planned run, the units of its file."""
    planned = campaign.campaign
    return certify(
        [state.folder or campaign.runs / state.run.name for state in campaign.states()],
        path or campaign.path / CERTIFICATE_FILE,
        limits or Limits(planned.limits, CAMPAIGN_FILE, planned.sha256, planned.decision),
        title=planned.title,
        expected_units=[unit.serial for unit in planned.unit],
    )


def certificate_content(
    folders: Sequence[Path],
    limits: Limits = NO_LIMITS,
    *,
    title: str = "",
    expected_units: Iterable[str] = (),
    check: Callable[[Path], str] = check_record,
) -> CertificateContent:
    """Return the certificate of planned run folders; one that is missing or cannot be read counts against.

    So does a unit of `expected_units` that no run is of.

    Every record is verified (checksums, tables rebuilt from raw bytes) and only a completed run whose record
    verifies gives figures. `check` says "verified" of a record, or what is wrong with it.
    """
    from bench.analysis.figures import standard_figures  # scipy behind it is slow to import

    _require_names(folders)
    checks = {folder.name: check(folder) for folder in folders}
    contents: dict[str, RunContent] = {}
    results: dict[str, list[StandardFigures]] = {}
    against: dict[str, list[str]] = {}
    own: dict[str, list[tuple[str, RunContent]]] = {}
    missing: list[str] = []
    left_out: list[str] = []
    for folder in folders:
        name = folder.name
        try:
            content = contents[name] = run_content(Run.open(folder))
        except BenchError:
            missing.append(f"Run {name}: {checks[name]}")
            continue
        for gyro, unit in content.manifest.units.items():
            reasons = against.setdefault(unit, [])
            results.setdefault(unit, [])
            reasons += _reasons(content, checks[name], gyro)
            if content.valid and checks[name] == "verified":
                own.setdefault(unit, []).append((gyro, content))
            if content.manifest.procedure == "standard-test" and content.valid and checks[name] == "verified":
                result = standard_figures(folder, gyro)
                results[unit].append(result)
                left_out += [f"Run {name}, {unit}: no {what}. {why}" for what, why in result.missing]
    units = [
        UnitCertificate(
            unit,
            [*_figures(tests, limits), *_own_figures(own.get(unit, []), limits)],
            [*dict.fromkeys(against[unit]), *missing, *_not_measured(own.get(unit, []), limits)],
        )
        for unit, tests in results.items()
    ]
    units += [
        UnitCertificate(
            unit, [*_figures([], limits), *_own_figures([], limits)], ["No run of this unit.", *missing]
        )
        for unit in sorted(set(expected_units) - set(results))
    ]
    drawn = [
        block
        for number, result in enumerate(test for tests in results.values() for test in tests)
        for block in allan_figure(number, result)
    ]
    return CertificateContent(
        title=title or f"Test of {', '.join(unit.unit_id for unit in units) or 'no unit'}",
        created_utc=utc_now(),
        units=units,
        runs=list(contents.values()),
        checks=checks,
        figures=drawn,
        budgets=[block for tests in results.values() for test in tests for block in budget_tables(test)],
        warnings=[*missing, *left_out],
        limits_from=limits.source,
        limits_sha256=limits.sha256,
        decision=limits.decision,
    )


def _require_names(folders: Sequence[Path]) -> None:
    """Raise ConfigurationError for two folders of one name, or of one run: one would be told as the other."""
    names: dict[str, Path] = {}
    for folder in folders:
        own = {folder.name}
        with suppress(BenchError):
            own.add(read_manifest(folder).run_id)
        if twice := sorted(own & names.keys()):
            raise ConfigurationError(
                "two run folders of one name",
                where=str(folder),
                found=f"{twice[0]}, also {names[twice[0]]}",
                expected="each run once: a record is told by its name",
                remedy="name each folder once; a copy is no further run",
            )
        names |= dict.fromkeys(own, folder)


def _reasons(run: RunContent, check: str, gyro: str) -> list[str]:
    reasons = []
    if not run.valid:
        outcome = "not finished" if run.manifest.outcome == "running" else run.manifest.outcome
        said = "; ".join(run.reasons)
        reasons.append(f"Run {run.run_id} is {outcome}" + (f": {said}" if said else "."))
    if check != "verified":
        reasons.append(f"Run {run.run_id}: the record does not verify: {check}")
    reasons += [
        f"Run {run.run_id}: {item.name.replace('_', ' ')} is outside its limits."
        for item in run.measurements
        if item.passed is False and item.gyro in (None, gyro)
    ]
    return reasons


def _figures(results: Sequence[StandardFigures], limits: Limits) -> list[CertifiedFigure]:
    from bench.analysis.figures import figures_over_runs

    figures = [(result.run_id, figure) for result in results for figure in result.figures]
    if len(results) > 1:
        figures += [(_OVER_RUNS, figure) for figure in figures_over_runs(results)]
    by_name: dict[str, list[tuple[str, Figure]]] = {}
    for run, figure in figures:
        by_name.setdefault(figure.name, []).append((run, figure))
    names = dict.fromkeys([*FIGURES, *by_name, *(name for name in limits.rows if own_figure(name) is None)])
    return [_figure(name, by_name.get(name, []), limits.rows.get(name), limits.decision) for name in names]


def _measured(runs: Sequence[tuple[str, RunContent]], procedure: str) -> Iterator[tuple[str, Measured]]:
    """Yield (run id, measurement) of a procedure's runs of one unit, given with the gyro that it was there.

    A measurement of no gyro belongs to every unit of its run.
    """
    for gyro, run in runs:
        if run.manifest.procedure == procedure:
            yield from ((run.run_id, item) for item in run.measurements if item.gyro in (None, gyro))


def _own_figures(runs: Sequence[tuple[str, RunContent]], limits: Limits) -> list[CertifiedFigure]:
    """Return what procedures measured of a unit and a limit names; in another unit than the limit's it is not it.

    Of several in a run the last one counts.
    """
    figures = []
    for name, limit in limits.rows.items():
        if (named := own_figure(name)) is None:
            continue
        procedure, measurement = named
        values = {
            run_id: math.nan if item.value is None else item.value
            for run_id, item in _measured(runs, procedure)
            if (item.name, item.unit) == (measurement, limit.unit)
        }
        figures.append(
            CertifiedFigure(name, limit.unit, values, limit.low, limit.high, decision=limits.decision)
        )
    return figures


def _not_measured(runs: Sequence[tuple[str, RunContent]], limits: Limits) -> Iterator[str]:
    """Yield why a limit of a procedure's own figure found nothing to judge: a wrong name or unit, or no run."""
    for name, limit in limits.rows.items():
        if (named := own_figure(name)) is None:
            continue
        procedure, measurement = named
        units = {item.name: item.unit for _, item in _measured(runs, procedure)}
        if not units:
            yield f"{name}: no completed and verified run of {procedure} has a figure of this unit."
        elif measurement not in units:
            listed = ", ".join(f"{found} [{unit}]" if unit else found for found, unit in units.items())
            yield f"{name}: {procedure} did not measure it. It measured {listed}."
        elif units[measurement] != limit.unit:
            yield (
                f"{name}: measured in {units[measurement] or 'no unit'}, "
                f"its limit is in {limit.unit or 'no unit'}."
            )


def _figure(
    name: str, rows: Sequence[tuple[str, Figure]], limit: Limit | None, decision: Decision
) -> CertifiedFigure:
    units = {figure.unit for _, figure in rows} or {FIGURES.get(name, FURTHER.get(name, ""))}
    low, high = (None, None) if limit is None else (limit.low, limit.high)
    return CertifiedFigure(
        name,
        units.pop(),
        values={run: figure.value for run, figure in rows},
        lower_limit=low,
        upper_limit=high,
        intervals={
            run: (figure.low, figure.high)
            for run, figure in rows
            if figure.low is not None and figure.high is not None
        },
        unseen=frozenset(run for run, figure in rows if not figure.seen),
        decision=decision,
        digits=max((figure.digits for _, figure in rows), default=4),
        standard_uncertainties={
            run: figure.budget.combined for run, figure in rows if figure.budget is not None
        },
    )
