"""The commands `gyrobench runs ...`. They load little: a list is mostly the start of a process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, Typer, echo, style

from bench.present.cli._options import DEFAULT_RUNS, Json, RunArgument, RunsFolder, TextCommand, TextGroup
from bench.present.cli._texts import duration, printable, size
from drivers.base.errors import BenchError, ConfigurationError

if TYPE_CHECKING:
    from rich.progress import Progress

    from bench.record.catalogue import CatalogueRow

OUTCOMES = ("completed", "invalid", "aborted", "running", "unreadable")
STYLES = {"completed": "green", "invalid": "yellow", "aborted": "red", "running": "cyan"}
_MANY = 2000
"""Manifests to read for which a bar is shown."""

app = Typer(cls=TextGroup, name="runs", no_args_is_help=True)

CatalogueUrl = Annotated[
    str | None,
    Option(
        "--catalogue",
        envvar="GYROBENCH_CATALOGUE",
        help="URL of a shared catalogue: postgresql://... or sqlite:///FILE; default a file beside the runs",
    ),
]


@app.command("list", cls=TextCommand)
def list_(
    runs: Annotated[str, Argument(metavar="FOLDER", help="folder that holds the runs")] = str(DEFAULT_RUNS),
    unit: Annotated[str | None, Option(help="of this unit under test")] = None,
    procedure: Annotated[str | None, Option(help="of this procedure")] = None,
    outcome: Annotated[str | None, Option(help="completed, invalid, aborted, running, unreadable")] = None,
    since: Annotated[str | None, Option(help="from this year, month, day or time on, UTC")] = None,
    until: Annotated[str | None, Option(help="to the end of this year, month, day or time, UTC")] = None,
    limit: Annotated[str, Option(metavar="COUNT", help="show at most so many, newest first")] = "100",
    catalogue: CatalogueUrl = None,
    json: Annotated[bool, Option("--json", help="print JSON")] = False,
) -> None:
    """List the runs in a folder, or in a shared catalogue."""
    from json import dumps

    from bench.record.catalogue import find_runs

    if not limit.isdecimal() or int(limit) < 1:
        raise ConfigurationError("no number of runs", where="--limit", found=limit, expected="1 or more")
    if outcome is not None and outcome not in OUTCOMES:
        raise ConfigurationError(
            "no outcome of a run", where="--outcome", found=outcome, expected=", ".join(OUTCOMES)
        )
    wanted = {"unit": unit, "procedure": procedure, "outcome": outcome, "since": since, "until": until}
    with _bar() as progress:
        rows, count, unread = find_runs(Path(runs), catalogue, limit=int(limit), progress=progress, **wanted)
    if json:
        echo(dumps([asdict(row) for row in rows], ensure_ascii=False))
    elif rows:
        _print_table(rows)
        if unread and any(wanted.values()):
            echo(
                f"the newest {len(rows)} of {count} or more; --limit shows more; {unread} older runs have not "
                f"been read yet: `gyrobench runs index --runs {runs}` reads them"
            )
        elif count + unread > len(rows):
            echo(f"the newest {len(rows)} of {count + unread}; --limit shows more")
    elif any(wanted.values()):
        echo("no runs that fit")
    else:
        echo(f"no runs in {runs}")


@app.command()
def index(
    runs: RunsFolder = DEFAULT_RUNS,
    catalogue: CatalogueUrl = None,
    rebuild: Annotated[bool, Option("--rebuild", help="read every run folder again")] = False,
    as_json: Json = False,
) -> None:
    """Bring the catalogue up to date with the run folders."""
    from json import dumps

    from bench.record.catalogue import index_runs

    with _bar() as progress:
        count = index_runs(runs, catalogue, rebuild=rebuild, progress=progress)
    if as_json:
        echo(dumps({"kind": "result", "manifests": count}))
    else:
        echo(f"{count} manifests read in {runs}")


@app.command()
def export(
    run: RunArgument,
    format_: Annotated[str, Option("--format", help="csv, parquet, mdf4 or blf (recorded CAN frames)")],
    out: Annotated[Path | None, Option(help="file or folder; default named after the run")] = None,
    as_json: Json = False,
) -> None:
    """Write a run for other software."""
    from bench.present.cli._console import Terminal
    from bench.record.exchange import export_run

    console = Terminal(as_json=as_json)
    with console.status(f"writing {format_}"):
        target = export_run(run, format_, out)
    files = [target] if target.is_file() else sorted(target.iterdir())
    total = sum(path.stat().st_size for path in files)
    console.say(f"{target}: {len(files)} files, {size(total)}")
    console.say_json("result", place=target, files=[path.name for path in files], bytes=total)


@app.command()
def show(run: RunArgument, as_json: Json = False) -> None:
    """Show a run: parameters, devices, figures and outcome."""
    from bench.present.cli._console import Terminal
    from bench.present.cli._measured import number, say_measurements
    from bench.record.recording import Run
    from bench.record.run_folder import url_of
    from bench.record.run_notes import read_notes

    console = Terminal(as_json=as_json)
    manifest = Run.open(run).manifest
    console.say_json("result", manifest=manifest.model_dump(mode="json"))
    outcome = (manifest.outcome, STYLES[manifest.outcome])
    console.parts((manifest.run_id, "bold"), "  ", outcome, f"  {manifest.reason}")
    length = "not closed" if manifest.duration_s is None else duration(manifest.duration_s)
    console.say(f"{manifest.procedure}, started {manifest.started_utc}, bench time {length}")
    console.say("parameters: " + ", ".join(f"{k}={v}" for k, v in manifest.parameters.items()))
    keys = ("kind", "maker", "model", "serial_number", "firmware")
    devices = [(name, *(getattr(device, key) for key in keys)) for name, device in manifest.devices.items()]
    console.table(("device", *(key.replace("_", " ") for key in keys)), devices)
    say_measurements(console, manifest.measurements)
    streams = [
        (
            name,
            str(stream.get("frames", "-")),
            _lost(stream),
            str(sum((stream.get("rejected") or {}).values())),
            number(stream.get("sample_rate_hz"), ".6f"),
            number(stream.get("clock_error_ppm"), "+.2f"),
        )
        for name, stream in manifest.stream.items()
    ]
    console.table(("gyro", "frames", "lost", "rejected", "sample rate Hz", "clock error ppm"), streams)
    pulses = [
        (
            name,
            str(found["pulses"]),
            str(found["missed"]),
            *(_clock(found, clock) for clock in ("unit", "bench")),
        )
        for name, stream in manifest.stream.items()
        if (found := stream.get("pulses"))
    ]
    if pulses:
        heads = ("gyro", "pulses", "missed", "unit's clock off by ppm", "bench's clock off by ppm")
        console.table(heads, pulses)
    if not url_of(run) and (notes := read_notes(run)):
        console.table(
            ("noted", "by", "note"),
            [
                (row.utc[:16].replace("T", " "), row.by, " ".join(filter(None, (row.text, row.picture))))
                for row in notes
            ],
        )


@app.command()
def note(
    run: RunArgument,
    text: Annotated[str, Argument(help="what is to be noted")] = "",
    by: Annotated[str, Option(help="who notes it")] = "",
    picture: Annotated[Path | None, Option(help="a PNG or JPEG of at most 8 MiB")] = None,
    as_json: Json = False,
) -> None:
    """Attach a note or a picture to a run.

    It is kept beside the record, whose seal stays whole.
    """
    from bench.present.cli._console import Terminal
    from bench.record.run_folder import is_run, url_of
    from bench.record.run_notes import MOST_PICTURE_BYTES, add_note
    from drivers.base.files import read_bounded

    if url_of(run) or not is_run(run):
        raise ConfigurationError(
            "no run to note anything of", where=str(run), expected="a run folder on this machine"
        )
    try:
        content = b"" if picture is None else read_bounded(picture, MOST_PICTURE_BYTES)
    except OSError as error:
        raise ConfigurationError(
            "the picture cannot be read", where=str(picture), found=error.strerror or str(error)
        ) from error
    added = add_note(run, by, text, content)
    console = Terminal(as_json=as_json)
    console.say(f"noted in {run}: {added.by}, {added.utc}")
    console.say_json("result", note=asdict(added))


@app.command()
def recover(
    run: Annotated[list[Path] | None, Argument(help="run folders")] = None,
    all_: Annotated[bool, Option("--all", help="every run in the runs folder that was not closed")] = False,
    runs: RunsFolder = DEFAULT_RUNS,
    as_json: Json = False,
) -> None:
    """Complete runs that a crash left open.

    The raw bytes are decoded, checksums are made, and the run is marked as aborted. Exit code 1 if one cannot be
    completed.
    """
    from bench.control.recover import open_runs
    from bench.control.recover import recover as complete
    from bench.present.cli._console import Terminal

    console, ends = Terminal(as_json=as_json), []
    folders = [*(run or []), *(open_runs(runs) if all_ else [])]
    if not folders:
        console.print("no run to recover")
    failed = False
    for folder in folders:
        try:
            manifest = complete(folder)
        except BenchError as error:
            failed = True
            console.say(f"not recovered  {folder}: {error}", style="red")
            ends.append({"folder": folder, "outcome": None, "reason": str(error)})
        else:
            console.say(f"{manifest.outcome}  {folder}: {manifest.reason}")
            ends.append({"folder": folder, "outcome": manifest.outcome, "reason": manifest.reason})
    console.say_json("result", recovered=ends)
    sys.exit(1 if failed else 0)


@app.command()
def verify(
    run: Annotated[list[Path], Argument(help="run folders")],
    signed_by: Annotated[
        list[Path] | None,
        Option("--signed-by", metavar="FILE", help="a public key; a run that none of these signed differs"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check runs against their checksums, signatures and raw bytes.

    The checksums are computed again, manifest and events are compared, and the decoded tables are made again from
    the raw bytes. Exit code 1 if anything differs. Manifests from before November 2026 are "not sealed". Without
    --signed-by the key of this bench is known.
    """
    from bench.control.run_record import decode_run
    from bench.present.cli._console import Terminal
    from bench.record.recording import verify as verify_record
    from bench.record.run_folder import url_of
    from bench.record.signing import known_keys

    console, reports = Terminal(as_json=as_json), []
    failed = False
    keys = known_keys(signed_by)
    for folder in run:
        report = verify_record(folder, decode_run, keys, must_be_signed=bool(signed_by))
        name = url_of(folder) or folder
        reports.append({"run": str(name), "passed": report.passed, "report": report})
        if report.passed:
            counts = f"{report.files} checksums, {report.tables} tables rebuilt"
            seal = "" if report.sealed else ", manifest not sealed"
            console.parts(("verified", "green"), f"  {name}: {counts}{seal}")
            if report.signed_by:
                console.say(f"  signed by {report.signed_by} ({report.signed.replace(chr(9), ', ')})")
            if report.unknown_key:
                console.say(f"  signed by a key that is not known here, {report.unknown_key}", style="yellow")
            continue
        failed = True
        console.parts(("differs", "red"), f"  {name}")
        console.say_all(f"  {problem.path}: {problem.text}" for problem in report.problems)
    console.say_json("result", verified=reports)
    sys.exit(1 if failed else 0)


