"""The plant families by name, and the making of their cases by one or several processes."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from benchmarks.gap_exam._acceptance import ACCEPTANCE
from benchmarks.gap_exam._cylinder import CYLINDER
from benchmarks.gap_exam._depolarised import DEPOLARISED
from benchmarks.gap_exam._exam_plant import EXAM_PLANT, make_exam_case, plan_exam_cases
from benchmarks.gap_exam._floated import FLOATED
from benchmarks.gap_exam._gas_rate import GAS_RATE
from benchmarks.gap_exam._hemispherical import HEMISPHERICAL
from benchmarks.gap_exam._make import Plan, kinds_of, make_case, plan, prepare_folder
from benchmarks.gap_exam._mems import MEMS
from benchmarks.gap_exam._nuclear import NUCLEAR
from benchmarks.gap_exam._recorders import RECORDERS
from benchmarks.gap_exam._resonant_fibre import RESONANT_FIBRE
from benchmarks.gap_exam._ring_laser import RING_LASER
from benchmarks.gap_exam._spring import SPRING
from benchmarks.gap_exam._strapdown import STRAPDOWN
from benchmarks.gap_exam._tuned_rotor import TUNED_ROTOR
from benchmarks.gap_exam._tuning_fork import TUNING_FORK

FAMILIES = {
    family.name: family
    for family in (
        RING_LASER,
        MEMS,
        TUNED_ROTOR,
        HEMISPHERICAL,
        STRAPDOWN,
        FLOATED,
        NUCLEAR,
        TUNING_FORK,
        GAS_RATE,
        CYLINDER,
        DEPOLARISED,
        SPRING,
        RECORDERS,
        RESONANT_FIBRE,
        ACCEPTANCE,
        EXAM_PLANT,
    )
}


def make_cases(name: str, seed: int, cases: int, only: str, folder: Path, jobs: int) -> Iterator[str]:
    """Make the cases of a seed that the folder lacks; yield their names."""
    family = FAMILIES[name]
    prepare_folder(family, folder)
    if family is EXAM_PLANT:
        planned = plan_exam_cases(kinds_of(cases, only), seed)
    else:
        planned = plan(family, seed, cases, only)
    planned = [what for what in planned if not (folder / "sealed" / f"{what.name}.json").exists()]
    if jobs == 1:
        yield from (_made(name, folder, what) for what in planned)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for done in as_completed([pool.submit(_made, name, folder, what) for what in planned]):
            yield done.result()


def _made(name: str, folder: Path, what: Plan) -> str:
    family = FAMILIES[name]
    return make_exam_case(folder, what) if family is EXAM_PLANT else make_case(family, folder, what)
