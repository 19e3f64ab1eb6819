"""A whole blind exam: plants write folders and sealed answers, processes of their own diagnose, seals are opened.

Three parties, three processes: the plant has the truth; the examined one is given the path of a case's folder and
of the nominal model; the examiner prints the seal's hash, waits for the answer, and then opens the seal.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from bench.gap._case_folder import write_case
from bench.gap._exam import Answer, Closed, Sealed, close, examined, make_case, nominal_model
from bench.gap._import import read_mapped_runs
from bench.gap._model_file import model_text
from bench.gap._score import Marked
from drivers.clock import host_seconds
from drivers.errors import BenchError

SHARES = {
    "null": 0.25,
    "single": 0.35,
    "pair": 0.13,
    "unknown": 0.14,
    "known and unknown": 0.06,
    "stochastic": 0.07,
}
_WAITING = 4


def case_kinds(cases: int, seed: int) -> list[str]:
    """Return the kinds of an exam's cases in random order, a quarter of them null."""
    kinds = [kind for kind, share in SHARES.items() for _ in range(round(share * cases))]
    kinds = (kinds + ["null"] * cases)[:cases]
    return [kinds[k] for k in np.random.default_rng((seed, 13)).permutation(cases)]


def examine(cases: int, seed: int, folder: Path, *, jobs: int = 1) -> Iterator[tuple[str, Marked | None]]:
    """Hold an exam in `folder`; yield (case, None) with its seal's hash when sealed, then (case, marked).

    A case's name is `number hash`. The sealed answers lie in `folder`/sealed, apart from `folder`/cases.
    """
    nominal = folder / "nominal.toml"
    nominal.parent.mkdir(parents=True, exist_ok=True)
    nominal.write_text(model_text(nominal_model()), encoding="utf-8")
    context = get_context("spawn")
    with context.Pool(1) as plant, context.Pool(jobs) as diagnosis:
        kinds = case_kinds(cases, seed)
        waiting: list[tuple[str, int, Any]] = []
        for number, kind in enumerate(kinds):
            name = f"case_{number:04d}"
            sealed = plant.apply(_seal, (seed * 100_000 + number, kind, name, str(folder)))
            shown = f"{number:4d} {sealed[:16]}"
            yield shown, None
            given = str(folder / "cases" / name)
            waiting.append((shown, number, diagnosis.apply_async(_diagnosed, (given, str(nominal)))))
            if len(waiting) >= _WAITING * jobs:
                yield _opened(waiting.pop(0), kinds, seed, folder, plant)
        for each in waiting:
            yield _opened(each, kinds, seed, folder, plant)


def _opened(
    entry: tuple[str, int, Any], kinds: Sequence[str], seed: int, folder: Path, plant: Any
) -> tuple[str, Marked]:
    shown, number, pending = entry
    answer, seconds = pending.get()
    name = f"case_{number:04d}"
    own = seed * 100_000 + number
    sealed, closed = plant.apply(_judged, (own, kinds[number], name, str(folder), answer))
    if not sealed.sha256.startswith(shown.split()[-1]):
        raise BenchError(f"the sealed answer of {name} is not the one that was announced")
    return shown, Marked(sealed, answer, closed, seconds)


def _seal(seed: int, kind: str, name: str, folder: str) -> str:
    """In the plant's process: write the case's runs and the sealed answer; return the seal's hash."""
    sealed, given, _, _ = make_case(seed, kind)
    write_case(Path(folder) / "cases" / name, given)
    apart = Path(folder) / "sealed"
    apart.mkdir(parents=True, exist_ok=True)
    (apart / f"{name}.json").write_text(sealed.text, encoding="utf-8")
    return sealed.sha256


def _diagnosed(given: str, nominal: str) -> tuple[Answer, float]:
    """In the examined process: what the folder and the nominal model say, and how long that took."""
    started = host_seconds()
    runs = read_mapped_runs(Path(given) / "runs.toml")
    answer = examined(runs, Path(nominal).read_text(encoding="utf-8"))
    return answer, host_seconds() - started


def _judged(seed: int, kind: str, name: str, folder: str, answer: Answer) -> tuple[Sealed, Closed]:
    """In the plant's process: the sealed answer, checked against its file, and the closing on the sealed runs."""
    sealed, _, kept, clean = make_case(seed, kind)
    written = (Path(folder) / "sealed" / f"{name}.json").read_text(encoding="utf-8")
    if hashlib.sha256(written.encode()).hexdigest() != sealed.sha256:
        raise BenchError(f"the sealed answer of {name} was changed after it was sealed")
    return sealed, close(answer, kept, clean)
