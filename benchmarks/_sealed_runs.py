"""Small run folders of every origin: closed, recovered after a crash, imported from another bench."""

from __future__ import annotations

import math
import os
import shutil
import zlib
from pathlib import Path
from typing import Any
from unittest import mock

from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.recover import recover
from bench.control.session import Bench
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.record.benchfile import bench_file_from
from bench.record.events.safe import Takeover
from bench.record.exchange import import_log
from bench.record.recording import EventLog, read_manifest, write_manifest
from bench.record.signing import KEY_VARIABLE, SigningKey

GYROS: tuple[dict[str, Any], ...] = (
    {"name": "fog_1", "driver": "kvh1750", "port": "pty", "rate_hz": 100, "axis": "x", "unit": "F1"},
    {
        "name": "can_1",
        "driver": "sbg_ellipse",
        "interface": "gyrobench_slcan",
        "channel": "pty-can",
        "rate_hz": 100,
        "axes": "xyz",
        "axis": "z",
        "unit": "E1",
    },
)
FILE: dict[str, Any] = {
    "bench": {"name": "sealed", "latitude_deg": 39.1},
    "table": {"driver": "acutrol3000", "port": "pty-table"},
    "chamber": {"driver": "weiss", "port": "pty-chamber"},
    "gyro": list(GYROS),
}
_MAPPING = """
format = 1
unit_id = "G7"
latitude_deg = 39.1
gyro = "fog"
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/s" }
t_in = { name = "temp", unit = "degC" }
angle = { name = "table", unit = "deg" }
air = { name = "air", unit = "degC" }
[[run]]
file = "log.csv"
run_id = "imported"
started_utc = "2026-10-05T08:00:00+00:00"
phases = [{ name = "reference", start_s = 0.0 }, { name = "shock", start_s = 60.0 }]
"""
_TURN_S = 20.0


def sealed_runs(folder: Path, key: SigningKey) -> dict[str, Path]:
    """Make the runs below `folder`, signed by a key; return them by origin."""
    path = folder / "bench.key"
    key.save(path)
    with mock.patch.dict(os.environ, {KEY_VARIABLE: str(path)}):
        closed = _closed(folder)
        return {"closed": closed, "recovered": _recovered(closed, folder), "imported": _imported(folder)}


def _closed(folder: Path) -> Path:
    picture = folder / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + zlib.compress(bytes(range(256))))

    def turn(bench: Bench, _: Parameters) -> None:
        bench.ask("Is the chamber closed?", picture=picture)
        bench.table.device.servo_on()
        with bench.step("1", "Turn"):
            bench.table.spin(5.0)
            bench.wait(_TURN_S, "turning")
        bench.measure("rate_error", 0.25, "deg/h", low=-1.0, high=1.0)
        bench.table.stop()

    procedure = Procedure(
        "turn",
        "A turn",
        "",
        Parameters,
        turn,
        lambda _: _TURN_S,
        lambda _: Demands(5.0),
        text="RATE_DPS = 5.0\n",
    )
    file = bench_file_from(FILE)
    result = rehearse_procedure(
        procedure, Parameters(), file, Plant(seed=11), folder / "runs", run_id="closed"
    )
    if result.outcome != "completed":
        raise RuntimeError(f"the run to tamper with ended as {result.outcome}: {result.reason}")
    return result.folder


def _recovered(closed: Path, folder: Path) -> Path:
    """Return what `runs recover` makes of the run as a kill would have left it, its watchdog's notes included."""
    run = folder / "runs" / "recovered"
    (run / "watchdog").mkdir(parents=True)
    shutil.copytree(closed / "raw", run / "raw")
    lines = (closed / "events.jsonl").read_bytes().splitlines(keepends=True)
    (run / "events.jsonl").write_bytes(b"".join(lines[:-1]))
    manifest = read_manifest(closed)
    starts = {name: {"start_offset": entry["start_offset"]} for name, entry in manifest.stream.items()}
    left = {
        "run_id": "recovered",
        "outcome": "running",
        "seal": "",
        "files": {},
        "written": {},
        "stream": starts,
    }
    ended = {"ended_utc": None, "duration_s": None, "measurements": ()}
    write_manifest(run, manifest.model_copy(update=left | ended))
    notes = EventLog(run / "watchdog")
    notes.event(12.0, Takeover("runner_ended", "2026-10-05T08:00:12+00:00", 4711))
    notes.close()
    recover(run)
    return run


def _imported(folder: Path) -> Path:
    rows = [
        f"{t},{3.0 + math.exp(-t / 30.0):.9f},{20.0 - 0.05 * t:.3f},{3.0 * t % 360.0:.3f},{20.0 - 0.07 * t:.2f}"
        for t in range(120)
    ]
    log, mapping = folder / "log.csv", folder / "map.toml"
    log.write_text("\n".join(["t,rate,temp,table,air", *rows]) + "\n", encoding="ascii")
    mapping.write_text(_MAPPING, encoding="ascii")
    return import_log(log, mapping, folder / "runs")
