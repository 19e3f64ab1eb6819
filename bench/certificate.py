"""From run folders and limits to the test certificate: a record is verified before any figure of it counts."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bench.recording import Run, checksum, verify
from bench.report import (
    CertificateContent,
    CertifiedFigure,
    RunSummary,
    UnitCertificate,
    allan_figure,
    run_content,
)
from bench.run_record import decode_run
from bench.standards import Figure, StandardFigures, figures_over_runs, standard_figures
from drivers.clock import utc_now
from drivers.errors import BenchError, ConfigurationError

FIGURES: Mapping[str, str] = {
    "bias": "deg/h",
    "bias stability, 10 s averages": "deg/h",
    "bias stability, 100 s averages": "deg/h",
    "bias repeatability": "deg/h",
    "scale factor": "",
    "scale-factor nonlinearity": "ppm",
    "scale-factor asymmetry": "ppm",
    "scale-factor repeatability": "ppm",
    "angle random walk": "deg/sqrt(h)",
    "bias instability": "deg/h",
    "bias temperature sensitivity": "deg/h/degC",
    "scale-factor temperature sensitivity": "ppm/degC",
}
"""The figures of every certificate with their units, in its order; what a run gives beyond them follows."""
FURTHER: Mapping[str, str] = {
    "threshold": "deg/h",
    "resolution": "deg/h",
    "warm-up time to 3 s_100": "s",
    "input-axis misalignment, component along the table": "deg",
    "scale-factor hysteresis, rising and falling": "ppm",
    "scale-factor repeatability between runs": "ppm",
    "quantisation": "deg",
    "rate random walk": "deg/h/sqrt(h)",
    "rate ramp": "deg/h/h",
}
_OVER_RUNS = "all runs"


class Limit(BaseModel):
    """Limits of a figure, in the figure's own unit, the limits themselves included."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    unit: str = ""
    low: float | None = Field(default=None, allow_inf_nan=False)
    high: float | None = Field(default=None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _usable(self) -> Limit:
        if self.low is None and self.high is None:
            raise ValueError("neither low nor high")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low:g} is above high {self.high:g}")
        return self


@dataclass(frozen=True)
class Limits:
    """Limits by figure, and the file that they come from."""

    rows: Mapping[str, Limit] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""


NO_LIMITS = Limits()


def parse_limits(table: object, where: str) -> dict[str, Limit]:
    """Return limits from the `limits` table of a file; ConfigurationError names every mistake."""
    if not isinstance(table, Mapping):
        raise _unusable(where, "limits is not a table")
    known = {**FIGURES, **FURTHER}
    limits: dict[str, Limit] = {}
    wrong = []
    for figure, row in table.items():
        if figure not in known:
            near = difflib.get_close_matches(str(figure), known, n=1)
            wrong.append(f"no figure {figure!r}" + (f"; did you mean {near[0]!r}" if near else ""))
            continue
        try:
            limit = limits[figure] = Limit.model_validate(row)
        except ValidationError as error:
            wrong += [f"{figure}: {_mistake(dict(item))}" for item in error.errors()]
            continue
        if limit.unit != known[figure]:
            wrong.append(f"{figure} is in {known[figure] or 'no unit'}, not {limit.unit!r}")
    if wrong:
        raise _unusable(where, "; ".join(wrong))
    return limits


def load_limits(path: Path) -> Limits:
    """Read the `limits` table of a TOML file (a campaign file has one): per figure unit, low and/or high."""
    try:
        content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _unusable(str(path), str(error)) from error
    if "limits" not in content:
        raise _unusable(str(path), "no limits table")
    return Limits(parse_limits(content["limits"], str(path)), path.name, checksum(path).sha256)


def check_record(folder: Path) -> str:
    """Return "verified", or in a sentence what is wrong with a run's record."""
    if not folder.is_dir():
        return "missing: there is no such run folder"
    try:
        report = verify(folder, lambda run, out: (decode_run(run, out), None)[1])
    except BenchError as error:
        return f"cannot be read: {error}"
    return "verified" if report.passed else "; ".join(f"{p.path}: {p.text}" for p in report.problems)


