"""A whole blind exam: plants write folders and sealed answers, the diagnosis answers, seals are opened.

Three parties: the plant has the truth, in a process of its own; the examined one is given the content of a case's
folder and the nominal model, and may work on another machine; the examiner prints the
seal's hash, waits for the answer, and then opens the seal.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache, partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.gap._case_folder import write_case
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._exam import Answer, Closed, Sealed, close, examined, make_case, nominal_model
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._model_file import model_text
from bench.analysis.gap._score import Marked
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError

SHARES = {
    "null": 0.25,
    "single": 0.35,
    "pair": 0.13,
    "unknown": 0.14,
    "known and unknown": 0.06,
    "stochastic": 0.07,
}
_WAITING = 8
_KEPT = 32
"""Cases that the plant's process keeps, 15 MB each."""


def case_kinds(cases: int, seed: int) -> list[str]:
    """Return the kinds of an exam's cases in random order, a quarter of them null."""
    kinds = [kind for kind, share in SHARES.items() for _ in range(round(share * cases))]
    kinds = (kinds + ["null"] * cases)[:cases]
    return [kinds[k] for k in np.random.default_rng((seed, 13)).permutation(cases)]


def examine(cases: int, seed: int, folder: Path, fan: FanOut = ALONE) -> Iterator[tuple[str, Marked | None]]:
    """Hold an exam in `folder`; yield (case, None) with its seal's hash when sealed, then (case, marked).

    A case's name is `number hash`. The sealed answers lie in `folder`/sealed, apart from `folder`/cases. Some
    cases are sealed, then diagnosed where `fan` says, from the content of their folder: a worker needs no disk of
    ours.
    """
    nominal = model_text(nominal_model())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "nominal.toml").write_text(nominal, encoding="utf-8")
    with get_context("spawn").Pool(1) as plant:
        kinds = case_kinds(cases, seed)
        for some in _batches(enumerate(kinds), _WAITING * fan.jobs):
            shown = []
            for number, kind in some:
                name = f"case_{number:04d}"
                sealed = plant.apply(_seal, (seed * 100_000 + number, kind, name, str(folder)))
                shown.append(f"{number:4d} {sealed[:16]}")
                yield shown[-1], None
            given = (_content(folder / "cases" / f"case_{number:04d}") for number, _ in some)
            answers = fan.each(partial(_diagnosed, nominal), given)
            for case, (number, kind), (answer, seconds) in zip(shown, some, answers, strict=True):
                yield _opened(case, number, kind, answer, seconds, seed, folder, plant)


def _opened(
    shown: str, number: int, kind: str, answer: Answer, seconds: float, seed: int, folder: Path, plant: Any
) -> tuple[str, Marked]:
    name = f"case_{number:04d}"
    sealed, closed = plant.apply(_judged, (seed * 100_000 + number, kind, name, str(folder), answer))
    if not sealed.sha256.startswith(shown.split()[-1]):
        raise BenchError(f"the sealed answer of {name} is not the one that was announced")
    return shown, Marked.of(sealed, answer, closed, seconds)


def _batches(kinds: Iterable[tuple[int, str]], size: int) -> Iterator[list[tuple[int, str]]]:
    left = iter(kinds)
    while some := list(islice(left, size)):
        yield some


def _content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@lru_cache(maxsize=_KEPT)
def _case(seed: int, kind: str) -> tuple[Sealed, list[GapRun], list[GapRun], list[NDArray[np.float64]]]:
    """In the plant's process: the case, kept from its sealing to its opening."""
    return make_case(seed, kind)


def _seal(seed: int, kind: str, name: str, folder: str) -> str:
    """In the plant's process: write the case's runs and the sealed answer; return the seal's hash."""
    sealed, given, _, _ = _case(seed, kind)
    write_case(Path(folder) / "cases" / name, given)
    apart = Path(folder) / "sealed"
    apart.mkdir(parents=True, exist_ok=True)
    (apart / f"{name}.json").write_text(sealed.text, encoding="utf-8")
    return sealed.sha256


def _diagnosed(nominal: str, given: Mapping[str, bytes]) -> tuple[Answer, float]:
    """In the examined process: what the folder and the nominal model say, and how long that took."""
    started = host_seconds()
    with tempfile.TemporaryDirectory(prefix="gyrobench-case-") as folder:
        for name, content in given.items():
            (Path(folder) / name).write_bytes(content)
        answer = examined(read_mapped_runs(Path(folder) / "runs.toml"), nominal)
    return answer, host_seconds() - started


def _judged(seed: int, kind: str, name: str, folder: str, answer: Answer) -> tuple[Sealed, Closed]:
    """In the plant's process: the sealed answer, checked against its file, and the closing on the sealed runs."""
    sealed, _, kept, clean = _case(seed, kind)
    written = (Path(folder) / "sealed" / f"{name}.json").read_text(encoding="utf-8")
    if hashlib.sha256(written.encode()).hexdigest() != sealed.sha256:
        raise BenchError(f"the sealed answer of {name} was changed after it was sealed")
    return sealed, close(answer, kept, clean)
