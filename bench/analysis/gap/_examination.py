"""A whole blind exam: plants write folders and sealed answers, the diagnosis answers, seals are opened.

Three parties: the plant has the truth, in a process of its own; the examined one is given the content of a case's
folder and the nominal model, and may work on another machine; the examiner prints the
seal's hash, waits for the answer, and then opens the seal.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path

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

    A case is shown as `number hash`. The sealed answers lie in `folder`/sealed, apart from `folder`/cases. Some
    cases are sealed, then diagnosed where `fan` says, from the content of their folder: a worker needs no disk of
    ours.
    """
    nominal = model_text(nominal_model())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "nominal.toml").write_text(nominal, encoding="utf-8")
    cases_of = [_Case(number, kind, seed, folder) for number, kind in enumerate(case_kinds(cases, seed))]
    size = _WAITING * fan.jobs
    with get_context("spawn").Pool(1) as plant:
        for some in (cases_of[begin : begin + size] for begin in range(0, cases, size)):
            hashes = []
            for case in some:
                hashes.append(plant.apply(_seal, (case,)))
                yield f"{case.number:4d} {hashes[-1][:16]}", None
            given = ({path.name: path.read_bytes() for path in case.shown.iterdir()} for case in some)
            answers = fan.each(partial(_diagnosed, nominal), given)
            for case, sha256, (answer, seconds) in zip(some, hashes, answers, strict=True):
                sealed, closed = plant.apply(_judged, (case, answer))
                if sealed.sha256 != sha256:
                    raise BenchError(f"the sealed answer of {case.name} is not the one that was announced")
                yield f"{case.number:4d} {sha256[:16]}", Marked.of(sealed, answer, closed, seconds)


@dataclass(frozen=True)
class _Case:
    number: int
    kind: str
    exam_seed: int
    folder: Path

    @property
    def name(self) -> str:
        return f"case_{self.number:04d}"

    @property
    def shown(self) -> Path:
        """Folder of the runs to diagnose."""
        return self.folder / "cases" / self.name

    @property
    def seal(self) -> Path:
        """File of the answer."""
        return self.folder / "sealed" / f"{self.name}.json"


@lru_cache(maxsize=_KEPT)
def _made(case: _Case) -> tuple[Sealed, list[GapRun], list[GapRun], list[NDArray[np.float64]]]:
    """In the plant's process: the case, kept from its sealing to its opening."""
    return make_case(case.exam_seed * 100_000 + case.number, case.kind)


def _seal(case: _Case) -> str:
    """In the plant's process: write the case's runs and the sealed answer; return the seal's hash."""
    sealed, given, _, _ = _made(case)
    write_case(case.shown, given)
    case.seal.parent.mkdir(parents=True, exist_ok=True)
    case.seal.write_text(sealed.text, encoding="utf-8")
    return sealed.sha256


def _diagnosed(nominal: str, given: Mapping[str, bytes]) -> tuple[Answer, float]:
    """In the examined process: what the folder and the nominal model say, and how long that took."""
    started = host_seconds()
    with tempfile.TemporaryDirectory(prefix="gyrobench-case-") as folder:
        for name, content in given.items():
            (Path(folder) / name).write_bytes(content)
        answer = examined(read_mapped_runs(Path(folder) / "runs.toml"), nominal)
    return answer, host_seconds() - started


def _judged(case: _Case, answer: Answer) -> tuple[Sealed, Closed]:
    """In the plant's process: the sealed answer, checked against its file, and the closing on the sealed runs."""
    sealed, _, kept, clean = _made(case)
    if hashlib.sha256(case.seal.read_bytes()).hexdigest() != sealed.sha256:
        raise BenchError(f"the sealed answer of {case.name} was changed after it was sealed")
    return sealed, close(answer, kept, clean)
