"""The metrics endpoint: read back by Prometheus's own parsers, named in the docs, used by the dashboard."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as open_metrics
from prometheus_client.parser import text_string_to_metric_families as plain_text

from bench.campaign.queue import BenchQueue, RunOrder
from bench.present.panel._benches import Benches
from bench.present.panel._desk import Desk
from bench.present.panel._desk_routes import Desks
from bench.present.panel._folders import RunsFolder
from bench.present.panel._frame import Frame
from bench.present.panel._metrics import Metrics
from tests.benches import FOG_BENCH
from tests.present.panel.browser import write_now

ROOT = Path(__file__).parents[3]
RUN = {
    "run_id": "one", "procedure": "soak", "bench": "bench 3",
    "units": {"a": 'A"1\\\n'}, "auxiliary": {"2": "base"},
}  # fmt: skip
GYRO = {
    "rate_dps": 0.25, "latest_dps": 0.3, "temp_c": 31.5, "frames": 1000, "lost": 3,
    "rejected": {"checksum": 2}, "age_s": 0.1,
}  # fmt: skip
NOW = {
    "run": RUN, "campaign": None, "time_s": 60.0, "left_s": 30.0,
    "chamber": {"air_temp_c": -40.5, "set_point_c": -40.0, "auxiliary_c": {"2": -39.0}},
    "table": {"rate_dps": 5.0, "angle_deg": 12.0}, "gyros": {"a": GYRO},
    "readings": {"logger": {"case_c": 20.5}}, "prompts": [{"id": 1, "question": "Ready?"}],
    "alarms": [{"time_s": 5.0, "kind": "alarm", "device": "chamber", "text": "door open", "run": "one"}],
}  # fmt: skip


@pytest.fixture
def metrics(tmp_path: Path) -> Metrics:
    runs, bench_file = tmp_path / "runs", tmp_path / "bench.toml"
    bench_file.write_text(FOG_BENCH)
    folder = RunsFolder(runs)
    benches = Benches(folder)
    queue = BenchQueue(runs, bench_file)
    queue.add(RunOrder(procedure="known-state"), "Ada")
    write_now(runs / "one", "one", **NOW)
    return Metrics(folder, benches, Desks(folder, Frame(folder, benches), [Desk(queue, benches, tmp_path)]))


def scraped(metrics: Metrics, accept: str = "") -> dict[tuple[str, ...], float]:
    """Return what a scraper reads: name and labels -> value."""
    answer = metrics.page(SimpleNamespace(headers={"accept": accept}))
    opened = "openmetrics" in answer.headers["content-type"]
    assert opened == ("openmetrics" in accept)
    found = {}
    for family in (open_metrics if opened else plain_text)(answer.body.decode()):
        for sample in family.samples:
            key = (
                sample.name,
                *(f"{name}={text}" for name, text in sorted(sample.labels.items()) if name != "emulated"),
            )
            assert key not in found
            found[key] = sample.value
    return found


@pytest.mark.parametrize("accept", ["", "application/openmetrics-text; version=1.0.0"])
def test_what_the_session_says_is_what_a_scraper_reads(metrics: Metrics, accept: str) -> None:
    found = scraped(metrics, accept)
    bench, unit = "bench=bench 3", 'unit=A"1\\\n'
    for key, value in {
        ("gyrobench_session_state", bench, "state=running"): 1.0,
        ("gyrobench_session_state", bench, "state=lost"): 0.0,
        ("gyrobench_chamber_air_celsius", bench): -40.5,
        ("gyrobench_chamber_sensor_celsius", bench, "sensor=base"): -39.0,
        ("gyrobench_table_rate_degrees_per_second", bench): 5.0,
        ("gyrobench_gyro_rate_degrees_per_second", bench, "gyro=a", unit): 0.25,
        ("gyrobench_gyro_frames_total", bench, "gyro=a", unit): 1000.0,
        ("gyrobench_gyro_rejected_total", bench, "gyro=a", "reason=checksum", unit): 2.0,
        ("gyrobench_reading", bench, "column=case_c", "instrument=logger"): 20.5,
        ("gyrobench_alarms_unseen", bench): 1.0,
        ("gyrobench_questions_open", bench): 1.0,
        ("gyrobench_run_left_seconds", bench): 30.0,
    }.items():
        assert found[key] == value, key
    assert sum(value for key, value in found.items() if key[0] == "gyrobench_queue_waiting") == 1.0
    assert found["process_resident_memory_bytes",] > 1e7


def test_what_is_stale_or_over_has_no_sample(metrics: Metrics, tmp_path: Path, monkeypatch) -> None:
    seconds = [1000.0]
    monkeypatch.setattr("bench.present.panel._benches.host_seconds", lambda: seconds[0])
    session = tmp_path / "runs" / "one"
    assert ("gyrobench_chamber_air_celsius", "bench=bench 3") in scraped(metrics)

    def next_scrape(**changed) -> dict:
        write_now(session, "one", **(NOW | changed))
        seconds[0] += 20.0
        return scraped(metrics)

    stale = next_scrape(chamber=NOW["chamber"] | {"stale": True}, gyros={"a": GYRO | {"stale": True}})
    names = {key[0] for key in stale}
    assert not names & {
        "gyrobench_chamber_air_celsius",
        "gyrobench_chamber_sensor_celsius",
        "gyrobench_gyro_celsius",
    }
    assert {"gyrobench_table_angle_degrees", "gyrobench_gyro_frames_total"} <= names
    ended = next_scrape(state="ended", outcome="aborted")
    assert ended["gyrobench_session_state", "bench=bench 3", "state=ended"] == 1.0
    assert ended["gyrobench_last_outcome", "bench=bench 3", "outcome=aborted"] == 1.0
    assert not {key[0] for key in ended} & {"gyrobench_table_angle_degrees", "gyrobench_run_info"}
    lost = next_scrape(pid=1 << 22, process_start=1)
    assert lost["gyrobench_session_state", "bench=bench 3", "state=lost"] == 1.0
    unreadable = next_scrape(chamber=5)
    assert unreadable["gyrobench_session_state", "bench=bench 3", "state=unreadable"] == 1.0


def test_a_malformed_session_leaves_the_others_metrics(metrics: Metrics, tmp_path: Path) -> None:
    write_now(tmp_path / "runs" / "ill", "ill", chamber=5)
    write_now(tmp_path / "runs" / "other", "Lot 7", chamber={"air_temp_c": 7.0})
    found = scraped(metrics)
    assert found["gyrobench_chamber_air_celsius", "bench=bench of Lot 7"] == 7.0
    assert found["gyrobench_chamber_air_celsius", "bench=bench 3"] == -40.5
    assert found["gyrobench_session_state", "bench=ill", "state=unreadable"] == 1.0


def test_docs_and_dashboard_name_the_metrics_that_there_are(metrics: Metrics, tmp_path: Path) -> None:
    write_now(tmp_path / "runs" / "two", "two", outcome="completed", state="ended")
    write_now(
        tmp_path / "runs" / "one",
        "one",
        **(NOW | {"campaign": {"number": 1, "count": 2, "bench": "bench 3"}}),
    )
    there = {key[0] for key in scraped(metrics)}
    described = set(
        re.findall(r"^\| `(gyrobench_\w+)`", (ROOT / "docs" / "metrics.md").read_text(), re.MULTILINE)
    )
    assert described == {name for name in there if name.startswith("gyrobench_")}
    dashboard = json.loads((ROOT / "examples" / "grafana_dashboard.json").read_text())
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    asked += [each["query"]["query"] for each in dashboard["templating"]["list"] if each["type"] == "query"]
    used = {name for text in asked for name in re.findall(r"(?:gyrobench|process)_\w+", text)}
    assert used <= there and len(used) > 12
    places = [tuple(panel["gridPos"].values()) for panel in dashboard["panels"]]
    assert len(set(places)) == len(places) and all(x + w <= 24 for x, _, w, _ in places)