def _print_table(rows: Sequence[CatalogueRow]) -> None:
    """Print in columns; names are never cut, since one that is cannot be copied."""
    several = len({row.root for row in rows}) > 1
    benches = ["bench", *(row.bench or row.root for row in rows)]
    cells = [("run", "procedure", "units", "bench time", "started (UTC)", "outcome")]
    for row in rows:
        length = "-" if row.duration_s is None else duration(row.duration_s)
        started = f"{datetime.fromtimestamp(row.started_s, UTC):%Y-%m-%d %H:%M}" if row.started_s else "-"
        outcome = f"unreadable: {row.reason}" if row.outcome == "unreadable" else row.outcome
        units = ", ".join(row.units) or "-"
        cells.append((row.name, row.procedure or "-", units, length, started, outcome))
    lines = [[printable(cell) for cell in line] for line in cells]
    if several:
        lines = [[printable(bench), *line] for bench, line in zip(benches, lines, strict=True)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    colours = [None, *(STYLES.get(row.outcome, "red") for row in rows)]
    for line, colour in zip(lines, colours, strict=True):
        padded = [cell.ljust(width) for cell, width in zip(line[:-1], widths[:-1], strict=True)]
        echo("  ".join([*padded, style(line[-1], fg=colour)]))


@contextmanager
def _bar() -> Iterator[Callable[[int, int], None]]:
    """Give what is to be told of the manifests read: a bar is shown once there are many."""
    bars: list[Progress] = []
    with ExitStack() as stack:

        def show(done: int, total: int) -> None:
            if total > _MANY and not bars:
                from rich.progress import Progress

                bars.append(stack.enter_context(Progress(transient=True)))
                bars[0].add_task("reading run folders", total=total)
            for bar in bars:
                bar.update(bar.task_ids[0], completed=done)

        yield show


def _clock(pulses: Mapping[str, Any], clock: str) -> str:
    error, uncertainty = (pulses.get(f"{clock}_clock_{what}_ppm") for what in ("error", "uncertainty"))
    return "-" if error is None or uncertainty is None else f"{error:+.4f} ± {uncertainty:.1g}"


def _lost(stream: Mapping[str, Any]) -> str:
    off = stream.get("off")
    return f"{stream.get('lost', '-')}" + (f", {off} not sent while off" if off else "")
