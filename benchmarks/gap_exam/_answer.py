"""The examined party: reads a case's recordings, diagnoses them and writes down what it found. It opens no
seal.
"""

from __future__ import annotations

import json
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from bench.analysis.gap import (
    Diagnosis,
    Model,
    closed_model,
    diagnose,
    diagnosis_facts,
    read_model,
    read_recordings,
)
from benchmarks.gap_exam._files import held_out_ids, run_keys, write_arrays
from drivers.base.arrays import Array
from drivers.base.errors import BenchError
from drivers.base.files import replace_file


def open_cases(folder: Path) -> list[str]:
    """Return the names of the cases that have no answer yet."""
    names = sorted(path.parent.name for path in (folder / "cases").glob("*/runs.toml"))
    return [name for name in names if not (folder / "answers" / f"{name}.json").exists()]


def answer_all(folder: Path, jobs: int) -> Iterator[tuple[str, float, str]]:
    """Diagnose the cases without an answer; yield name, seconds of processor and verdict as each is done."""
    names = open_cases(folder)
    (folder / "answers").mkdir(exist_ok=True)
    if jobs == 1:
        for name in names:
            yield answer_case(folder, name)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for done in as_completed([pool.submit(answer_case, folder, name) for name in names]):
            yield done.result()


def answer_case(folder: Path, name: str) -> tuple[str, float, str]:
    """Diagnose a case, write answers/NAME.json and, for what closes the gap, NAME.npz."""
    case, target = folder / "cases" / name, folder / "answers" / f"{name}.json"
    held_out = [Path(run_id) for run_id in held_out_ids(case)]
    begin = process_time()
    arrays: dict[str, Array] = {}
    facts: dict[str, Any] = {}
    error = ""
    with threadpool_limits(1):
        try:
            given = read_recordings([case / "runs.toml"], held_out)
            model = read_model(folder / "nominal.toml")
            found = diagnose(given.runs, model, given.held_out, given.missing)
            seconds = process_time() - begin
            facts, arrays = diagnosis_facts(found), _closing(found, model, case, given.shown)
        except BenchError as refusal:
            seconds, error = process_time() - begin, str(refusal)
        except Exception:  # a defect of the examined diagnosis costs the case, not the exam
            seconds, error = process_time() - begin, traceback.format_exc()
    write_arrays(target.with_suffix(".npz"), arrays)
    replace_file(target, json.dumps({"facts": facts, "error": error, "seconds": seconds}))
    return name, seconds, facts.get("verdict", "") or error.strip().splitlines()[-1]


def _closing(found: Diagnosis, nominal: Model, case: Path, held_out: Sequence[Any]) -> dict[str, Array]:
    """Return by held-out run what the closed model adds to the nominal one's rate, deg/h, (n,), as `closed`.

    Beside it the nominal model's columns (q, n), which samples were recorded, and the period in s.
    """
    closed, keys = closed_model(found), run_keys(case)
    arrays: dict[str, Array] = {}
    for run in held_out:
        key, stimulus = keys[run.run_id], run.stimulus
        arrays[f"closed|{key}"] = closed.predict(stimulus) - nominal.predict(stimulus)
        arrays[f"nominal|{key}"] = nominal.columns(stimulus)
        arrays[f"seen|{key}"] = np.isfinite(run.output_dph).astype(np.float64)
        arrays[f"period|{key}"] = np.array([stimulus.period_s])
    return arrays
