"""A report from a run folder: the folder is written by hand as docs/architecture.md says, the truth is known."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.present.report import render_page, run_content, run_page
from bench.record.recording import Run

DURATION_S = 1200
RATE_HZ = 10
ALARM = "compressor 2 overload"


def manifest_of(outcome: str = "completed", reason: str = "") -> dict[str, Any]:
    return {
        "format": 1,
        "run_id": "run-1",
        "procedure": "scale-factor-cold-shock",
        "parameters": {"rate_dps": 20.0, "cold_c": -45.0},
        "mounting": "axis_up",
        "outcome": outcome,
        "reason": reason,
        "started_utc": "2026-11-20T08:14:07.000+00:00",
        "ended_utc": "2026-11-20T08:34:07.000+00:00",
        "duration_s": float(DURATION_S),
        "bench": {"bench": {"name": "bench 7", "latitude_deg": 39.1}},
        "bench_file_sha256": "ab" * 32,
        "devices": {
            "table": {"kind": "acutrol3000", "role": "table", "maker": "Acutronic", "model": "ACUTROL3000"},
            "fog": {"kind": "kvh1750", "role": "gyro", "maker": "KVH", "serial_number": "S-17", "case_sensor": 2},
        },
        "units": {"fog": "S-17"},
        "emulated": {"seed": 5, "model": "fog_mid"},
        "software": {"gyrobench": "0.1.0"},
        "stream": {
            "fog": {
                "frames": 12000, "lost": 3, "rejected": {"checksum": 2, "length": 4},
                "sample_rate_hz": 10.0001, "clock_error_ppm": 10.0, "warnings": ["the counter restarted"],
            }
        },
        "measurements": [
            {"name": "shock_rate", "value": 11.5, "unit": "K/min", "low": 10.0, "high": None, "passed": True}
        ],
        "files": {},
    }  # fmt: skip


def write_folder(folder: Path, manifest: dict[str, Any], *, chamber: bool = True) -> Path:
    """Table at 20 deg/s from 300 s to 900 s, else at rest; the gyro reads the table's rate plus 0.36 deg/h."""
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    events: list[dict[str, Any]] = [
        {"time_s": 0.0, "kind": "phase", "phase": "warm_up"},
        {"time_s": 5.0, "kind": "answer", "question": "Ready?", "answer": "yes", "by": "J. Weber"},
        {"time_s": 300.0, "kind": "phase", "phase": "shock"},
        {"time_s": 400.0, "kind": "alarm", "device": "chamber", "text": ALARM},
        {"time_s": 400.0, "kind": "alarm", "device": "procedure", "text": "run invalid: too slow"},
        {"time_s": 1200.0, "kind": "outcome", "outcome": "completed", "reason": ""},
    ]
    lines = "".join(json.dumps(event) + "\n" for event in events)
    (folder / "events.jsonl").write_text(lines + '{"time_s": 12', encoding="utf-8")

    def table_rate(time_s: np.ndarray) -> np.ndarray:
        return np.where((time_s >= 300.0) & (time_s < 900.0), 20.0, 0.0)

    time_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    rate = table_rate(time_s) + 1e-4
    valid = np.ones(len(time_s), dtype=bool)
    valid[::50], rate[::50] = False, 400.0
    temp = np.where(np.arange(len(time_s)) % 10 == 0, 20.0 + time_s / 100.0, np.nan)
    gyro = {
        "time_ns": (time_s * 1e9).astype(np.int64),
        "counter": np.arange(len(time_s)),
        "lost_before": np.zeros(len(time_s), np.int32),
        "status": np.zeros(len(time_s), np.uint8),
        "valid": valid,
        "rate_dps": rate,
        "temp_c": temp,
    }
    pq.write_table(pa.table(gyro), folder / "gyro_fog.parquet")
    slow_s = np.arange(0.0, DURATION_S)
    slow_ns = (slow_s * 1e9).astype(np.int64)
    turntable = {"time_ns": slow_ns, "angle_deg": np.zeros(len(slow_s)), "rate_dps": table_rate(slow_s)}
    pq.write_table(pa.table(turntable), folder / "turntable.parquet")
    if chamber:
        air = {"air_temp_c": 25.0 - slow_s / 60.0, "set_point_c": np.full(len(slow_s), -45.0)}
        aux = {"aux_1_temp_c": np.full(len(slow_s), 99.0), "aux_2_temp_c": 24.0 - slow_s / 80.0}
        pq.write_table(pa.table({"time_ns": slow_ns, **air, **aux}), folder / "chamber.parquet")
    return folder


