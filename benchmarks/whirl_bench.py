"""Whirl through the emulated bench: `constant-rotation` on a lab of its own process, judged on another run.

Run as `python -m benchmarks whirl_bench`. Table and gyro are real bytes; plant files give the bearing. What is
locked to the rotation angle is compared before and after compensation on a run of another seed, beside a run of
the same seed in a perfect bearing (its floor). The yardstick is the patent's second-order integral fit on the
same runs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.analysis.whirl import load_turns, study_whirl
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_from
from bench.record.recording import Run
from benchmarks._measure import Row, figure
from procedures.constant_rotation import PROCEDURE

BENCH = {
    "bench": {"name": "ins bench", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/dev/table"},
    "chamber": {"driver": "weiss", "port": "/dev/chamber"},
    "gyro": [
        {
            "name": "ins",
            "driver": "kvh1750",
            "unit": "INS-001",
            "axis": "z",
            "axes": "xyz",
            "port": "/dev/gyro",
            "rate_hz": 100.0,
        }
    ],
}
_PATENT = ((-1.0, 5.0, -3.0), (2.0, -9.0, 8.0), (3.0, 4.0, 4.4))
_FULL = (*_PATENT, (1.0, 3.0, 2.0), (-2.0, 0.9, -0.6))
_RIPPLE = {"ripple_once_ppm": 5e4}


@dataclass(frozen=True)
class Case:
    """Bearing lines, table and parameters of the run."""

    name: str
    lines: tuple[tuple[float, float, float], ...]
    play: tuple[float, float] = (0.0, 0.0)
    rotation: Mapping[str, float] | None = None
    reversals: int = 0


CASES = (
    Case("patent's class", _PATENT),
    Case("with constant tilt and line -2", _FULL),
    Case("5 % rate ripple", _FULL, rotation=_RIPPLE),
    Case("reversals", _FULL, reversals=14),
    Case("reversals, play of 5 arcsec, 5 % ripple", _FULL, (5.0, 0.0), _RIPPLE, 14),
)


def record(folder: Path, case: Case, seed: int, *, perfect: bool = False) -> Run:
    """Run the procedure on a lab of its own."""
    bearing = {"lines_arcsec": () if perfect else case.lines, "play_arcsec": (0, 0) if perfect else case.play}
    plant = Plant.model_validate(
        {
            "seed": seed,
            "models": {"INS-001": "ins_triad"},
            "rotation": case.rotation or {},
            "bearing": {"INS-001": bearing},
        }
    )
    tolerance = 6.0 if case.rotation else 0.1
    values = {"turns": 60.0, "reversals": case.reversals, "rate_tolerance_percent": tolerance}
    with EmulatedLab(bench_file_from(BENCH), plant) as lab:
        result = run_procedure(
            RunRequest(
                PROCEDURE,
                PROCEDURE.parse(values),
                lab.file,
                folder,
                EmulatedOperator(lab.perform),
                run_id=f"{case.name.replace(' ', '-').replace('%', 'pc')}-{seed}{'-perfect' * perfect}",
                emulated={"seed": seed, "model": "ins_triad"},
            )
        )
    if result.outcome != "completed":
        raise RuntimeError(result.reason)
    return Run.open(result.folder)


def outcome(folder: Path, case: Case) -> dict[str, float]:
    """Return what is locked to the angle, arcsec rms an axis: before, after, after the patent's fit, floor."""
    fitted, judged = (load_turns(record(folder, case, seed)) for seed in (1, 2))
    twin = load_turns(record(folder, case, 2, perfect=True))
    row = study_whirl([fitted], [judged], gauge="mean", checksums={}).judgements[0]
    floor = study_whirl([fitted], [twin], gauge="mean", checksums={}).judgements[0]
    patent = float("nan") if row.patent is None else row.patent.locked_arcsec
    return {
        "before": row.before.locked_arcsec,
        "after": row.after.locked_arcsec,
        "patent": patent,
        "floor": floor.before.locked_arcsec,
    }


def rows() -> list[Row]:
    """Return a row a case."""
    table = []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            found = outcome(Path(folder), case)
            ours, patent = found["before"] / found["after"], found["before"] / found["patent"]
            floor = f"floor {found['before'] / found['floor']:.0f}"
            name = f"the patent's second-order fit ({floor})"
            table.append(figure(f"whirl through the bench, {case.name}", ours, patent, name, "times less"))
    return table
