"""Runs made ready: transformed, their noise judged, whitened and cut into cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.gap._cells import Cell, group_cells, mixed_whitened, rescaled, transformed
from bench.gap._data import GapRun, Group, check_runs, group_runs
from bench.gap._fit import Floor, Solution, floor_from_repeats
from bench.gap._model_file import Model
from bench.gap._stochastic import NoiseVerdict, floor_data, judge_noise
from simulators.effects import Variant


@dataclass(frozen=True)
class Prepared:
    """Runs as coefficients by group, `stacks` (runs, 1 + p, n - 1) of [data - model, model's, variants']."""

    groups: tuple[Group, ...]
    stacks: tuple[NDArray[np.float32], ...]
    noise: NoiseVerdict
    cells: tuple[Cell, ...]
    floor: Floor


def prepare(runs: Sequence[GapRun], model: Model, variants: Sequence[Variant]) -> Prepared:
    """Transform the runs, judge their noise, whiten and cut them into cells on the floor of the repeats."""
    check_runs(runs)
    groups = tuple(group_runs(runs))
    stacks = tuple(_stack(group, model, variants) for group in groups)
    own = 1 + len(model.sigmas)
    spectra, source = floor_data(groups, [stack[:, :own] for stack in stacks], model.noise, model.sigmas)
    return gathered(groups, stacks, judge_noise(spectra, model.noise, source), model, None)


def gathered(
    groups: tuple[Group, ...],
    stacks: tuple[NDArray[np.float32], ...],
    noise: NoiseVerdict,
    model: Model,
    solution: Solution | None,
) -> Prepared:
    """Whiten with `noise` and cut into cells; `solution` is taken out of the differences of repeats."""
    cells: list[Cell] = []
    for group, stack in zip(groups, stacks, strict=True):
        cells += group_cells(group, mixed_whitened(group, stack, noise.noise), noise.noise)
    floor = floor_from_repeats(cells, model.sigmas, solution)
    return Prepared(groups, stacks, noise, tuple(rescaled(cells, floor.ratio)), floor)


def narrowed(
    data: Prepared, model: Model, variants: Sequence[Variant], kept: Sequence[int], fresh: Sequence[Variant]
) -> tuple[list[Variant], Prepared]:
    """Return the variants `kept` and after them `fresh` ones, and the stacks with their columns."""
    at = list(range(1 + len(model.sigmas)))
    starts = np.cumsum([len(at), *(len(variant.effect.parameters) for variant in variants)])
    for each in kept:
        at += range(int(starts[each]), int(starts[each + 1]))
    stacks = []
    for group, stack in zip(data.groups, data.stacks, strict=True):
        runs = [run for each in group.runs for run in each]
        parts = [stack[:, at]]
        if fresh:
            rows = [np.concatenate([each.columns(run.stimulus) for each in fresh]) for run in runs]
            parts.append(
                np.stack(
                    [transformed(run, own).astype(np.float32) for run, own in zip(runs, rows, strict=True)]
                )
            )
        stacks.append(np.concatenate(parts, axis=1))
    return [*(variants[each] for each in kept), *fresh], replace(data, stacks=tuple(stacks))


def _stack(group: Group, model: Model, variants: Sequence[Variant]) -> NDArray[np.float32]:
    stacked = []
    for run in (run for each in group.runs for run in each):
        s = run.stimulus
        rows = [(run.output_dph - model.predict(s))[None, :], model.columns(s)]
        rows += [variant.columns(s) for variant in variants]
        stacked.append(transformed(run, np.concatenate(rows)).astype(np.float32))
    return np.stack(stacked)


def noise_beside(data: Prepared, solution: Solution, model: Model) -> NoiseVerdict:
    """Judge the noise again with a solution's effects taken out of the differences of repeats."""
    if data.noise.source == "data sheet":
        return data.noise
    q = len(model.sigmas)
    extra, values = solution.indices[q:], solution.values[q:]
    kept = []
    for stack in data.stacks:
        own = stack[:, : 1 + q].astype(np.float64)
        own[:, 0] -= np.tensordot(stack[:, extra].astype(np.float64), values, axes=(1, 0))
        kept.append(own)
    spectra, source = floor_data(data.groups, kept, model.noise, model.sigmas)
    return judge_noise(spectra, model.noise, source)
