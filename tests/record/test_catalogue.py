"""The catalogue of runs against plain loops over the folders, in SQLite and in a PostgreSQL of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from bench.present.cli._app import app
from bench.record.catalogue import Catalogue, find_runs, root_name
from bench.record.catalogue import _catalogue as catalogue_module
from bench.record.catalogue._catalogue import period_s
from drivers.base.errors import ConfigurationError, RecordError


def make(runs: Path, name: str, **changes: object) -> None:
    manifest = {
        "run_id": name,
        "procedure": "zero-bias-cold-shock",
        "outcome": "completed",
        "started_utc": "2026-10-05T08:00:00+00:00",
        "duration_s": 3600.0,
        "units": {"fog_1": "SN123"},
        "bench": {"bench": {"name": "bench 2"}},
        **changes,
    }
    (runs / name).mkdir(parents=True, exist_ok=True)
    (runs / name / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


@pytest.fixture(scope="module")
def postgres() -> Iterator[str]:
    """Start a PostgreSQL server of this test's own, reached through a socket in a folder of its own."""
    found = [shutil.which("initdb"), *map(str, sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb")))]
    tools = Path(found[-1]).parent if found[-1] else None
    if tools is None or not (tools / "postgres").exists():
        pytest.skip("there is no PostgreSQL server here: apt-get install postgresql")
    as_root = os.geteuid() == 0
    user = {"user": "postgres", "group": "postgres", "extra_groups": []} if as_root else {}
    folder = Path(tempfile.mkdtemp(prefix="gb-pg-", dir="/tmp"))
    try:
        if as_root:
            shutil.chown(folder, "postgres", "postgres")
        options = {"cwd": folder, "stdin": subprocess.DEVNULL, **user}
        subprocess.run(
            [tools / "initdb", "-D", folder / "data", "-A", "trust", "-U", "gyrobench", "-E", "UTF8", "-N"],
            check=True, capture_output=True, **options,
        )  # fmt: skip
        settings_ = ["-c", "listen_addresses=", "-c", "fsync=off", "-k", str(folder)]
        server = [tools / "pg_ctl", "-D", folder / "data", "-w", "-t", "60"]
        log = folder / "log"
        subprocess.run(
            [*server, "-l", log, "-o", " ".join(f"'{word}'" for word in settings_), "start"],
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options,
        )  # fmt: skip
        yield f"postgresql+psycopg://gyrobench@/postgres?host={folder}"
        subprocess.run([*server, "-m", "immediate", "stop"], check=True, capture_output=True, **options)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'catalogue.sqlite'}"
    return str(request.getfixturevalue("postgres"))


def names(catalogue: Catalogue, runs: Path, **wanted: object) -> list[str]:
    return [row.name for row in catalogue.find(root=root_name(runs), **wanted)[0]]


def test_what_is_asked_for_is_what_a_loop_over_the_folders_finds(url: str, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    facts = []
    for k in range(60):
        started = f"2026-{7 + k % 6:02d}-{1 + k % 28:02d}T{k % 24:02d}:00:00+00:00"
        unit, procedure = f"SN{k % 7}", ("a", "b", "c")[k % 3]
        outcome = ("completed", "aborted")[k % 2]
        units = {"one": unit, "two": f"SN{k % 5}"}
        make(runs, f"run-{k:02d}", started_utc=started, units=units, procedure=procedure, outcome=outcome)
        facts.append((started, f"run-{k:02d}", set(units.values()), procedure, outcome))
    with Catalogue(url) as catalogue:
        assert catalogue.update(runs) == 60
        assert catalogue.update(runs) == 0
        for unit in (None, "SN1", "SN6", "none"):
            for procedure in (None, "b"):
                for since, until in (
                    (None, None),
                    ("2026-10", None),
                    ("2026-08", "2026-09"),
                    (None, "2026-07-03"),
                ):
                    expected = [
                        name
                        for started, name, units, kind, _ in sorted(facts, reverse=True)
                        if (unit is None or unit in units)
                        and (procedure is None or procedure == kind)
                        and (since is None or started >= since)
                        and (until is None or started[: len(until)] <= until)
                    ]
                    wanted = {"unit": unit, "procedure": procedure, "since": since, "until": until}
                    assert names(catalogue, runs, **wanted) == expected
        rows, count = catalogue.find(root=root_name(runs), outcome="aborted", limit=4)
        assert len(rows) == 4 and count == 30
        assert rows[0].units and rows[0].bench == "bench 2" and rows[0].duration_s == 3600.0


def test_what_comes_goes_and_ends_is_seen(url: str, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    make(runs, "one")
    make(runs, "two", outcome="running", duration_s=None)
    with Catalogue(url) as catalogue:
        catalogue.update(runs)
        assert names(catalogue, runs, outcome="running") == ["two"]
        make(runs, "two", outcome="invalid")
        make(runs, "three", units={"x": "Ü-7"})
        shutil.rmtree(runs / "one")
        (runs / "four").mkdir()
        (runs / "four" / "manifest.json").write_text("{")
        (runs / "no run").mkdir()
        catalogue.update(runs)
        assert set(names(catalogue, runs)) == {"two", "three", "four"}
        assert names(catalogue, runs, outcome="invalid") == ["two"]
        assert names(catalogue, runs, unit="Ü-7") == ["three"]
        (broken,) = catalogue.find(root=root_name(runs), outcome="unreadable")[0]
        assert broken.name == "four" and "manifest.json" in broken.reason


def test_an_unchanged_folder_is_not_read_again(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    make(runs, "one")
    os.utime(runs, ns=(10**18, 10**18))
    with Catalogue(url) as catalogue:
        assert catalogue.update(runs) == 1
        monkeypatch.setattr(
            "bench.record.catalogue._catalogue._written_s", lambda runs: pytest.fail("the folder was read")
        )
        assert catalogue.update(runs) == 0
        assert names(catalogue, runs) == ["one"]


def test_a_rebuilt_catalogue_is_what_the_folders_say(url: str, tmp_path: Path) -> None:
    """A manifest changed by hand is not looked at again until the catalogue is rebuilt."""
    runs = tmp_path / "runs"
    make(runs, "one")
    with Catalogue(url) as catalogue:
        catalogue.update(runs)
        make(runs, "one", units={"x": "SN999"})
        catalogue.update(runs)
        assert names(catalogue, runs, unit="SN999") == []
        assert catalogue.rebuild(runs) == 1
        assert names(catalogue, runs, unit="SN999") == ["one"] and names(catalogue, runs, unit="SN123") == []


def test_two_benches_share_one_catalogue(url: str, tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    make(first, "same-name")
    make(second, "same-name", units={"x": "SN5"})
    with Catalogue(url) as one, Catalogue(url) as two:
        one.update(first)
        two.update(second)
        one.update(second)
        roots = {root_name(first), root_name(second)}
        found = [row for row in one.find(limit=1000)[0] if row.root in roots]
        assert sorted(row.units for row in found) == [("SN123",), ("SN5",)]


@settings(deadline=None, max_examples=200)
@given(st.datetimes(datetime(2000, 1, 1), datetime(2100, 1, 1)), st.sampled_from([4, 7, 10, 16, 19]))
def test_periods_hold_their_own_moments_and_meet(moment: datetime, digits: int) -> None:
    text = moment.isoformat(timespec="seconds")[:digits]
    start_s, end_s = period_s(text)
    at_s = (moment - datetime(1970, 1, 1)).total_seconds()
    assert start_s <= at_s < end_s
    after = datetime(1970, 1, 1) + timedelta(seconds=end_s)
    assert after.isoformat(timespec="seconds")[:digits] > text
    assert period_s(after.isoformat(timespec="seconds")[:digits])[0] == end_s


@pytest.mark.parametrize(
    "text", ["", "yesterday", "2026-13", "2026-02-30", "26-01", "2026-10-05T25:00", "2026-1"]
)
def test_periods_that_are_none(text: str) -> None:
    with pytest.raises(ConfigurationError, match="no date"):
        period_s(text)


@pytest.mark.parametrize(
    ("url", "error"),
    [
        ("nonsense", ConfigurationError),
        ("nosuch://x", ConfigurationError),
        ("sqlite:///", ConfigurationError),
        ("postgresql://u:secret@h/x?nosuch=1", ConfigurationError),
        ("sqlite:////no/such/folder/x.sqlite", RecordError),
        ("postgresql+psycopg://u:secret@/x?host=/no/such/folder", RecordError),
    ],
)
def test_urls_that_cannot_be_used(url: str, error: type[Exception]) -> None:
    with pytest.raises(error) as caught:
        Catalogue(url)
    assert "secret" not in str(caught.value)


def test_a_file_that_is_no_catalogue_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.sqlite"
    path.write_bytes(b"something else" * 100)
    with pytest.raises(RecordError, match="cannot be used"):
        Catalogue(f"sqlite:///{path}")
    assert path.read_bytes() == b"something else" * 100


def test_a_shared_list_says_whose_each_run_is(tmp_path: Path) -> None:
    url, runner = f"sqlite:///{tmp_path / 'shared.sqlite'}", CliRunner()
    for name in ("bench 1", "bench 2"):
        make(tmp_path / name, f"run on {name}", bench={"bench": {"name": name.upper()}})
        asked = ["runs", "list", "--catalogue", url, str(tmp_path / name)]
        shown = runner.invoke(app, asked).output
    assert [line.split("  ")[0] for line in shown.splitlines()] == ["bench", "BENCH 2", "BENCH 1"]
    assert "BENCH" not in runner.invoke(app, ["runs", "list", str(tmp_path / "bench 1")]).output


def test_a_list_loads_nothing_heavy(tmp_path: Path) -> None:
    """Half of the list's 0.3 s would go into any one of these."""
    make(tmp_path / "runs", "one")
    code = f"""
import sys
from bench.present.cli import main
sys.argv = ["gyrobench", "runs", "list", {str(tmp_path / "runs")!r}, "--unit", "SN123", "--limit", "5"]
try:
    main()
finally:
    heavy = {{"pydantic", "numpy", "pyarrow", "rich.console", "sqlalchemy", "bench.record.recording"}}
    assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "completed" in done.stdout, done.stderr


def test_removing_a_run_does_not_read_the_whole_table(tmp_path: Path) -> None:
    with Catalogue(f"sqlite:///{tmp_path / 'x.sqlite'}") as catalogue:
        for table in ("gyrobench_runs", "gyrobench_run_units"):
            plan = catalogue._database.rows(
                f"EXPLAIN QUERY PLAN DELETE FROM {table} WHERE root = :root AND name = :name",
                root="",
                name="",
            )
            assert all("SEARCH" in row[3] for row in plan), plan


def test_what_was_read_before_an_interruption_stays(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    for number in range(6):
        make(runs, f"run-{number}")
    monkeypatch.setattr("bench.record.catalogue._catalogue._AT_ONCE", 2)

    def stop(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with Catalogue(url) as catalogue:
        with pytest.raises(KeyboardInterrupt):
            catalogue.update(runs, stop)
        assert len(names(catalogue, runs)) == 4
        assert catalogue.update(runs) == 2 and len(names(catalogue, runs)) == 6


def test_text_that_no_database_takes(url: str, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    make(runs, "one", units={"x": "a\x00b", "y": "half \ud800"}, reason="\x00")
    with Catalogue(url) as catalogue:
        catalogue.update(runs)
        (row,) = catalogue.find(root=root_name(runs))[0]
        assert row.units == ("a\ufffdb", "half ?") and row.reason == "\ufffd"


@pytest.mark.parametrize(("option", "value"), [("--limit", "0"), ("--limit", "x"), ("--outcome", "done")])
def test_options_that_are_none(tmp_path: Path, option: str, value: str) -> None:
    result = CliRunner().invoke(app, ["runs", "list", str(tmp_path), option, value])
    assert isinstance(result.exception, ConfigurationError) and value in str(result.exception)


def test_the_command(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    make(runs, "cold-1")
    make(runs, "cold-2", started_utc="2026-11-01T00:00:00+02:00", units={"x": "SN5"})
    runner = CliRunner()
    text = runner.invoke(app, ["runs", "list", str(runs)]).output
    assert "cold-1" in text and "cold-2" in text and not (runs / "cold-1" / ".catalogue").exists()
    asked = ["runs", "list", str(runs), "--unit", "SN5", "--since", "2026-10-31", "--json"]
    (row,) = json.loads(runner.invoke(app, asked).output)
    assert row["name"] == "cold-2" and row["units"] == ["SN5"]
    assert "no runs that fit" in runner.invoke(app, [*asked[:-1], "--outcome", "aborted"]).output
    assert (
        "2 manifests read" in runner.invoke(app, ["runs", "index", "--rebuild", "--runs", str(runs)]).output
    )
    assert "no runs in" in runner.invoke(app, ["runs", "list", str(tmp_path / "none")]).output
    shown = runner.invoke(app, ["runs", "list", str(runs), "--limit", "1"]).output
    assert "cold-2" in shown and "newest 1 of 2" in shown and not (tmp_path / "none").exists()


def made_at(runs: Path, name: str, day: int, written_day: float, **changes: object) -> None:
    """A run that started on a day of 2026, and a manifest that was written on another."""
    started = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=day)
    make(runs, name, started_utc=started.isoformat(), **changes)
    stamp = started.timestamp() + 86_400.0 * (written_day - day) if written_day >= 0 else 0.0
    os.utime(runs / name / "manifest.json", (stamp, stamp))


run_that_came = st.tuples(
    st.integers(0, 60),  # day of its start
    st.sampled_from([0.1, 0.1, 3.0, 40.0, -0.5, "lost"]),  # days until its manifest was written, or copied
    st.sampled_from(["SN1", "SN2"]),
    st.sampled_from(["completed", "aborted", "running"]),
)


@given(
    came=st.lists(run_that_came, max_size=25),
    limit=st.integers(1, 6),
    unit=st.sampled_from([None, "SN1", "SN3"]),
    since=st.sampled_from([None, "2026-01-20", "2026-02"]),
    at_once=st.integers(1, 5),
)
@settings(deadline=None, max_examples=60)
def test_a_list_that_reads_no_more_than_it_shows_is_that_of_all_runs(
    came: list[tuple[int, float | str, str, str]],
    limit: int,
    unit: str | None,
    since: str | None,
    at_once: int,
) -> None:
    with tempfile.TemporaryDirectory() as scratch, pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue_module, "_AT_ONCE", at_once)
        runs = Path(scratch) / "runs"
        runs.mkdir()
        for number, (day, later, of, outcome) in enumerate(came):
            written_day = -1.0 if isinstance(later, str) else day + later
            made_at(runs, f"run-{number:02d}", day, written_day, units={"one": of}, outcome=outcome)
        wanted = {"root": root_name(runs), "unit": unit, "since": since}
        with Catalogue(f"sqlite:///{scratch}/all.sqlite") as whole:
            whole.update(runs)
            rows, count = whole.find(limit=limit, **wanted)
        with Catalogue(f"sqlite:///{scratch}/shown.sqlite") as shown:
            for _ in range(2):
                unread = shown.update_for(runs, limit=limit, **wanted)
                found, known = shown.find(limit=limit, **wanted)
                assert found == rows
                assert known <= count <= known + unread
            assert shown.update(runs) >= unread
            assert shown.find(limit=100, **wanted)[1] == count


def test_a_list_leaves_older_manifests_alone_until_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue_module, "_AT_ONCE", 10)
    runs = tmp_path / "runs"
    for day in range(100):
        made_at(runs, f"run-{day:02d}", day, day + 0.2)
    reads: list[int] = []
    rows, count, unread = find_runs(runs, limit=5, progress=lambda read, of: reads.append(read))
    assert [row.name for row in rows] == [f"run-{day:02d}" for day in range(99, 94, -1)]
    assert (reads, count + unread, unread) == ([10], 100, 90)
    result = CliRunner().invoke(app, ["runs", "list", str(runs), "--limit", "5"])
    assert "the newest 5 of 100; --limit shows more" in result.output
    result = CliRunner().invoke(app, ["runs", "list", str(runs), "--limit", "5", "--unit", "SN123"])
    assert "the newest 5 of 30 or more" in result.output and f"runs index --runs {runs}" in result.output
    rows, count, unread = find_runs(runs, limit=200)
    assert (len(rows), count, unread) == (100, 100, 0)


def test_time_stamps_of_a_copy_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue_module, "_AT_ONCE", 10)
    runs = tmp_path / "runs"
    for day in range(100):  # all of them written on one day, before most of them began
        made_at(runs, f"run-{(7 * day) % 100:02d}", day, 3.0)
    rows, count, unread = find_runs(runs, limit=5)
    assert [row.name for row in rows] == [f"run-{(7 * day) % 100:02d}" for day in range(99, 94, -1)]
    assert (count, unread) == (100, 0)


def test_what_has_lost_its_time_stamp_is_read_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An archive wrote zeros for the newest runs; the others' stamps say nothing of that."""
    monkeypatch.setattr(catalogue_module, "_AT_ONCE", 10)
    runs = tmp_path / "runs"
    for day in range(60):
        made_at(runs, f"run-{day:02d}", day, -1.0 if day > 56 else day + 0.2)
    rows, _, unread = find_runs(runs, limit=5)
    assert [row.name for row in rows] == [f"run-{day:02d}" for day in range(59, 54, -1)]
    assert unread == 50


def test_what_a_list_left_unread_is_still_there_when_nothing_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue_module, "_AT_ONCE", 10)
    runs = tmp_path / "runs"
    for day in range(40):
        made_at(runs, f"run-{day:02d}", day, day + 0.2)
    (runs / ".catalogue").mkdir()
    os.utime(runs, ns=(10**18, 10**18))  # long ago: settled
    assert find_runs(runs, limit=5)[2] == 30
    os.utime(runs, ns=(10**18, 10**18))
    assert len(find_runs(runs, limit=40)[0]) == 40
