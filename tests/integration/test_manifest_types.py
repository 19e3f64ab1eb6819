"""A manifest or an event log of wrong types: whoever reads the run says so in the house's words, or reads on."""

import dataclasses
import json
from contextlib import suppress
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings
from typer.testing import CliRunner

from bench.analysis.gap._recordings import load_channels
from bench.analysis.gap._run_folder import load_gap_runs
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.control.run_record import gyro_source
from bench.present.cli._app import app
from bench.present.panel._folders import RunsFolder
from bench.present.report._run_content import run_content
from bench.record.recording import Run, StreamReport, read_manifest
from bench.record.recording._free_parts import check_free_parts
from drivers.base.errors import BenchError, RecordError

OTHERS = ("text", "", 7, -1.5, 10**400, None, True, [], ["x"], {}, {"a": 1})


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(StreamReport)])
def test_whatever_is_said_of_a_stream_has_its_type_checked(name):
    parts = {
        "started_utc": "2026-11-22T10:00:00+00:00",
        "bench": {},
        "stream": {"fog_1": {}},
        "measurements": [],
        "parameters": {},
    }
    check_free_parts(parts)
    parts["stream"]["fog_1"][name] = "text"
    with pytest.raises(ValueError, match=name):
        check_free_parts(parts)


def leaves(value, at=()):
    """Yield the paths of everything inside a JSON value."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield (*at, key)
        yield from leaves(part, (*at, key))


def replaced(value, at, new):
    changed = json.loads(json.dumps(value))
    place = changed
    for key in at[:-1]:
        place = place[key]
    place[at[-1]] = new
    return changed


def command(*words: str) -> None:
    raised = CliRunner().invoke(app, list(words)).exception
    if raised is not None and not isinstance(raised, SystemExit):
        raise raised


def everybody(folder: Path):
    """What reads a run, each to be called by itself."""
    yield lambda: command("runs", "show", str(folder))
    yield lambda: command("runs", "list", str(folder.parent))
    yield lambda: command("runs", "recover", str(folder))
    yield lambda: run_content(Run.open(folder))
    yield lambda: load_thermal_runs(folder)
    yield lambda: load_gap_runs(folder)
    yield lambda: load_channels(folder)
    yield lambda: gyro_source(read_manifest(folder), "fog_1")
    yield lambda: RunsFolder(folder.parent).history()


@pytest.fixture(scope="module")
def copy(short_run, tmp_path_factory):
    """The short run: tables and raw bytes by links, manifest and events to be written anew."""
    folder = tmp_path_factory.mktemp("typed") / "run"
    folder.mkdir()
    for path in short_run.iterdir():
        if path.name not in ("manifest.json", "events.jsonl", "live"):
            (folder / path.name).symlink_to(path)
    manifest = json.loads((short_run / "manifest.json").read_text())
    return folder, manifest, (short_run / "events.jsonl").read_text()


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_a_manifest_of_any_types_costs_nobody_a_stack_trace(copy, data):
    folder, manifest, events = copy
    at = data.draw(st.sampled_from(list(leaves(manifest))), label="where")
    new = data.draw(st.sampled_from(OTHERS), label="what")
    (folder / "manifest.json").write_text(json.dumps(replaced(manifest, at, new)))
    (folder / "events.jsonl").write_text(events)
    for reader in everybody(folder):
        with suppress(BenchError):
            reader()


@given(st.data())
@settings(max_examples=25, deadline=None)
def test_an_event_log_of_any_types_costs_nobody_a_stack_trace(copy, data):
    folder, manifest, events = copy
    lines = [json.loads(line) for line in events.splitlines()]
    at = data.draw(st.sampled_from([at for at in leaves(lines) if len(at) > 1]), label="where")
    new = data.draw(st.sampled_from(OTHERS), label="what")
    (folder / "manifest.json").write_text(json.dumps(manifest))
    changed = replaced(lines, at, new)
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in changed))
    for reader in everybody(folder):
        with suppress(BenchError):
            reader()


@pytest.mark.parametrize(
    ("at", "new", "says"),
    [
        (("stream", "fog_1", "frames"), "many", r"stream\.fog_1\.frames"),
        (("stream", "fog_1", "rejected"), {"checksum": "few"}, r"rejected\.checksum"),
        (("stream", "fog_1", "warnings"), 3, "warnings"),
        (("measurements", 0, "value"), "text", r"measurements\.0\.value"),
        (("bench", "bench"), "text", r"bench\.bench"),
        (("bench", "bench", "latitude_deg"), "north", "latitude_deg"),
        (("bench", "gyro"), {}, r"bench\.gyro"),
        (("started_utc",), "yesterday", "isoformat"),
    ],
)
def test_the_error_says_file_and_key(copy, at, new, says):
    folder, manifest, _ = copy
    (folder / "manifest.json").write_text(json.dumps(replaced(manifest, at, new)))
    with pytest.raises(RecordError, match=says) as caught:
        read_manifest(folder)
    assert caught.value.where.endswith("manifest.json") and caught.value.remedy
