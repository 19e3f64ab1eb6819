"""The event log: one line an event, readable after a kill at any byte."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.record.events import read_event
from bench.record.events.run import Basis, Measured, Note, PhaseBegun
from bench.record.recording import EventLog, read_events
from drivers.base.errors import RecordError


def test_every_line_is_on_disk_at_once(tmp_path):
    log = EventLog(tmp_path)
    log.event(1.5, PhaseBegun("shock"))
    log.event(2.0, Measured("a", float("nan"), "degC", np.float64(1.5), None, np.bool_(True)))
    lines = (tmp_path / "events.jsonl").read_text("utf-8").splitlines()
    assert json.loads(lines[0]) == {"time_s": 1.5, "kind": "phase", "phase": "shock"}
    assert json.loads(lines[1]) == {
        "time_s": 2.0, "kind": "measurement", "name": "a", "value": None, "unit": "degC", "low": 1.5,
        "high": None, "passed": True,
    }  # fmt: skip
    log.close()


def test_what_a_measurement_rests_on_is_read_as_it_was_written(tmp_path):
    basis = Basis("air_rate", 12.5, 56.0, 0.1, {"time_base_ppm": -1e-5})
    whole = Measured("shock", 11.7, "K/min", 10.0, None, True, "fog", basis)
    log = EventLog(tmp_path)
    log.event(1.0, whole)
    log.close()
    (row,) = read_events(tmp_path).rows
    assert read_event(row) == (1.0, whole)
    with pytest.raises(ValueError, match="basis"):
        read_event(row | {"basis": {"of": "hearsay"}})


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(0, 400), texts=st.lists(st.text(max_size=12), min_size=1, max_size=8))
def test_a_log_cut_anywhere_reads_up_to_the_cut(tmp_path_factory, cut, texts):
    folder = tmp_path_factory.mktemp("run")
    log = EventLog(folder)
    for number, text in enumerate(texts):
        log.event(float(number), Note(text))
    log.close()
    content = (folder / "events.jsonl").read_bytes()
    (folder / "events.jsonl").write_bytes(content[:cut])
    events = read_events(folder)
    whole = content[:cut].count(b"\n")
    assert [row["text"] for row in events.rows] == texts[:whole]
    assert events.torn.encode("utf-8", "replace")[:1] == content[:cut].rpartition(b"\n")[2][:1]


def test_damage_in_the_middle_is_named_with_its_line(tmp_path):
    (tmp_path / "events.jsonl").write_bytes(
        b'{"time_s":0,"kind":"note"}\n{"tim\n{"time_s":1,"kind":"note"}\n'
    )
    with pytest.raises(RecordError, match=r"events\.jsonl, line 2"):
        read_events(tmp_path)


def test_a_run_without_events_has_none(tmp_path):
    assert read_events(tmp_path).rows == ()
