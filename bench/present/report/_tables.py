"""Tables that every kind of report has: runs, checks, streams, devices, checksums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench.present.report._numbers import (
    DASH,
    column,
    duration,
    fixed,
    moment,
    parameter,
    plain,
    significant,
    unit_text,
    with_uncertainty,
)
from bench.present.report._page import Block, Cell, Fact, Facts, Row, Section, Table, Tone, named
from bench.present.report._run_content import RunContent
from bench.record.events.run import Measured, labels

if TYPE_CHECKING:
    from bench.analysis.common.uncertainty import Budget

_OUTCOMES: dict[str, tuple[str, Tone]] = {
    "completed": ("valid", "good"),
    "invalid": ("invalid", "bad"),
    "aborted": ("aborted", "bad"),
    "running": ("unfinished", "doubt"),
}


_MEASURED = {
    "shock_rate_10_90": "shock rate, 10 to 90 %",
    "shock_steepest_60s": "shock rate, steepest 60 s",
    "shock_lowest_air": "lowest air temperature",
    "azimuth_error": "azimuth error of the axis",
    "east_table_angle": "table angle of east",
}
"""Names whose underscores do not read well as spaces."""


def measured(name: str) -> str:
    """Return a measurement's name as it is printed."""
    return _MEASURED.get(name, name.replace("_", " "))


def limited(item: Measured) -> bool:
    """Return whether a measurement has a limit to be judged by."""
    return item.low is not None or item.high is not None


def outcome(run: RunContent) -> tuple[str, Tone]:
    """Return the word for a run's outcome and its tone."""
    return _OUTCOMES[run.manifest.outcome]


def runs_table(runs: Sequence[RunContent]) -> list[Block]:
    """Return the table of runs; the reasons stand beneath a run that is not valid."""
    roles = any(run.role for run in runs)
    common = _common_parameters(runs)
    rows = []
    for run in runs:
        word, tone = outcome(run)
        cells = [Cell(run.run_id, strong=True), Cell(run.manifest.procedure)]
        cells += [Cell(run.role or DASH)] if roles else []
        cells += [
            Cell(_parameters_text(run, common) or DASH),
            Cell(moment(run.manifest.started_utc)),
            Cell(duration(run.manifest.duration_s)),
            Cell(word, tone),
        ]
        plain_tone: Tone = "plain" if run.valid else tone
        rows.append(Row(cells, tone=plain_tone, note="; ".join(run.reasons)))
    heads = ["Run", "Procedure", "Parameters", "Started", ">Duration", "Outcome"]
    if roles:
        heads.insert(2, "Used for")
    shared = ", ".join(" ".join(parameter(name, value)) for name, value in common.items())
    caption = "Runs of this report." + (f" Parameters that all of them share: {shared}." if shared else "")
    return [Table(heads, rows, caption)]


def checks_table(runs: Sequence[RunContent]) -> list[Block]:
    """Return a table of the measurements that were judged, a row for each run, a column for each check."""
    names: dict[str, Measured] = {}
    for run in runs:
        for item, label in zip(run.measurements, labels(run.measurements), strict=True):
            if limited(item):
                names.setdefault(label, item)
    heads = ["Run"]
    for name, item in names.items():
        unit = f"{unit_text(item.unit)} {limits_text(item.low, item.high)}".strip()
        heads.append(f">{measured(name)} [{unit}]")
    rows = []
    for run in runs:
        by_name = dict(zip(labels(run.measurements), run.measurements, strict=True))
        if not names.keys() & by_name.keys():
            continue
        cells = [_check_cell(by_name.get(name), first) for name, first in names.items()]
        rows.append(named(run.run_id, *cells))
    caption = (
        "Criteria of the procedure, measured on the record of each run. ✕ marks a value outside its limits."
    )
    return [Table(heads, rows, caption)]


def measurements_table(measurements: Sequence[Measured], budgets: Mapping[str, Budget]) -> list[Block]:
    """Return everything that was measured on one run, judged or not, with its uncertainty if it has a budget."""
    rows = []
    for item, label in zip(measurements, labels(measurements), strict=True):
        budget = budgets.get(label)
        half_width = None if budget is None else budget.half_width
        row = Row(
            [
                Cell(measured(label)),
                Cell(significant(item.value, 4), strong=True),
                Cell(DASH if half_width is None else significant(half_width, 2)),
                Cell(unit_text(item.unit)),
                Cell(limits_text(item.low, item.high) or DASH),
                _judgement(item, half_width),
            ]
        )
        rows.append(row)
    heads = ["Measured", ">Value", ">±", "Unit", "Limits", "Result"]
    caption = "Measurements of the procedure and their limits; ± is half of the 95 % interval."
    return [Table(heads, rows, caption)]


def streams_table(runs: Sequence[RunContent]) -> Table:
    """Return what came of the gyros' streams, a row for each run and gyro."""
    streams = [(run, gyro, stream) for run in runs for gyro, stream in run.manifest.stream.items()]
    rates = column((stream.get("sample_rate_hz") for *_, stream in streams), 6, 3)
    rows = []
    for (run, gyro, stream), rate in zip(streams, rates, strict=True):
        frames, lost, rejected = stream.get("frames"), stream.get("lost"), stream.get("rejected")
        sent = 0 if frames is None or lost is None else frames + lost
        row = named(
            run.run_id,
            f"{gyro} ({run.manifest.units[gyro]})" if gyro in run.manifest.units else gyro,
            fixed(frames, 0),
            _loss_cell(lost),
            significant(1e6 * (lost or 0) / sent, 2) if sent else DASH,
            _loss_cell(None if rejected is None else sum(rejected.values())),
            rate,
            fixed(stream.get("clock_error_ppm"), 1),
        )
        rows.append(row)
    heads = ["Run", "Gyro (unit)", ">Frames", ">Lost", ">Lost [ppm]", ">Rejected"]
    heads += [">Sample rate [Hz]", ">Clock error [ppm]"]
    caption = "Streams as recorded. A frame that was lost or rejected is marked in the record."
    if off := [f"{gyro} {fixed(stream['off'], 0)}" for _, gyro, stream in streams if stream.get("off")]:
        caption += f" Not sent while switched off by the procedure, and not lost: {', '.join(off)} frames."
    return Table(heads, rows, caption)


