"""Logs of other benches that would fill the memory, name files elsewhere, or give a run that nobody can read."""

import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.record.catalogue._database import Database, _without_password
from bench.record.exchange import import_log
from bench.record.recording import read_events, read_manifest
from drivers.base.errors import BenchError, ConfigurationError, RecordError

MAPPING = """format = 1
unit_id = "U"
latitude_deg = 40.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "w", unit = "deg/s" }
"""
ROWS = "t,w\n" + "".join(f"{k},1\n" for k in range(30))


def bring_in(folder: Path, name: str, content: str | bytes, more: str = "") -> Path:
    (folder / "m.toml").write_text(MAPPING + more)
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return import_log(folder / name, folder / "m.toml", folder / "runs")


@pytest.mark.parametrize("last", ["inf", "1e300", "1e12", "3.3e7"])
def test_times_of_no_recording_are_refused_before_a_grid_is_made(last, tmp_path):
    with pytest.raises(ConfigurationError, match="times are none of a recording"):
        bring_in(tmp_path, "log.csv", f"t,w\n0,1\n1,1\n{last},1\n")
    assert not list((tmp_path / "runs").glob("*"))


@pytest.mark.parametrize("name", ["a\nb.csv", "a\x1b[2Jb.csv", "mapping.toml", "x" * 220 + ".csv"])
def test_a_log_keeps_its_name_or_is_refused(name, tmp_path):
    with pytest.raises(ConfigurationError, match="name") as caught:
        bring_in(tmp_path, name, ROWS)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize(
    "more",
    [
        '[[run]]\nstarted_utc = "0001-01-01T00:00:00"\n',
        "[[run]]\npower_on_s = 1e308\n",
        "[[run]]\nazimuth_error_deg = 1e308\n",
        '[[run]]\nphases = [{ name = "a", start_s = 1e300 }]\n',
        f'[[run]]\nrun_id = "{"x" * 300}"\n',
    ],
)
def test_a_mapping_makes_no_run_that_cannot_be_read(more, tmp_path):
    with pytest.raises(ConfigurationError):
        bring_in(tmp_path, "log.csv", ROWS, more)
    folder = bring_in(tmp_path, "log.csv", ROWS)
    assert read_manifest(folder).complete and read_events(folder).rows


def test_packed_and_repeated_rows_do_not_fill_the_memory(tmp_path):
    with pytest.raises(ConfigurationError, match="packed"):
        bring_in(tmp_path, "log.csv.gz", gzip.compress(ROWS.encode()))
    table = pa.table({name: np.zeros(10_000_000, np.int8) for name in ("t", "w")})
    with pq.ParquetWriter(tmp_path / "many.parquet", table.schema) as writer:
        for _ in range(2):
            writer.write_table(table, row_group_size=len(table))
    many = (tmp_path / "many.parquet").read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.sysconf", lambda name: {"SC_PAGE_SIZE": 4096}.get(name, 50_000))  # 200 MiB
        with pytest.raises(BenchError, match="larger than this machine's memory"):
            bring_in(tmp_path, "many.parquet", many)


@pytest.mark.parametrize(
    "url",
    [
        "postgresql://me:s3cret@localhost:1/runs",
        "postgresql://me:s3cret@s3cret@localhost:1/runs",
        "postgresql://me:s3cret/s3cret@localhost:1/runs",
        "postgres://localhost:1/runs?user=me&password=s3cret",
        "mysql://me:s3cret@localhost/runs",
        "postgresql://me:s3cret@localhost:port/runs",
    ],
)
def test_the_catalogues_password_is_in_no_error(url):
    assert "s3cret" not in _without_password(url)
    with pytest.raises((ConfigurationError, RecordError)) as caught:
        Database(url + ("&" if "?" in url else "?") + "connect_timeout=1")
    assert "s3cret" not in str(caught.value) and "localhost" in str(caught.value)
