"""How cost grows with the work: `python -m benchmarks growth`.

Every main path with 1, 10 and 100 times the work, each time in a process of its own: processor time and by how
much memory rose at its peak. The exponent is that of the last factor of ten: 1 is in proportion, 2 quadratic.
`python -m benchmarks.growth` also writes the table and the figure into docs/scale.md.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bench.analysis.calibration import Effort, Schedule, Task, search
from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.stepwise import stepwise
from bench.analysis.gap import diagnose
from bench.analysis.gap._exam import make_case, nominal_model
from bench.analysis.thermal import LstmModel, prepare
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.record.catalogue import Catalogue, root_name
from bench.record.recording import Journal, PortJournal, StreamSource, decode_stream, read_table
from benchmarks._marks import fill
from benchmarks._measure import Cost, Row, Work, cost, figure
from benchmarks._sections import stamp
from benchmarks.catalogue import make_runs
from benchmarks.fitting import thermal_run
from benchmarks.recording import day, write
from drivers.kvh import KvhDecoder, encode_frames, rate_dps

TIMES = (1, 10, 100)
_TABLE = "| path | once is | times | processor s | exponent | memory MiB |\n|---|---|---|---|---|---|\n"
_DOCS = Path(__file__).parents[1] / "docs"
FRAMES = 60_000
SECOND = 100


@dataclass(frozen=True)
class Route:
    """A path: its name, what one times the work is, and what makes `times` of it ready in a folder."""

    name: str
    unit: str
    ready: Callable[[Path, int], Work]
    times: tuple[int, ...] = TIMES


def _journal(folder: Path, times: int, ports: bool) -> Work:
    """Record `times` ports for 10 s at 100 Hz, or one for `times` minutes."""
    frame = encode_frames("A", np.zeros((1, 3)), counter=np.zeros(1, np.int64), temp_c=25.0)

    def work() -> None:
        journal = Journal(folder, 1.0)
        gyros = [journal.port(f"gyro_{k}") for k in range(times if ports else 1)]
        for sample in range(1000 if ports else 6000 * times):
            for gyro in gyros:
                gyro.received(frame, 0.01 * sample)
            if sample % SECOND == 0:
                journal.check()
        journal.close()

    return work


def _raw(folder: Path, times: int) -> Work:
    """Decode a gyro's raw bytes into its table."""
    port, rng = PortJournal(folder, "fog"), np.random.default_rng(0)
    for repeat in range(times):
        first = repeat * FRAMES
        counter = (np.arange(FRAMES) + first) % 128  # which a block of 60,000 is no multiple of
        data = encode_frames("A", rng.normal(1e-6, 1e-7, (FRAMES, 3)), counter=counter, temp_c=25.0)
        size = len(data) // FRAMES * SECOND
        for at in range(0, len(data), size):
            port.received(data[at : at + size], 0.01 * (first + (at // size + 1) * SECOND))
        port.flush(False)
    source = StreamSource(
        "gyro",
        "fog",
        lambda: KvhDecoder(nominal_rate_hz=100.0, axes="xyz"),
        lambda columns, rate_hz: {"rate_dps": rate_dps(columns["rot_x"], "delta", "RAD", rate_hz)},
    )
    return lambda: decode_stream(folder, source)


def _opened(folder: Path, times: int) -> Work:
    """Ten minutes of one column out of `times` quarters of an hour."""
    path = folder / "t.parquet"
    write(path, day(90_000 * times))
    return lambda: read_table(path, ["rate_dps"], 100.0, 700.0)


def _features(folder: Path, times: int) -> Work:
    return partial(prepare, thermal_run(3600 * times))


def _allan(folder: Path, times: int) -> Work:
    return partial(allan_deviation, np.random.default_rng(0).standard_normal(100_000 * times), 100.0)


def _stepwise(folder: Path, times: int) -> Work:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((5000, 4 * times))
    y = x[:, :4] @ np.arange(1.0, 5.0) + rng.standard_normal(5000)
    return partial(stepwise, x, y, p_enter=1e-6)


def _ridge(folder: Path, times: int) -> Work:
    runs = [prepare(thermal_run(seed=seed)) for seed in range(times + 1)]
    return lambda: LaggedRidgeModel().fit(runs[:-1], runs[-1:])


def _lstm(folder: Path, times: int) -> Work:
    runs = [prepare(thermal_run(seed=seed)) for seed in range(times + 1)]
    import torch

    torch.set_num_threads(1)
    model = LstmModel(LstmSettings(epochs=2))
    LstmModel(LstmSettings(epochs=1)).fit(runs[:1], [])  # torch loads its parts when they are first used
    return lambda: model.fit(runs[:-1], runs[-1:])


def _search(folder: Path, times: int) -> Work:
    """Beam and annealing `times` as wide."""
    pattern = Schedule("", (), np.eye(3), 60.0)
    effort = Effort(2 * times, 10 * times, 1)
    return lambda: search(Task(), "two-axis-horizontal", 14, pattern, effort=effort)


def _gap(folder: Path, times: int) -> Work:
    """Diagnose 4 `times` runs of a case with two effects."""
    runs = make_case(31, "pair")[1][: 4 * times]
    return lambda: diagnose(runs, nominal_model())


def _catalogue(folder: Path, times: int) -> Work:
    """Index `times` hundred runs and ask once."""
    runs = folder / "runs"
    runs.mkdir()
    make_runs(runs, 100 * times)

    def work() -> None:
        with Catalogue(f"sqlite:///{folder}/runs.sqlite") as catalogue:
            catalogue.rebuild(runs)
            catalogue.find(root=root_name(runs), unit="SN12")

    return work


PATHS = (
    Route("recording, samples", "6,000 samples of a port", partial(_journal, ports=False)),
    Route("recording, gyros", "1 port at 100 Hz for 10 s", partial(_journal, ports=True)),
    Route("decoding to a table, samples", "60,000 frames", _raw),
    Route("opening ten minutes of a run", "90,000 rows", _opened),
    Route("features, samples", "an hour of 1 s means", _features),
    Route("Allan deviation, samples", "100,000 samples", _allan),
    Route("stepwise, candidates", "4 of 5,000 rows", _stepwise),
    Route("lagged ridge, runs", "1 run of 14,000 s", _ridge),
    Route("LSTM, two epochs, runs", "1 run of 14,000 s", _lstm),
    Route("scheme search, candidates", "a beam of 2, 10 steps", _search),
    Route("gap diagnosis, runs", "4 runs of 14,000 s", _gap, (1, 2, 4)),
    Route("catalogue, runs", "100 run folders", _catalogue),
)


def measure(path: Route) -> list[Cost]:
    """Return the cost at each of the path's multiples."""
    found = []
    for times in path.times:
        with tempfile.TemporaryDirectory(prefix="gyrobench-growth-") as folder:
            found.append(cost(partial(path.ready, Path(folder), times)))
    return found


def exponent(times: Sequence[int], values: Sequence[float]) -> float:
    """Return the slope of log(value) on log(times) over the last step."""
    low, high = (max(value, 1e-9) for value in values[-2:])
    return math.log(high / low) / math.log(times[-1] / times[-2])


def rows() -> Iterator[Row]:
    """Yield for every path the seconds at the most work; the ratio is proportional growth over the found one."""
    for path, costs in _measured():
        yield _row(path, costs)


def _measured() -> Iterator[tuple[Route, list[Cost]]]:
    for path in PATHS:
        yield path, measure(path)


def line(path: Route, costs: Sequence[Cost]) -> str:
    """Return a path's line of the table."""
    power = exponent(path.times, [cost.cpu_s for cost in costs])
    seconds = ", ".join(f"{cost.cpu_s:.2g}" for cost in costs)
    memory = ", ".join(f"{cost.memory_mib:.0f}" for cost in costs)
    times = ", ".join(str(time) for time in path.times)
    return f"| {path.name} | {path.unit} | {times} | {seconds} | {power:.2f} | {memory} |"


def _row(path: Route, costs: Sequence[Cost]) -> Row:
    factor = path.times[-1] / path.times[-2]
    ours = costs[-1].cpu_s / max(costs[-2].cpu_s, 1e-9)
    name = f"growth: {path.name}, last {factor:g} times the work"
    return figure(name, ours, factor, "in proportion", "times the time", least=True)


def plot(found: Sequence[tuple[Route, Sequence[Cost]]], file: Path) -> None:
    """Draw time and memory of every path over the multiple of the work, each against proportional growth."""
    import matplotlib.pyplot as plt

    colours = plt.get_cmap("tab20")
    figure, axes = plt.subplots(1, 2, figsize=(11.0, 4.8), layout="constrained")
    for number, (path, costs) in enumerate(found):
        style = {"marker": "o", "markersize": 4, "linewidth": 1.4, "color": colours(number)}
        axes[0].plot(path.times, [cost.cpu_s for cost in costs], label=path.name, **style)
        axes[1].plot(path.times, [max(cost.memory_mib, 0.1) for cost in costs], **style)
    axes[0].plot((1, 100), (2e-4, 2e-2), "k--", linewidth=0.8)
    axes[0].annotate("in proportion", (11, 2.1e-3), rotation=24, fontsize=8, va="top")
    axes[1].plot((1, 100), (0.15, 15.0), "k--", linewidth=0.8)
    axes[0].set_ylabel("processor time, s")
    axes[1].set_ylabel("memory above the start, MiB")
    for axis in axes:
        axis.set(xscale="log", yscale="log", xlabel="times the work")
        axis.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def main() -> None:
    """Measure all, draw the figure and put the table into docs/scale.md."""
    print(_TABLE, end="")
    found = []
    for path, costs in _measured():
        print(line(path, costs), flush=True)
        found.append((path, costs))
    plot(found, _DOCS / "images" / "growth.png")
    table = _TABLE + "".join(f"{line(path, costs)}\n" for path, costs in found)
    fill(_DOCS / "scale.md", "growth", f"{table}\n{stamp('python -m benchmarks.growth')}\n")


if __name__ == "__main__":
    main()
