"""`gyrobench runs`: show, recover, verify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from bench.control.recover import recover
from bench.control.run_record import decode_run
from bench.present.cli._console import Terminal
from bench.present.cli._runs_list import STYLES
from bench.present.cli._texts import duration
from bench.record.recording import Run, read_manifest, verify
from bench.record.run_folder import MANIFEST_FILE, url_of
from drivers.base.errors import BenchError


def show_command(folder: Path) -> None:
    """Print a run's parameters, devices, measurements and streams."""
    console = Terminal()
    run = Run.open(folder)
    found = run.manifest
    style = STYLES[found.outcome]
    console.print(Text.assemble((found.run_id, "bold"), "  ", (found.outcome, style), f"  {found.reason}"))
    length = "not closed" if found.duration_s is None else duration(found.duration_s)
    console.print(f"{found.procedure}, started {found.started_utc}, bench time {length}", highlight=False)
    console.print(
        "parameters: " + ", ".join(f"{k}={v}" for k, v in found.parameters.items()), highlight=False
    )
    devices = Table("device", "kind", "maker", "model", "serial number", "firmware")
    for name, device in found.devices.items():
        devices.add_row(name, device.kind, device.maker, device.model, device.serial_number, device.firmware)
    console.print(devices)
    if found.measurements:
        measured = Table("measurement", "value", "unit", "low", "high", "judged")
        for row in found.measurements:
            low, high = ("-" if row[key] is None else f"{row[key]:g}" for key in ("low", "high"))
            value = "-" if row["value"] is None else f"{row['value']:.6g}"
            measured.add_row(row["name"], value, row["unit"], low, high, _judged(row))
        console.print(measured)
    streams = Table("gyro", "frames", "lost", "rejected", "sample rate Hz", "clock error ppm")
    for name, stream in found.stream.items():
        rejected = sum((stream.get("rejected") or {}).values())
        rate, error = stream.get("sample_rate_hz"), stream.get("clock_error_ppm")
        streams.add_row(
            name,
            str(stream.get("frames", "-")),
            _lost(stream),
            str(rejected),
            "-" if rate is None else f"{rate:.6f}",
            "-" if error is None else f"{error:+.2f}",
        )
    console.print(streams)


def _lost(stream: Mapping[str, Any]) -> str:
    off = stream.get("off")
    return f"{stream.get('lost', '-')}" + (f", {off} not sent while off" if off else "")


def _judged(row: Mapping[str, Any]) -> str:
    if row["low"] is None and row["high"] is None:
        return "no limits"  # older records say passed there
    return "inside" if row["passed"] else "outside"


def recover_command(folders: Sequence[Path], root: Path | None) -> int:
    """Recover runs, with `root` every open one below it; 0 when all could be, 1 otherwise."""
    console = Terminal()
    found = list(folders)
    if root is not None:
        found += [path.parent for path in sorted(root.glob(f"*/{MANIFEST_FILE}")) if _is_open(path.parent)]
    if not found:
        console.print("no run to recover")
    failed = False
    for folder in found:
        try:
            manifest = recover(folder)
        except BenchError as error:
            failed = True
            console.print(f"not recovered  {folder}: {error}", style="red", highlight=False)
        else:
            console.print(f"{manifest.outcome}  {folder}: {manifest.reason}", highlight=False)
    return 1 if failed else 0


def _is_open(folder: Path) -> bool:
    """Return whether a run was not closed; one that cannot be read is, and `recover` says why it cannot."""
    try:
        return not read_manifest(folder).complete
    except BenchError:
        return True


def verify_command(folders: Sequence[Path]) -> int:
    """Verify runs; 0 when nothing differs, 1 otherwise."""
    console = Terminal()
    failed = False
    for folder in folders:
        report, name = verify(folder, decode_run), url_of(folder) or folder
        if report.passed:
            console.print(
                Text.assemble(
                    ("verified", "green"),
                    f"  {name}: {report.files} checksums, {report.tables} tables rebuilt",
                )
            )
            continue
        failed = True
        console.print(Text.assemble(("differs", "red"), f"  {name}"))
        for problem in report.problems:
            console.print(f"  {problem.path}: {problem.text}", highlight=False)
    return 1 if failed else 0
