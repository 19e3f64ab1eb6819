"""A run whose lines damage answers goes on, says so, and its record can be rebuilt."""

import json

import pytest

from bench.lab.emulated import Plant
from bench.record.recording import read_manifest
from simulators.faults import Fault


def struck(port, kind, *at_s, **more):
    return Fault(port=port, kind=kind, at_s=at_s, **more)


@pytest.mark.parametrize("port", ["table", "chamber"])
@pytest.mark.parametrize("kind", ["truncate", "drop", "lose", "noise", "flip_command"])
def test_a_damaged_answer_costs_a_repeat_and_not_the_run(bench, fog_file, tmp_path, port, kind):
    fault = struck(port, kind, 20.5, 40.5)
    with bench.lab(fog_file, Plant(seed=11, delivery_s=1.0, fault=(fault,))) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=60.0)
    assert result.outcome == "completed", result.reason
    rows = [json.loads(line) for line in (result.folder / "events.jsonl").read_text().splitlines()]
    told = [row["text"] for row in rows if row["kind"] == "repeat"]
    assert read_manifest(result.folder).repeats == ({port: len(told)} if told else {})
    assert len(told) <= 4 and all("Found" in text for text in told)
    if kind == "lose":
        assert len(told) == 2 and all("nothing" in text for text in told)
    assert bench.problems(result.folder) == []


def test_a_refusal_of_a_command_ends_the_run_with_the_devices_words_and_is_not_told_again(
    bench, fog_file, tmp_path
):
    fault = struck("table", "refuse", 0.2, text="Brake Engaged")
    with bench.lab(fog_file, Plant(seed=11, fault=(fault,))) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=10.0)
    assert result.outcome == "aborted" and "Brake Engaged" in result.reason
