"""Plans of bluesky, as they come with it, drive an emulated bench within its lease and limits."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bluesky import RunEngine, plan_stubs, plans
from bluesky.utils import FailedStatus

from bench.control.lease import take_lease
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from bench.record.recording import Run
from drivers.base.errors import BenchInUse, LimitExceeded
from gyrobench.bluesky import BenchDevices

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
pytestmark = [
    pytest.mark.concurrent,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


@pytest.fixture
def engine() -> Iterator[RunEngine]:
    loop = asyncio.new_event_loop()
    engine = RunEngine({}, loop=loop, context_managers=[])
    yield engine
    loop.call_soon_threadsafe(loop.stop)
    engine._th.join()
    loop.close()


def rows(documents: list[tuple[str, Any]]) -> list[dict[str, float]]:
    return [document["data"] for name, document in documents if name == "event"]


def test_scans_of_table_and_chamber_are_read_back_and_recorded(engine: RunEngine, tmp_path: Path) -> None:
    documents: list[tuple[str, Any]] = []
    engine.subscribe(lambda name, document: documents.append((name, document)))
    with BenchDevices(DEMO, emulated=True, runs=tmp_path, ramp_k_per_min=10.0) as bench:
        table, chamber = bench.table, bench.chamber
        engine(plans.list_scan([chamber.air_temp_c], table.rate_dps, [5.0, -5.0, 0.0]))
        engine(plans.list_scan([], table.angle_deg, [90.0, 300.0]))
        engine(plan_stubs.mv(chamber.air_temp_c, 30.0, table.angle_deg, 45.0))
        engine(plans.count([chamber.air_temp_c, table.angle_deg, bench.time_s]))
        before_s = rows(documents)[-1]["time_s"]
        engine(plan_stubs.mv(bench.time_s, before_s + 60.0))
        engine(plans.count([bench.time_s]))
    found = rows(documents)
    assert [row["table_rate_dps"] for row in found[:3]] == pytest.approx([5.0, -5.0, 0.0], abs=0.01)
    assert [row["table_angle_deg"] for row in found[3:5]] == pytest.approx([90.0, 300.0], abs=0.01)
    assert found[5]["chamber_air_temp_c"] == pytest.approx(30.0, abs=0.5)
    assert found[5]["table_angle_deg"] == pytest.approx(45.0, abs=0.01)
    assert 60.0 <= found[6]["time_s"] - before_s < 61.0
    described = next(document for name, document in documents if name == "descriptor")
    assert described["data_keys"]["table_rate_dps"]["units"] == "deg/s"
    assert bench.result is not None and bench.result.outcome == "completed"
    run = Run.open(bench.result.folder)
    assert run.manifest.procedure == "bluesky"
    assert (abs(run.turntable()["rate_dps"] + 5.0) < 0.01).sum() >= 3
    assert all(state.confirmed for state in bench.result.safe)


def test_what_the_limits_forbid_is_not_sent_and_fails_the_plan(engine: RunEngine, tmp_path: Path) -> None:
    with BenchDevices(DEMO, emulated=True, runs=tmp_path, max_rate_dps=10.0) as bench:
        with pytest.raises(FailedStatus) as failed:
            engine(plan_stubs.mv(bench.table.rate_dps, 12.0))
        assert isinstance(failed.value.args[0].exception(), LimitExceeded)
        engine(plan_stubs.mv(bench.table.rate_dps, 8.0))
    assert bench.result is not None and bench.result.outcome == "completed"
    assert Run.open(bench.result.folder).turntable()["rate_dps"].max() == pytest.approx(8.0, abs=0.01)


def test_a_bench_that_somebody_has_is_not_opened(tmp_path: Path) -> None:
    with (
        EmulatedLab(load_bench_file(DEMO), Plant()) as lab,
        take_lease(lab.file, "run of somebody"),
        pytest.raises(BenchInUse),
        BenchDevices(lab.file, runs=tmp_path),
    ):
        pass