def _pulse_tables(runs: Sequence[RunContent]) -> list[Table]:
    """Return what pulses at the units' trigger inputs say of the clocks; nothing where no unit tells of them."""
    rows = []
    for run in runs:
        for gyro, stream in run.manifest.stream.items():
            if not (pulses := stream.get("pulses")):
                continue
            unit, bench = (
                (pulses.get(f"{clock}_clock_error_ppm"), pulses.get(f"{clock}_clock_uncertainty_ppm"))
                for clock in ("unit", "bench")
            )
            scatter_s = pulses.get("scatter_s")
            row = named(
                run.run_id,
                gyro,
                fixed(pulses.get("pulses"), 0),
                fixed(pulses.get("missed"), 0),
                *(with_uncertainty(*clock) for clock in (unit, bench)),
                fixed(None if scatter_s is None else 1e6 * scatter_s, 2),
            )
            rows.append(row)
    heads = [
        "Run",
        "Gyro",
        ">Pulses",
        ">Missed",
        ">Unit's clock [ppm]",
        ">Bench's clock [ppm]",
        ">Scatter [µs]",
    ]
    caption = (
        "Clocks against the pulses at the units' trigger inputs, positive when fast, ± the standard uncertainty. "
        "The scatter is that of the pulses about a line, by the unit's clock."
    )
    return [Table(heads, rows, caption)] if rows else []


def devices_table(runs: Sequence[RunContent]) -> list[Block]:
    """Return the devices that took part, as they identified themselves, each once."""
    devices = dict.fromkeys(
        (name, device.role, device.maker, device.model, device.serial_number, device.firmware)
        for run in runs
        for name, device in run.manifest.devices.items()
    )
    rows = [named(name, *(text or DASH for text in facts)) for name, *facts in devices]
    heads = ["Device", "Role", "Maker", "Model", "Serial number", "Firmware"]
    return [Table(heads, rows, "Devices as they identified themselves when the run began.")]


def checksum_table(checksums: Mapping[str, str], caption: str) -> list[Block]:
    """Return names with their SHA-256 checksums."""
    rows = [named(name, Cell(value or DASH, code=True)) for name, value in checksums.items()]
    return [Table(["Run", "SHA-256"], rows, caption)]


def software_facts(software: Mapping[str, str], bench_file_sha256: str) -> list[Block]:
    """Return what software on which bench file made this."""
    facts = [Fact(name, version) for name, version in software.items()]
    if bench_file_sha256:
        facts.append(Fact("Bench file, SHA-256", bench_file_sha256, code=True))
    return [Facts(facts)]


def record_sections(
    runs: Sequence[RunContent], provenance: Sequence[Block], terms: Sequence[Block] = ()
) -> list[Section]:
    """Return what every report says of its runs' records: streams (with `terms`), devices, `provenance`."""
    streams = streams_table(runs)
    return [
        Section("Streams", [streams, *_pulse_tables(runs), *(terms if streams.rows else [])]),
        Section("Devices", devices_table(runs)),
        Section("Provenance", provenance),
    ]


def _parameters_text(run: RunContent, common: Mapping[str, Any]) -> str:
    parameters = {name: value for name, value in run.manifest.parameters.items() if name not in common}
    return ", ".join(" ".join(parameter(name, value)) for name, value in parameters.items())


def _common_parameters(runs: Sequence[RunContent]) -> dict[str, Any]:
    """Return what all of several runs were given alike, so that the table shows what differs."""
    if len(runs) < 2:
        return {}
    first, *others = (run.manifest.parameters for run in runs)
    return {
        name: value
        for name, value in first.items()
        if all(name in other and other[name] == value for other in others)
    }


def limits_text(low: float | None, high: float | None) -> str:
    """Return two optional limits as text, empty if there is none."""
    if low is not None and high is not None:
        return f"{plain(low)} … {plain(high)}"
    if low is not None:
        return f"≥ {plain(low)}"
    return f"≤ {plain(high)}" if high is not None else ""


def _judgement(item: Measured, half_width: float | None) -> Cell:
    if item.passed is None or not limited(item):
        return Cell(DASH)
    value, within = item.value, ""
    if value is not None and half_width is not None:
        limits = [limit for limit in (item.low, item.high) if limit is not None]
        if min(abs(value - limit) for limit in limits) < half_width:
            within = ", nearer to a limit than ±"
    return (
        Cell(f"inside{within}", "doubt" if within else "good")
        if item.passed
        else Cell(f"outside{within}", "bad")
    )


def _check_cell(item: Measured | None, first: Measured) -> Cell:
    if item is None:
        return Cell(DASH)
    text = significant(item.value)
    if (item.low, item.high) != (first.low, first.high):
        text = f"{text} ({limits_text(item.low, item.high)})"
    return Cell(text, "bad") if item.passed is False else Cell(text)


def _loss_cell(number: int | None) -> Cell:
    return Cell(fixed(number, 0), "doubt" if number else "plain")
