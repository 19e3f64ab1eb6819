"""A run on S3 (moto's server) gives what the same run on the disk gives: rate, channels, fits, exports."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.analysis.gap._recordings import load_channels
from bench.analysis.gap._run_folder import load_gap_runs
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.present.cli._app import app
from bench.record.exchange import export_run
from bench.record.recording import Run

MODEL = Path(__file__).parents[2] / "examples" / "nominal" / "fog_cold_shock.toml"


def values(thing):
    """Yield everything in a result, arrays as bytes."""
    if dataclasses.is_dataclass(thing):
        for field in dataclasses.fields(thing):
            yield from values(getattr(thing, field.name))
    elif isinstance(thing, dict):
        yield from values(list(thing.items()))
    elif isinstance(thing, list | tuple):
        for part in thing:
            yield from values(part)
    else:
        yield thing.tobytes() if isinstance(thing, np.ndarray) else thing


@pytest.fixture
def far(short_run, bucket):
    storage, name = bucket
    storage.put(str(short_run), f"{name}/runs/short", recursive=True)
    return f"s3://{name}/runs/short"


@pytest.mark.parametrize("load", [load_gap_runs, load_channels, load_thermal_runs])
def test_what_is_read_of_a_run_is_the_same_from_both(short_run, far, load):
    assert list(values(load(Path(far)))) == list(values(load(short_run)))


def test_both_temperatures_and_every_channel_are_there(far):
    (run,) = load_gap_runs(Path(far))
    assert np.abs(run.stimulus.t_out_c - run.stimulus.t_in_c).max() > 1.0  # the case follows the air first
    channels, missing = load_channels(Path(far))
    assert {series.channel for series in channels} >= {"chamber_air", "case_temperature", "time_stamps"}
    assert all("no record" not in why and "has no" not in why for why in missing.values())


def test_truth_and_arrivals_are_fetched(short_run, far):
    there, here = Run.open(far), Run.open(short_run)
    assert there.truth("fog_1").keys() == here.truth("fog_1").keys() != set()
    assert there.tables == here.tables
    assert there.has_arrivals("fog_1") and not there.has_arrivals("nobody")


def test_a_diagnosis_says_the_same(short_run, far):
    said = [
        CliRunner().invoke(app, ["gap", "diagnose", str(place), "--model", str(MODEL), "--json"])
        for place in (far, short_run)
    ]
    assert [result.exit_code for result in said] == [0, 0], said[0].output
    assert json.loads(said[0].output) == json.loads(said[1].output)


def test_a_run_on_object_storage_is_exported_as_the_one_on_the_disk(short_run, far, tmp_path):
    ours, theirs = (
        export_run(Path(far), "csv", tmp_path / "far"),
        export_run(short_run, "csv", tmp_path / "near"),
    )
    assert [path.name for path in sorted(ours.iterdir())] == [path.name for path in sorted(theirs.iterdir())]
    assert all((theirs / path.name).read_bytes() == path.read_bytes() for path in ours.iterdir())
