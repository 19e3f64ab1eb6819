"""The second look when the best set holds a variant that is not among the best of its effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model
from bench.analysis.gap._candidates import candidate_variants
from bench.analysis.gap._fit import solve, weighted_gram
from bench.analysis.gap._prepare import gathered, prepare
from bench.analysis.gap._refine import best_of_each
from bench.analysis.gap._which import judged_sets, second_look
from tests.analysis.gap.conftest import made_run, stimulus


def test_a_member_of_the_best_set_keeps_its_columns_whatever_its_rank(nominal: Model) -> None:
    rng = np.random.default_rng(14)
    s = stimulus(4000)
    runs = [made_run(name, s, rng, 0.5 * (s.warm_k / 50.0) ** 3) for name in "ab"]
    variants = candidate_variants(nominal, runs)
    found = judged_sets(prepare(runs, nominal, variants), nominal, variants)
    kept, candidates = set(best_of_each(found.posterior)), found.posterior.candidates
    dropped = next(k for k, each in enumerate(candidates) if k not in kept and each.effect == "shupe")
    data, columns = found.data, [column + len(nominal.sigmas) for column in candidates[dropped].columns]
    solution = solve(weighted_gram(data.cells, np.ones(len(data.cells))), nominal.sigmas, columns)
    best = replace(found.best, members=frozenset({dropped}), solution=solution)
    few, again = second_look(replace(found, best=best), nominal, variants)
    assert variants[dropped] in few
    # the same solution taken out of the repeats' differences, all columns still in their places
    expected = gathered(data.groups, data.stacks, again.noise, nominal, solution)
    assert again.floor.ratio == pytest.approx(expected.floor.ratio, rel=1e-9)
