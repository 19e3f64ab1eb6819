"""What is faster than a run's means: lines and bands in the rows of a log, up to half their rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._fast_floor import FastFloor, fast_floor
from bench.analysis.gap._fast_lines import (
    HANN_FREEDOM,
    SAME_BINS,
    FastLine,
    FastPool,
    above_means,
    fast_pools,
    lines_of,
    octaves,
)
from bench.analysis.gap._findings import Cause, Finding, Place, Shrinkage
from bench.analysis.gap._model_file import DisturbanceTerm, Model, by_parameter
from bench.analysis.gap._signal import Signal
from bench.analysis.gap._where import by_share
from drivers.base.arrays import Array
from simulators.effects import Disturbance, catalogue

LINE = "vibration_or_mains_line"
_SURE = 0.95
_TOLERATED = 1.35
"""Power over the floor's up to which an octave counts as noise: it is never quite of its form."""
_LEAST_LEFT = 0.1
"""Least part of a line that means over a row leave of it and that is made good."""
_KNOWN = 0.3
"""Part by which a line of the model may have another amplitude and be that line."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FastFinding(Finding[DisturbanceTerm | None]):
    """What was found in the rows above half the means' rate, in deg/h.

    `lines` are what stands out of the surroundings, `floor` the noise of the rows, `pools` the spectra. `notes`:
    what was left out. Verdicts as of the rate; a band without a name leaves "unknown" or "explained in part".
    """

    lines: tuple[FastLine, ...]
    floor: FastFloor
    pools: tuple[FastPool, ...]
    notes: tuple[str, ...] = ()

    @property
    def bands(self) -> tuple[str, ...]:
        """Octaves of its places, slow to fast."""
        return tuple(dict.fromkeys(name for pool in self.pools for name, _ in octaves(pool)))

    @property
    def closing(self) -> tuple[str, ...]:
        """The effect's name, once for all lines."""
        return tuple(dict.fromkeys(super().closing))

    @property
    def rows_hz(self) -> float:
        """Rate of the rows."""
        return 1.0 / self.pools[0].row_s

    @property
    def alias_sentence(self) -> str:
        """What rows cannot tell of a line's frequency."""
        return (
            f"A cause of a line may lie at any multiple of {self.rows_hz:.5g} Hz plus or minus its frequency."
        )


@dataclass(frozen=True, eq=False)
class _Ready:
    pools: tuple[FastPool, ...]
    floor: FastFloor
    known: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]


class FastSignal(Signal[GapRun, _Ready, tuple[FastLine, ...], FastFinding]):
    """The spectrum of rows against the noise that they have; where and how much they swing, and at what."""

    def prepare(self, runs: Sequence[GapRun], model: Model) -> _Ready:
        pools = fast_pools(runs)
        quiet = min(pools, key=lambda pool: float(np.median(pool.density[above_means(pool)])))
        own = above_means(quiet)
        floor = fast_floor(
            quiet.frequency_hz[own],
            quiet.density[own],
            quiet.freedom,
            quiet.row_s,
            model.noise.arw_deg_per_sqrt_h,
        )
        known = [by_parameter(term, term.values) for term in model.disturbances if term.name == LINE]
        lines = tuple((each["frequency_hz"], each["amplitude_dph"]) for each in known)
        return _Ready(pools, floor, lines, tuple(_knocks(runs)))

    def which(self, data: _Ready) -> tuple[FastLine, ...]:
        """Return the lines and bands of all phases that the model does not have."""
        return tuple(line for line in lines_of(data.pools, data.floor) if not _is_known(line, data))

    def finding(self, data: _Ready, sets: tuple[FastLine, ...]) -> FastFinding:
        named = [line for line in sets if not line.broad]
        before, after = _places(data, ()), _places(data, named)
        causes = tuple(_cause(line, data.pools) for line in named)
        bands = [line for line in sets if line.broad]
        unknown = bool(bands) or any(place.clear for place in after)
        verdict = "no gap"
        if unknown:
            verdict = "explained in part" if causes else "unknown"
        elif causes:
            verdict = "explained"
        return FastFinding(
            signal="rate_above_0.5_hz",
            unit="deg/h",
            verdict=verdict,
            causes=causes,
            places=tuple(before),
            left=tuple(after),
            terms=tuple(cause.term for cause in causes if cause.term is not None),
            lines=sets,
            floor=data.floor,
            pools=data.pools,
            notes=data.notes,
        )

    def judged(
        self, finding: FastFinding, data: _Ready, sets: tuple[FastLine, ...], held_out: Sequence[GapRun]
    ) -> FastFinding:
        """Add which part of the lines' power in the held-out runs the lines have as they were found."""
        named = [line for line in sets if not line.broad]
        if not named:
            return finding
        parts, before, after = [], 0.0, 0.0
        for pool in fast_pools(held_out):
            shown = [line for line in named if pool.shows(line.frequency_hz)]
            there = np.array([pool.power(line.frequency_hz, line.width_hz)[0] for line in shown])
            here = np.array([0.5 * line.amplitude_in(pool) ** 2 for line in shown])
            if there.sum() <= 0.0:
                continue
            left = float(np.abs(there - here).sum())
            parts.append(1.0 - left / float(there.sum()))
            before, after = before + float(there.sum()), after + left
        if not parts:
            return finding
        spread = 1.96 * float(np.std(parts, ddof=1)) / math.sqrt(len(parts)) if len(parts) > 1 else math.nan
        share = 1.0 - after / before
        sizes = math.sqrt(before / len(parts)), math.sqrt(after / len(parts))
        return replace(
            finding, held_out=(Shrinkage(share, share - spread, min(share + spread, 1.0), *sizes),)
        )


