"""Two captures compared: what changed is found, what differs from run to run is not."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmarks import goldens
from benchmarks._golden_compare import compare, shown

MANIFEST = {
    "run_id": "20260101-120000-known-state",
    "started_utc": "2026-01-01T12:00:00.000+00:00",
    "bench": {"table": {"port": "/dev/pts/0"}},
    "measurements": [{"name": "rate", "value": 0.1}, {"name": "angle", "value": 2.0}],
}


def captured(folder, stamp="20260101-120000", column=(1.0, 2.0), raw=b"\x01\x02\x03", **changes):
    run = folder / "work" / "runs" / "state"
    (run / "raw").mkdir(parents=True)
    (run / "raw" / "fog_1.bin").write_bytes(raw)
    (run / "manifest.json").write_text(json.dumps(MANIFEST | changes))
    pq.write_table(pa.table({"rate_dps": list(column)}), run / "gyro_fog_1.parquet")
    out = folder / "results" / "rehearse-state"
    out.mkdir(parents=True)
    lines = [{"kind": "progress", "time_s": 1.0}] if stamp.startswith("2026") else []
    lines += [{"kind": "result", "folder": f"{folder}/{stamp}-a"}]
    (out / "stdout").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (folder / "capture.json").write_text(json.dumps({"folder": str(folder)}))
    return folder


@pytest.fixture
def base(tmp_path):
    return captured(tmp_path / "base")


def test_what_differs_from_run_to_run_is_no_difference(base, tmp_path, capsys):
    other = captured(
        tmp_path / "other",
        stamp="20270202-130000",
        run_id="20270202-130000-known-state",
        started_utc="2027-02-02T13:00:00.000+00:00",
        bench={"table": {"port": "/dev/pts/7"}},
    )
    (other / "work" / "runs" / "state" / "live").mkdir()
    (other / "work" / "runs" / "state" / "live" / "now.json").write_text("{}")
    assert compare(base, other) == []
    assert goldens.main(["compare", str(base), str(other)]) == 0
    assert "0 differences" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "field", "values"),
    [
        ({"raw": b"\x01\x02\x04"}, "bytes", ("at 2: 03", "at 2: 04")),
        ({"column": (1.0, 2.5)}, "column rate_dps", ("2.0 in row 1", "2.5 in row 1")),
        (
            {"measurements": [MANIFEST["measurements"][0], {"name": "angle", "value": 2.0000000000000004}]},
            "measurements[1] angle.value",
            ("2.0", "2.0000000000000004"),
        ),
        ({"bench": {"table": {"port": "/dev/ttyS0"}}}, "bench.table.port", ("<terminal>", "/dev/ttyS0")),
        ({"bench": {"table": {}}}, "bench.table.port", ("'/dev/pts/0'", "missing")),
        ({"repeats": 1}, "repeats", ("missing", "1")),
    ],
)
def test_a_change_is_found_with_both_values(base, tmp_path, changes, field, values):
    found = compare(base, captured(tmp_path / "other", **changes))
    (one,) = [each for each in found if each.field == field]
    assert values[0] in one.a and values[1] in one.b
    assert {each.file for each in found} == {one.file}
    assert one.a in shown(found) and one.b in shown(found)


def test_a_file_that_is_gone_is_found(base, tmp_path):
    other = captured(tmp_path / "other")
    (other / "work" / "runs" / "state" / "raw" / "fog_1.bin").unlink()
    (one,) = compare(base, other)
    assert (one.file, one.a, one.b) == ("work/runs/state/raw/fog_1.bin", "there", "missing")


def test_a_capture_takes_what_is_missing_and_names_the_run(tmp_path, capsys):
    command = tmp_path / "gyrobench"
    command.write_text(
        '#!/bin/sh\necho "$@"\n'
        'for word; do [ "$before" = --runs ] && mkdir -p "$word/20260101-120000-x"; before=$word; done\nexit 0\n'
    )
    command.chmod(0o755)
    words = ["capture", str(tmp_path / "out"), "--command", str(command), "--only", "rehearse-state"]
    assert goldens.main(words) == 0
    said = json.loads((tmp_path / "out/results/rehearse-state/command.json").read_text())
    assert said["exit_code"] == 0 and said["args"][:2] == ["rehearse", "known-state"]
    assert (tmp_path / "out/results/rehearse-state/stdout").read_text().startswith("rehearse known-state")
    assert (tmp_path / "out/work/runs/state").is_dir()
    assert "rehearse-state: exit 0" in capsys.readouterr().out
