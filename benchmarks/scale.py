"""What 1,000 benches and a million runs need, from unit costs measured here: `python -m benchmarks.scale`.

Writes the table of docs/scale.md between its marks; two to three minutes. Times are processor time, which other
work hardly moves. The paths are those of `growth` and `end_to_end`; models are fitted on nine emulated
cold shocks of one unit, seven to learn from and two to choose by.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.analysis.thermal import ThermalRun, prepare
from bench.analysis.thermal._registry import model_names, new_model
from benchmarks import growth
from benchmarks._marks import fill
from benchmarks._measure import Cost, Work, all_cpu_s, cost
from benchmarks._sections import stamp
from benchmarks._thermal_runs import cold_shock
from benchmarks.end_to_end import run_once
from benchmarks.panel import server_load

_PAGE = Path(__file__).parents[1] / "docs" / "scale.md"
_RUNS, _BENCHES, _CLUSTER = 1_000_000, 1000, 16
_RUN_S, _RATE_HZ, _GYROS, _FRAME_BYTES = 14_000.0, 100.0, 2, 36
_SAMPLES = _RUN_S * _RATE_HZ
_RUNS_A_UNIT, _RUNS_A_DIAGNOSIS = 9, 16
_SHOCKS = (
    *(
        (-41.0, 11.0),
        (-45.0, 12.0),
        (-50.0, 13.0),
        (-42.0, 15.0),
        (-47.0, 12.0),
        (-43.0, 14.0),
        (-52.0, 11.0),
    ),
    *((-46.0, 12.0), (-44.0, 13.0)),
)
"""Cold temperature, ramp."""


@dataclass(frozen=True)
class Costs:
    """Unit costs: processor seconds unless the name says otherwise."""

    sample: float
    frame: float
    arrival_bytes: float
    table_bytes: float
    indexed_run: float
    opening: float
    models: Mapping[str, float]
    diagnosis: float
    rehearsed_hour: float
    panel_share: float | None


def measured() -> Costs:
    """Measure all, saying what is being done."""
    recorded = 6000 * 10
    sample = _path("recording, samples", 10).cpu_s / recorded
    frames = growth.FRAMES * 10
    decoded = _path("decoding to a table, samples", 10).cpu_s / frames
    arrival_bytes, table_bytes = _sizes()
    indexed = _path("catalogue, runs", 10).cpu_s / 1000
    opening = _path("opening ten minutes of a run", 100).cpu_s
    models = _models()
    diagnosis = _path("gap diagnosis, runs", 4).cpu_s
    print("a rehearsed run, the panel", flush=True)
    hour = _rehearsed_hour()
    return Costs(
        sample, decoded, arrival_bytes, table_bytes, indexed, opening, models, diagnosis, hour, server_load()
    )


def _path(name: str, times: int) -> Cost:
    print(name, flush=True)
    route = next(path for path in growth.PATHS if path.name == name)
    with tempfile.TemporaryDirectory(prefix="gyrobench-scale-") as folder:
        return cost(lambda: route.ready(Path(folder), times))


def _sizes() -> tuple[float, float]:
    """Return bytes an arrival of the index and bytes a sample of the table of a recorded gyro with noise."""
    route = next(path for path in growth.PATHS if path.name == "decoding to a table, samples")
    with tempfile.TemporaryDirectory(prefix="gyrobench-scale-") as scratch:
        folder = Path(scratch)
        route.ready(folder, 10)()
        index = (folder / "raw" / "fog.idx").stat().st_size
        table = (folder / "gyro_fog.parquet").stat().st_size
    return index / (10 * growth.FRAMES / growth.SECOND), table / (10 * growth.FRAMES)


def _models() -> dict[str, float]:
    """Return what each model costs to fit."""
    runs = [prepare(_shock(number, *shock)) for number, shock in enumerate(_SHOCKS, 1)]

    def fitted(name: str) -> Callable[[], Work]:
        model = new_model(name)
        return lambda: lambda: model.fit(runs[:7], runs[7:])

    found = {}
    for name in model_names():
        print(f"model {name}", flush=True)
        found[name] = cost(fitted(name)).cpu_s
    return found


def _shock(number: int, cold_c: float, ramp_k_per_min: float) -> ThermalRun:
    data = cold_shock(cold_c=cold_c, ramp_k_per_min=ramp_k_per_min, soak_min=60.0, run_seed=number)
    return ThermalRun(
        run_id=f"shock {number}",
        unit_id="unit",
        time_s=data.time_s,
        gyro_temp_c=data.t_in_c,
        case_temp_c=data.t_out_c,
        bias_dph=data.bias_dph,
        sf_error_ppm=None,
        reference=data.reference_s,
    )


def _rehearsed_hour() -> float:
    """Return the processor seconds of bench and lab together for an hour of bench time."""
    begin = all_cpu_s()
    timing = run_once()
    return (all_cpu_s() - begin) / (timing.bench_s / 3600.0)


def table(found: Costs) -> str:
    """Return the page's table."""
    models_s, lstm_s = sum(found.models.values()), found.models["lstm"] + found.models["hybrid"]
    units, diagnoses = _RUNS / _RUNS_A_UNIT, _RUNS / _RUNS_A_DIAGNOSIS
    raw, index, tables = (
        _SAMPLES * size / 1e6 for size in (_FRAME_BYTES, found.arrival_bytes, found.table_bytes)
    )
    all_tb = (raw + index + tables) * _GYROS * _RUNS / 1e6
    bench_hours = _RUNS * _RUN_S / 3600.0
    rows = [
        (
            "recording",
            f"{1e6 * found.sample:.2g} us a sample and port",
            f"each bench its own small machine, {100 * found.sample * _RATE_HZ * _GYROS:.2g} % of a processor "
            "for the samples; nothing is shared",
        ),
        (
            "bytes",
            f"a gyro and run: {raw:.0f} MB raw, its index up to {index:.0f} MB (every sample arriving alone), "
            f"its table {tables:.0f} MB",
            f"{_BENCHES * _GYROS * _RATE_HZ * _FRAME_BYTES / 1e6:.1f} MB/s raw from all benches together; "
            f"up to {all_tb:.0f} TB for all runs, on object storage",
        ),
        (
            "decoding",
            f"{1e6 * found.frame:.2g} s for a million frames",
            f"{_SAMPLES * _GYROS * found.frame:.1f} s a run, {_hours(_RUNS * _SAMPLES * _GYROS * found.frame)}",
        ),
        (
            "catalogue",
            f"{1e6 * found.indexed_run:.0f} us to index a run",
            f"{_RUNS * found.indexed_run:.0f} s anew, in one SQLite file or a PostgreSQL server that all benches "
            "write to",
        ),
        ("opening", f"{1e3 * found.opening:.0f} ms for ten minutes of a column of 25 h", "the same"),
        (
            "models of a unit",
            f"{models_s:.0f} s for all {len(found.models)} on nine runs, {lstm_s:.0f} s of it the two networks; "
            f"grey box {found.models['grey_box']:.1f} s",
            f"{units:,.0f} units: {_hours(units * models_s)}, {_cluster(units * models_s)} (`--cluster`)",
        ),
        (
            "gap diagnosis",
            f"{found.diagnosis:.1f} s for {_RUNS_A_DIAGNOSIS} runs",
            f"{diagnoses:,.0f} diagnoses: {_hours(diagnoses * found.diagnosis)}",
        ),
        (
            "rehearsal",
            f"{found.rehearsed_hour:.1f} s for an hour of bench time, bench and lab, one gyro",
            f"{bench_hours:,.0f} h of bench time: {_hours(bench_hours * found.rehearsed_hour)}, "
            f"{_cluster(bench_hours * found.rehearsed_hour)}",
        ),
    ]
    if found.panel_share is not None:
        rows.append(
            ("panel", f"{100.0 * found.panel_share:.1f} % of a processor a bench at 10 Hz", "one a bench")
        )
    head = "| what | processor time of one | 1,000 benches, a million runs |\n|---|---|---|\n"
    return head + "".join(f"| {what} | {one} | {every} |\n" for what, one, every in rows)


def _hours(seconds: float) -> str:
    return f"{seconds / 3600.0:,.0f} h of one processor"


def _cluster(seconds: float) -> str:
    return f"{seconds / 3600.0 / _CLUSTER:,.1f} h on a cluster of {_CLUSTER}"


def main() -> None:
    """Measure, print, and put the table into docs/scale.md."""
    text = table(measured())
    print(text)
    fill(_PAGE, "scale", f"{text}\n{stamp('python -m benchmarks.scale')}\n")


if __name__ == "__main__":
    main()
