"""Effects whose shape is read off the records: each says itself what it sees in the output against input rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.analysis.gap._data import GapRun
from simulators.effects import Effect, SlowRates, Variant

_BLOCK = 20
"""Samples that are averaged, at one rate."""
_STEADY = 1e-3
"""Part of a block's rate by which it may change in the block, or 0.5 deg/h."""


def proposed_variants(effects: Sequence[Effect], runs: Sequence[GapRun]) -> list[Variant]:
    """Return the variants of effects that read their shape off the record, where these runs show them plainly."""
    if all(effect.propose is None for effect in effects):
        return []
    rates = _slow_rates(runs)
    variants: list[Variant] = []
    for effect in effects:
        if effect.propose is not None:
            variants += replace(effect, shapes=tuple(effect.propose(rates))).variants()
    return variants


def _slow_rates(runs: Sequence[GapRun]) -> SlowRates:
    rates, outputs, numbers = [], [], []
    for number, run in enumerate(runs):
        s = run.stimulus
        count = len(s) // _BLOCK
        rate = s.input_rate_dph[: count * _BLOCK].reshape(count, _BLOCK)
        output = run.output_dph[: count * _BLOCK].reshape(count, _BLOCK)
        middle = rate.mean(axis=1)
        steady = np.ptp(rate, axis=1) <= np.maximum(_STEADY * np.abs(middle), 0.5)
        steady &= ~np.isnan(output).any(axis=1)
        rates.append(middle[steady])
        outputs.append(output[steady].mean(axis=1))
        numbers.append(np.full(int(steady.sum()), number))
    records = [(run.stimulus, run.output_dph - run.stimulus.input_rate_dph) for run in runs]
    return SlowRates(np.concatenate(rates), np.concatenate(outputs), np.concatenate(numbers), records)