def _is_known(line: FastLine, data: _Ready) -> bool:
    """Return whether the model has the line: at its frequency, or where rows show that, with its amplitude."""
    for frequency_hz, amplitude_dph in data.known:
        sizes = []
        for pool in data.pools:
            at_hz, seen_dph = _seen(frequency_hz, amplitude_dph, pool)
            near = abs(at_hz - line.frequency_hz) <= SAME_BINS * pool.bin_hz
            if near and pool.name in line.amplitudes_dph:
                sizes.append(line.amplitudes_dph[pool.name] / max(seen_dph, 1e-12))
        if sizes and all(abs(size - 1.0) <= _KNOWN for size in sizes):
            return True
    return False


def _seen(frequency_hz: float, amplitude_dph: float, pool: FastPool) -> tuple[float, float]:
    """Return where rows show a line, in Hz, and how large: they are means over their step."""
    cycles = frequency_hz * pool.row_s
    return abs((cycles + 0.5) % 1.0 - 0.5) / pool.row_s, amplitude_dph * abs(float(np.sinc(cycles)))


def _cause(line: FastLine, pools: Sequence[FastPool]) -> Cause[DisturbanceTerm | None]:
    effect = catalogue()[LINE]
    assert isinstance(effect, Disturbance)
    term = None
    if line.everywhere:
        shown = [own for own in pools if own.shows(line.frequency_hz)]
        pool = max(shown, key=lambda own: own.freedom)
        # rows are means, too: what they leave of the line is made good
        whole = max(abs(float(np.sinc(line.frequency_hz * pool.row_s))), _LEAST_LEFT)
        amplitude = math.sqrt(sum(own**2 for own in line.amplitudes_dph.values()) / len(line.amplitudes_dph))
        sigma = pool.power(line.frequency_hz, 0.0)[1] / amplitude
        values = amplitude / whole, line.frequency_hz
        term = DisturbanceTerm(effect, values, (max(sigma / whole, 1e-3 * values[0]), 0.5 * pool.bin_hz))
    return Cause(LINE, f"{effect.meaning} {line.sentence[0].upper()}{line.sentence[1:]}.", _SURE, term, {})


def _less_lines(data: _Ready, pool: FastPool, named: Sequence[FastLine]) -> Array:
    """Return a pool's density, (m,), without the `named` lines and those of the model."""
    density = pool.without([(line.frequency_hz, line.width_hz) for line in named])
    for frequency_hz, amplitude_dph in data.known:
        at_hz, seen_dph = _seen(frequency_hz, amplitude_dph, pool)
        own = pool.around(at_hz, 0.0)
        excess = np.maximum(density[own] - pool.level[own], 0.0)
        part = min(0.5 * seen_dph**2 / max(float(excess.sum()) * pool.bin_hz, 1e-300), 1.0)
        density[own] -= part * excess
    return density


def _places(data: _Ready, named: Sequence[FastLine]) -> list[Place]:
    """Return phases by octaves: energy over the floor's, what the `named` lines have taken off."""
    found, degrees = [], []
    for pool in data.pools:
        floor = data.floor.density(pool.frequency_hz, pool.row_s)
        density = _less_lines(data, pool, named)
        for name, part in octaves(pool):
            ratio = density[part] / floor[part]
            freedom = pool.freedom * len(ratio) * HANN_FREEDOM
            excess = float((density[part] - floor[part]).sum()) * pool.bin_hz
            found.append(
                Place(pool.profile, pool.part, name, math.sqrt(max(excess, 0.0)), max(excess, 0.0),
                      float(ratio.mean()), 1.0, pool.start_s)
            )  # fmt: skip
            degrees.append((float(ratio.mean()) / _TOLERATED * freedom, freedom))
    return by_share(found, degrees)


def _knocks(runs: Sequence[GapRun]) -> list[str]:
    """Say how many segments were left out of the spectra."""
    counts = [(sum(own.knocked for own in run.fast), sum(own.averages for own in run.fast)) for run in runs]
    return [
        f"{run.run_id}: {out} of {out + rest} stretches are many times as strong as the others: left out of "
        "its spectra"
        for run, (out, rest) in zip(runs, counts, strict=True)
        if out
    ]
