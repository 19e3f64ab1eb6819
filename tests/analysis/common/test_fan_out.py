"""Work on a real Dask scheduler and two worker processes, one of which dies: results as at home, bit for bit."""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.analysis.calibration import Effort, Noise, Schedule, Site, Task, search
from bench.analysis.common.fan_out import ALONE, FanOut, fan_out
from bench.analysis.thermal import FeatureRun
from bench.analysis.thermal._selection import fit_models
from bench.campaign import load_campaign, rehearse_campaign
from bench.lab.emulated import Plant
from bench.present.cli._app import app
from bench.record.benchfile import load_bench_file
from drivers.base.errors import ConfigurationError, RecordError

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

pytest.importorskip("distributed", reason="no Dask: pip install 'gyrobench[scale]'")
MODELS = ("poly3", "multilinear", "stepwise", "lag_ridge", "lag_ridge_x_temp")
SCHEDULER = ("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
WORKER = ("-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")


def started(stack: ExitStack, *arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", *arguments],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    stack.callback(process.wait)
    stack.callback(process.kill)
    assert process.stderr is not None
    stack.callback(process.stderr.close)
    return process


def line_with(process: subprocess.Popen[str], pattern: str) -> re.Match[str]:
    """Return the first line of a process's log that matches; its pipe is long enough for the rest."""
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(pattern, line):
            return found
    raise AssertionError(f"{process.args} ended without {pattern}")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Two workers, processes of their own."""
    with ExitStack() as stack:
        process = started(stack, *SCHEDULER, "--dashboard-address", "127.0.0.1:0")
        address = line_with(process, r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)")[1]
        workers = [started(stack, *WORKER, address) for _ in range(2)]
        for worker in workers:
            line_with(worker, r"Registered to")
        yield address


def feature_run(seed: int) -> FeatureRun:
    """A bias that follows two temperatures, with noise."""
    from bench.analysis.thermal import ThermalRun, prepare

    rng = np.random.default_rng(seed)
    time = np.arange(1.0, 4001.0)
    case = np.interp(time, [900, 1500, 2500, 3200], [25.0, -20.0 - seed, -20.0 - seed, 25.0])
    inside = np.interp(time - 120.0, time, case)
    bias = 2e-3 * (inside - 25.0) + 1.5 * np.gradient(inside) + 0.02 * rng.normal(size=time.size)
    window = (300.0, 900.0)
    return prepare(
        ThermalRun(f"run-{seed}", "A", time, inside, case, bias, None, window, checksum=f"{seed:064x}")
    )


def test_fits_on_a_cluster_are_those_at_home_bit_for_bit(scheduler: str) -> None:
    train, validation = [feature_run(1), feature_run(2)], [feature_run(3)]
    home = fit_models(train, validation, MODELS)
    with fan_out(cluster=scheduler) as fan:
        assert fan.jobs == 2
        away = fit_models(train, validation, MODELS, fan=fan)
    assert list(away) == list(MODELS)
    for name in MODELS:
        assert pickle.dumps(away[name]) == pickle.dumps(pickle.loads(pickle.dumps(home[name]))), name


def found_by(fan: FanOut) -> tuple[object, ...]:
    result = search(
        Task(site=Site(latitude_deg=45.0), noise=Noise(0.001, 10.0, 1e-3)),
        turns=6,
        table="two-axis-horizontal",
        pattern=Schedule("", (), np.eye(3), 60.0, 10.0),
        effort=Effort(4, 15, 4),
        fan=fan,
    )
    return result.schedule.moves, result.merit.worst.hex(), result.merit.rms.hex(), result.evaluated


def test_a_scheme_search_in_processes_of_this_machine_is_that_of_one(scheduler: str) -> None:
    at_home = found_by(ALONE)
    with fan_out(2) as fan:
        assert found_by(fan) == at_home
    with fan_out(cluster=scheduler) as fan:
        assert found_by(fan) == at_home


def test_a_worker_killed_in_the_middle_costs_nothing_but_its_time(scheduler: str, tmp_path: Path) -> None:
    marker = tmp_path / "killed"
    large = np.random.default_rng(0).normal(size=(300, 300))

    def worked(item: tuple[int, np.ndarray]) -> tuple[int, str]:
        number, matrix = item
        if number == 5 and not marker.exists():
            marker.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        return os.getpid(), float(np.linalg.norm(np.linalg.inv(matrix + number))).hex()

    items = [(number, large) for number in range(12)]
    with fan_out(cluster=scheduler) as fan:
        away = fan.map(worked, items)
    killed = int(marker.read_text())
    assert [value for _, value in away] == [value for _, value in ALONE.map(worked, items)]
    assert killed != os.getpid()
    assert away[5][0] not in (killed, os.getpid())


def test_a_campaign_rehearsed_on_a_cluster_has_the_bytes_of_one_at_home(
    scheduler: str, tmp_path: Path
) -> None:
    """Also the run that a worker, which died, had begun."""
    plan = tmp_path / "plan.toml"
    run = 'name = "t"\nrepeats = 2\nprocedure = "constant-rotation"'
    plan.write_text(
        f'title = "t"\n[[run]]\n{run}\nparameters = {{ turns = 1, rate_dps = 20, rest_s = 10 }}\n'
    )
    bench = Path(__file__).parents[3] / "examples" / "demo.toml"
    begun = tmp_path / "away" / "t-2"
    (begun / "raw").mkdir(parents=True)
    (begun / "raw" / "fog_1.bin").write_bytes(b"begun")
    file = load_bench_file(bench)
    campaign, seen = load_campaign(plan, file), []
    with fan_out(cluster=scheduler) as fan:
        away = rehearse_campaign(
            campaign,
            file,
            Plant(),
            tmp_path / "away",
            fan=fan,
            finished=lambda result: seen.append(result.folder),
        )
    home = rehearse_campaign(campaign, file, Plant(), tmp_path / "home")
    assert list(away) == list(home) == ["t-1", "t-2"]
    assert seen == [tmp_path / "away" / "t-1", tmp_path / "away" / "t-2"]
    for name, result in away.items():
        assert result.outcome == "completed"
        for part in ("raw/*", "*.parquet"):
            own = {path.name: path.read_bytes() for path in result.folder.glob(part)}
            assert own == {path.name: path.read_bytes() for path in home[name].folder.glob(part)}
            assert len(own) >= 4


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_comes_back_as_it_was_raised(jobs: int) -> None:
    def refuse(number: int) -> int:
        raise RecordError("no such run", where=f"item {number}", remedy="look again")

    with (
        fan_out(jobs) as fan,
        pytest.raises(RecordError, match=r"item \d: no such run\. Remedy: look again\."),
    ):
        fan.map(refuse, range(3))


def test_a_local_cluster_is_opened_and_closed(capfd: pytest.CaptureFixture[str]) -> None:
    found = CliRunner().invoke(
        app,
        ["scheme", "search", "4", "--dwell-s", "60", "--cluster", "local", "--jobs", "1"],
        catch_exceptions=False,
    )
    assert found.exit_code == 0, found.output
    assert "Best found" in found.output


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "http://127.0.0.1:1"])
def test_an_address_without_a_scheduler_is_refused(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.analysis.common.fan_out._ANSWER_S", 0.3)
    with pytest.raises(ConfigurationError, match="no Dask scheduler answers"), fan_out(cluster=address):
        pass