def certificate_content(
    folders: Sequence[Path],
    limits: Limits = NO_LIMITS,
    *,
    title: str = "",
    expected_units: Iterable[str] = (),
    warnings: Iterable[str] = (),
    check: Callable[[Path], str] = check_record,
) -> CertificateContent:
    """Return the certificate of planned run folders; one that is missing or cannot be read counts against.

    So does a unit of `expected_units` that no run is of.

    Every record is verified (checksums, tables rebuilt from raw bytes) and only a completed run whose record
    verifies gives figures. `check` says "verified" of a record, or what is wrong with it.
    """
    checks = {folder.name: check(folder) for folder in folders}
    summaries: dict[str, RunSummary] = {}
    results: dict[str, list[StandardFigures]] = {}
    against: dict[str, list[str]] = {}
    missing: list[str] = []
    for folder in folders:
        name = folder.name
        try:
            summary = summaries[name] = run_content(Run.open(folder)).summary
        except BenchError:
            missing.append(f"Run {name}: {checks[name]}")
            continue
        for gyro, unit in summary.units.items():
            reasons = against.setdefault(unit, [])
            results.setdefault(unit, [])
            reasons += _reasons(summary, checks[name])
            if summary.procedure == "standard-test" and summary.valid and checks[name] == "verified":
                result = standard_figures(folder, gyro)
                results[unit].append(result)
                reasons += [f"Run {name}: no {what}. {why}" for what, why in result.missing]
    units = [
        UnitCertificate(unit, _figures(found, limits), [*dict.fromkeys(against[unit]), *missing])
        for unit, found in results.items()
    ]
    units += [
        UnitCertificate(unit, _figures([], limits), ["No run of this unit.", *missing])
        for unit in sorted(set(expected_units) - set(results))
    ]
    drawn = [
        block
        for number, result in enumerate(one for found in results.values() for one in found)
        for block in allan_figure(number, result)
    ]
    return CertificateContent(
        title=title or f"Test of {', '.join(unit.unit_id for unit in units) or 'no unit'}",
        created_utc=utc_now(),
        units=units,
        runs=list(summaries.values()),
        checks=checks,
        figures=drawn,
        warnings=[*warnings, *missing],
        limits_from=limits.source,
        limits_sha256=limits.sha256,
    )


def _reasons(run: RunSummary, check: str) -> list[str]:
    reasons = []
    if not run.valid:
        said = "; ".join(run.reasons)
        reasons.append(f"Run {run.run_id} is {'not finished' if run.outcome == 'running' else run.outcome}"
                       + (f": {said}" if said else "."))  # fmt: skip
    if check != "verified":
        reasons.append(f"Run {run.run_id}: the record does not verify: {check}")
    reasons += [
        f"Run {run.run_id}: {item.name.replace('_', ' ')} is outside its limits."
        for item in run.measurements
        if item.passed is False
    ]
    return reasons


def _figures(results: Sequence[StandardFigures], limits: Limits) -> list[CertifiedFigure]:
    found: dict[str, list[tuple[str, Figure]]] = {}
    for result in results:
        for figure in result.figures:
            found.setdefault(figure.name, []).append((result.run_id, figure))
    if len(results) > 1:
        for figure in figures_over_runs(results):
            found.setdefault(figure.name, []).append((_OVER_RUNS, figure))
    names = dict.fromkeys([*FIGURES, *found, *limits.rows])
    return [_figure(name, found.get(name, []), limits.rows.get(name)) for name in names]


def _figure(name: str, rows: Sequence[tuple[str, Figure]], limit: Limit | None) -> CertifiedFigure:
    units = {figure.unit for _, figure in rows} or {FIGURES.get(name, FURTHER.get(name, ""))}
    shown = CertifiedFigure(
        name,
        units.pop(),
        {run: figure.value for run, figure in rows},
        None if limit is None else limit.low,
        None if limit is None else limit.high,
    )
    of_value = next((figure for _, figure in rows if figure.value == shown.value), None)
    if of_value is None:
        return shown
    return CertifiedFigure(
        **{**shown.__dict__, "low": of_value.low, "high": of_value.high, "source": of_value.source}
    )


def _mistake(item: Mapping[str, Any]) -> str:
    where = ".".join(map(str, item["loc"]))
    return f"{where} {str(item['msg']).removeprefix('Value error, ')}".strip()


def _unusable(where: str, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the limits cannot be used",
        where=where,
        found=found,
        expected='tables like [limits."bias"] with unit, low and/or high; figures: '
        + ", ".join([*FIGURES, *FURTHER]),
    )
