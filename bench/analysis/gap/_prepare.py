"""Runs made ready: transformed, their noise judged, whitened and cut into cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._cells import Cell, group_cells, rescaled
from bench.analysis.gap._data import GapRun, Group, check_runs, group_runs
from bench.analysis.gap._fit import Floor, Solution, floor_from_repeats
from bench.analysis.gap._generic import smooth
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._stack import Stack, stacked
from bench.analysis.gap._stochastic import DATA_SHEET, NoiseVerdict, floor_data, judge_noise, shared_codes
from drivers.base.arrays import Array
from simulators.effects import Variant

_SHEET_SIGMA = 0.5
"""Relative uncertainty of the noise's power by a data sheet alone: a class of gyros, no unit on a bench."""


@dataclass(frozen=True)
class Prepared:
    """Runs as coefficients by group, `stacks` of [data - model, model's columns, variants' columns]."""

    groups: tuple[Group, ...]
    stacks: tuple[Stack, ...]
    noise: NoiseVerdict
    cells: tuple[Cell, ...]
    floor: Floor


def with_unknown_rate(model: Model, runs: Sequence[GapRun]) -> Model:
    """Return the model with an input rate that nobody knows as correlated noise (Gauss-Markov, first order)."""
    worst = max(runs, key=lambda run: run.unknown_dph)
    if not worst.unknown_dph:
        return model
    # steps that last as long have a triangle for their correlation, of as large an area as an exponential of half
    noise = replace(
        model.noise,
        correlated_dph=worst.unknown_dph,
        correlation_time_s=0.5 * worst.unknown_time_s,
        correlation_order=1,
    )
    return replace(model, noise=noise)


def prepare(runs: Sequence[GapRun], model: Model, variants: Sequence[Variant]) -> Prepared:
    """Transform the runs, judge their noise, whiten and cut them into cells on the floor of the repeats."""
    check_runs(runs)
    groups = tuple(group_runs(runs))
    stacks = tuple(stack_of(group, model, variants) for group in groups)
    nominal = [stack.chosen(range(1 + len(model.sigmas))) for stack in stacks]
    groups = tuple(
        replace(group, shared=shared_codes(group, own, model.noise, model.sigmas))
        for group, own in zip(groups, nominal, strict=True)
    )
    spectra, source = floor_data(groups, nominal, model.noise, model.sigmas)
    return gathered(groups, stacks, judge_noise(spectra, model.noise, source), model, None)


def gathered(
    groups: tuple[Group, ...],
    stacks: tuple[Stack, ...],
    noise: NoiseVerdict,
    model: Model,
    solution: Solution | None,
) -> Prepared:
    """Whiten with `noise` and cut into cells; `solution` is taken out of the differences of repeats."""
    cells: list[Cell] = []
    for group, stack in zip(groups, stacks, strict=True):
        cells += group_cells(group, stack, noise.noise)
    floor = floor_from_repeats(cells, model.sigmas, solution)
    if noise.source == DATA_SHEET:
        floor = replace(floor, sigma=np.maximum(floor.sigma, _SHEET_SIGMA))
    return Prepared(groups, stacks, noise, tuple(rescaled(cells, floor.ratio)), floor)


def narrowed(
    data: Prepared, model: Model, variants: Sequence[Variant], kept: Sequence[int], fresh: Sequence[Variant]
) -> tuple[list[Variant], Prepared]:
    """Return the variants `kept` and after them `fresh` ones, and the stacks with their columns."""
    at = list(range(1 + len(model.sigmas)))
    starts = np.cumsum([len(at), *(len(variant.effect.parameters) for variant in variants)])
    for each in kept:
        at += range(int(starts[each]), int(starts[each + 1]))
    stacks = with_columns(data, at, fresh)
    return [*(variants[each] for each in kept), *fresh], replace(data, stacks=tuple(stacks))


def with_columns(data: Prepared, columns: Sequence[int], fresh: Sequence[Variant]) -> list[Stack]:
    """Return some columns of the data's stacks, and after them those of `fresh` variants."""
    if not fresh:
        return [stack.narrowed(columns, stack.full[:, :0]) for stack in data.stacks]
    result = []
    for group, stack in zip(data.groups, data.stacks, strict=True):
        rows = stacked(
            group.flat,
            lambda run: [variant.columns(run.stimulus) for variant in fresh],
            [False] * len(fresh),
            stack.filled_for,
        )
        result.append(stack.narrowed(columns, rows.full))
    return result


def stack_of(group: Group, model: Model, variants: Sequence[Variant]) -> Stack:
    def rows(run: GapRun) -> list[Array]:
        s = run.stimulus
        own = [(run.output_dph - model.predict(s))[None, :], model.columns(s)]
        return own + [variant.columns(s) for variant in variants]

    few = (smooth(variant.effect, group.flat) for variant in variants)
    return stacked(group.flat, rows, [False, False, *few], model.noise)


def noise_beside(data: Prepared, solution: Solution, model: Model) -> NoiseVerdict:
    """Judge the noise again with a solution's effects taken out of the differences of repeats."""
    if data.noise.source == DATA_SHEET:
        return data.noise
    q = len(model.sigmas)
    extra, values = solution.indices[q:], solution.values[q:]
    kept = []
    for stack in data.stacks:
        own = stack.chosen(range(1 + q))
        own[:, 0] -= np.tensordot(stack.chosen(extra), values, axes=(1, 0))
        kept.append(own)
    spectra, source = floor_data(data.groups, kept, model.noise, model.sigmas)
    return judge_noise(spectra, model.noise, source)