def test_everything_of_the_folder_arrives(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run-1", manifest_of())
    run = run_content(Run.open(folder))
    assert (run.run_id, run.manifest.outcome, run.valid) == ("run-1", "completed", True)
    assert run.manifest.units == {"fog": "S-17"} and run.operator == "J. Weber"
    assert run.emulated == "fog_mid, seed 5"
    assert run.checksum == hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()
    page = render_page(run_page(run))
    assert ">6<" in page and ">3<" in page and "bench 7" in page and "axis up" in page
    assert run.measurements[0].value == 11.5 and run.measurements[0].high is None
    assert f"chamber: {ALARM}" in run.warnings and "fog: the counter restarted" in run.warnings
    assert any("incomplete" in text for text in run.warnings)
    assert not any("run invalid" in text for text in run.warnings), "that is a reason, not a warning"


def test_the_trace_is_what_was_recorded(tmp_path: Path) -> None:
    (trace,) = run_content(Run.open(write_folder(tmp_path / "run-1", manifest_of()))).traces
    assert trace.phases == ((0.0, "warm_up"), (300.0, "shock"))
    assert trace.air_temp_c is not None and trace.case_temp_c is not None and trace.gyro_temp_c is not None
    np.testing.assert_allclose(trace.air_temp_c, 25.0 - trace.time_s / 60.0)
    np.testing.assert_allclose(trace.case_temp_c, 24.0 - trace.time_s / 80.0)
    inside = (trace.time_s >= 10.0) & (trace.time_s <= DURATION_S - 10.0)
    np.testing.assert_allclose(trace.gyro_temp_c[inside], 20.0 + trace.time_s[inside] / 100.0, atol=0.06)
    assert trace.output_dph is not None and trace.output_time_s is not None
    np.testing.assert_allclose(trace.output_time_s, np.arange(50.0, DURATION_S, 100.0))
    np.testing.assert_allclose(trace.output_dph, 0.36, atol=1e-6)
    assert trace.output_name == "Output less table rate"


def test_a_block_in_which_the_table_changed_its_rate_is_empty(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run-1", manifest_of())
    table = pq.read_table(folder / "turntable.parquet").to_pydict()
    table["rate_dps"] = [0.0 if at < 350 else rate for at, rate in enumerate(table["rate_dps"])]
    pq.write_table(pa.table(table), folder / "turntable.parquet")
    (trace,) = run_content(Run.open(folder)).traces
    assert trace.output_dph is not None
    assert np.flatnonzero(np.isnan(trace.output_dph)).tolist() == [3]
    assert trace.output_block_s == 100.0


def test_samples_between_two_readings_of_which_the_rates_differ_are_left_out(tmp_path: Path) -> None:
    """The gyro stops half a second before the reading that shows it."""
    folder = write_folder(tmp_path / "run-1", manifest_of())
    gyro = pq.read_table(folder / "gyro_fog.parquet").to_pydict()
    early = [899.5 <= 1e-9 * at < 900.0 for at in gyro["time_ns"]]
    gyro["rate_dps"] = [
        1e-4 if stopped else rate for stopped, rate in zip(early, gyro["rate_dps"], strict=True)
    ]
    pq.write_table(pa.table(gyro), folder / "gyro_fog.parquet")
    (trace,) = run_content(Run.open(folder)).traces
    np.testing.assert_allclose(trace.output_dph, 0.36, atol=1e-6)


def test_where_the_rate_changes_every_minute_the_blocks_are_shorter(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run-1", manifest_of())
    table = pq.read_table(folder / "turntable.parquet").to_pydict()
    table["rate_dps"] = [0.0 if at // 60 % 2 else 20.0 for at in range(len(table["rate_dps"]))]
    pq.write_table(pa.table(table), folder / "turntable.parquet")
    (trace,) = run_content(Run.open(folder)).traces
    assert trace.output_dph is not None and trace.output_time_s is not None
    assert trace.output_block_s == 10.0
    np.testing.assert_allclose(trace.output_time_s, np.arange(5.0, DURATION_S, 10.0))
    assert np.isfinite(trace.output_dph).mean() > 0.8
    # the gyro of this folder turns for ten minutes, whatever the table does
    known = trace.output_dph[np.isfinite(trace.output_dph)]
    assert set(np.round(known - 0.36, 3)) == {-72_000.0, 0.0, 72_000.0}


def test_a_run_without_chamber_or_gyro_table_says_so(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "run-1", manifest_of("aborted", "stopped by Ctrl-C"), chamber=False)
    content = run_content(Run.open(folder))
    assert content.traces[0].air_temp_c is None and content.traces[0].gyro_temp_c is not None
    assert "there is no decoded table of the chamber" in content.warnings
    (folder / "gyro_fog.parquet").unlink()
    content = run_content(Run.open(folder))
    assert content.traces == () and "there is no decoded table of fog" in content.warnings
    html = render_page(run_page(content))
    assert "stopped by Ctrl-C" in html and "Run aborted" in html and "<svg" not in html


def test_an_aborted_run_says_once_what_is_not_safe_and_what_was_read_back(tmp_path: Path) -> None:
    gone = "table: its port is gone (21 s ago it turned at 7 deg/s)"
    reason = f"the port is gone. NOT CONFIRMED SAFE, go and look: {gone}"
    folder = write_folder(tmp_path / "run-1", manifest_of("aborted", reason))
    rows: list[dict[str, Any]] = [
        {"kind": "note", "text": "made safe: before"},
        {"kind": "note", "text": "table at rest: 0.1 deg/s"},
        {"kind": "note", "text": "not made safe: the port is gone."},
        {"kind": "note", "text": "chamber at rest: stopped, set point 25 degC"},
        {"kind": "alarm", "device": "bench", "text": f"not confirmed safe: {gone}"},
    ]
    log = folder / "events.jsonl"
    whole = log.read_text(encoding="utf-8").rpartition("\n")[0] + "\n"  # less the line cut off on purpose
    whole += "".join(json.dumps({"time_s": float(DURATION_S)} | row) + "\n" for row in rows)
    log.write_text(whole, encoding="utf-8")
    summary = run_content(Run.open(folder))
    assert summary.reasons == (reason, "Read back then: chamber at rest: stopped, set point 25 degC.")
    assert any(ALARM in text for text in summary.warnings)
    assert not any("port is gone" in text for text in summary.warnings)


@pytest.mark.parametrize("outcome", ["completed", "invalid"])
def test_a_folder_renders(tmp_path: Path, outcome: str) -> None:
    folder = write_folder(
        tmp_path / "run-1", manifest_of(outcome, "too slow" if outcome == "invalid" else "")
    )
    html = render_page(run_page(run_content(Run.open(folder))))
    assert html.count("<svg") == 1 and ALARM in html and "S-17" in html
    assert ("too slow" in html) == (outcome == "invalid")


def test_without_scipy_a_report_says_why_it_shows_no_uncertainties(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_folder(tmp_path / "run-1", manifest_of())
    run = Run.open(folder)
    assert run_content(run).budgets == {} and not [t for t in run_content(run).warnings if "uncertain" in t]
    monkeypatch.setitem(sys.modules, "bench.analysis.figures", None)
    found = run_content(run, with_budgets=True)
    assert found.budgets == {}
    assert [text for text in found.warnings if "pip install 'gyrobench[analysis]'" in text]
