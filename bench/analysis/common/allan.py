"""Overlapping Allan deviation of long records: octaves, all averaging times, or those asked for."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError

_BLOCK = 65536
"""Starts worked on at once: a few buffers of 512 KiB stay in a cache, and calls cost little beside."""
_ROW = 16
"""Samples that a matrix product sums up together: in `cumsum` every addition waits for the one before."""
_LOSS = 1e6
"""By how much squares of sums may exceed those of their differences: nine of sixteen digits are left."""
_IN_BLOCKS = 7
"""Octaves, up to 64 samples, that are worked on block by block: what is left of a long record is short then."""
FEW_STARTS = 16
"""Starts an averaging time of a long record's octaves. Neighbouring starts tell almost the same: the value
differs from that of all starts by about a tenth of its own standard error at most."""
LONG_RECORD = 1 << 20
"""Samples beyond which octaves are computed from `FEW_STARTS` starts unless all are asked for."""

Taus = Literal["octave", "all"] | ArrayLike


@dataclass(frozen=True)
class AllanDeviation:
    """Deviation over averaging time, shape (k,) each, in the unit of the input.

    `terms`: how many differences each value is made of. `relative_error`: one-sigma error of the value as a
    fraction of it, 1 / sqrt(2 (n/m - 1)) (IEEE Std 952, annex on the Allan variance). `record_s` is the length of
    the record, `rate_hz` its sample rate.
    """

    tau_s: Array
    deviation: Array
    terms: Array
    relative_error: Array
    record_s: float
    rate_hz: float


def allan_deviation(
    values: Array, rate_hz: float, tau_s: Taus | None = None, *, all_starts: bool | None = None
) -> AllanDeviation:
    """Overlapping Allan deviation of rate samples `values`, shape (n,), equally spaced at `rate_hz`.

    Averaging times: "octave" (the default), "all" (every number of samples), both up to half the record, or those
    of `tau_s` rounded to whole samples (duplicates merged). Differences start at every sample, as NIST SP 1065
    section 5.2.4 has it; octaves of a record longer than `LONG_RECORD` use `FEW_STARTS` starts an averaging time
    unless `all_starts` is set. A level is removed before anything is summed, which keeps the digits of long
    records. RecordError for gaps, ConfigurationError for averaging times outside [1 sample, half the record].
    """
    samples = np.asarray(values, dtype=np.float64)
    count = len(samples)
    if count < 3:
        raise _broken(samples)
    octaves = tau_s is None or (isinstance(tau_s, str) and tau_s == "octave")
    few = count > LONG_RECORD if all_starts is None else not all_starts
    lengths = _averaging_lengths(count, rate_hz, "octave" if tau_s is None else tau_s)
    # threads gain nothing where memory is the limit, and wait for each other at every block of a busy machine
    with _blas().limit(limits=1, user_api="blas") if count > _BLOCK else nullcontext():
        terms = count + 1 - 2 * lengths
        if octaves and few:
            squares, terms = _few_starts(samples, len(lengths))
        elif octaves and count > LONG_RECORD:
            squares = _every_start(samples, lengths)
        else:
            phase = np.concatenate(([0.0], np.cumsum(samples - samples.mean())))
            squares = np.array([_sum_of_squares(phase, int(m)) for m in lengths])
    if not np.isfinite(squares).all():
        raise _broken(samples)
    return AllanDeviation(
        tau_s=lengths / rate_hz,
        deviation=np.sqrt(squares / terms / 2.0) / lengths,
        terms=terms.astype(np.float64),
        relative_error=1.0 / np.sqrt(2.0 * (count / lengths - 1.0)),
        record_s=count / rate_hz,
        rate_hz=rate_hz,
    )


def _broken(samples: Array) -> RecordError:
    return RecordError(
        "an Allan deviation needs an unbroken record",
        found=f"{len(samples)} samples, {int((~np.isfinite(samples)).sum())} missing",
        expected="at least 3 finite samples",
        remedy="take the longest stretch without gaps",
    )


def _averaging_lengths(count: int, rate_hz: float, tau_s: ArrayLike) -> NDArray[np.int64]:
    if isinstance(tau_s, str) and tau_s == "all":
        return np.arange(1, count // 2 + 1)
    if isinstance(tau_s, str) and tau_s == "octave":
        return 1 << np.arange((count // 2).bit_length())
    lengths = np.unique(np.round(np.atleast_1d(np.asarray(tau_s, dtype=np.float64)) * rate_hz))
    if len(lengths) == 0 or lengths[0] < 1 or lengths[-1] > count // 2:
        raise ConfigurationError(
            "an averaging time is outside the record",
            found=f"{np.min(tau_s, initial=np.inf):g}..{np.max(tau_s, initial=-np.inf):g} s",
            expected=f"{1 / rate_hz:g}..{count // 2 / rate_hz:g} s",
            remedy="choose averaging times between one sample and half the record",
        )
    return lengths.astype(np.int64)


@cache
def _blas() -> ThreadpoolController:
    """Return what sets BLAS threads; to look for the libraries takes a millisecond."""
    return ThreadpoolController()


def _sum_of_squares(phase: Array, m: int) -> float:
    """Sum of squares of the second differences of `phase` over `m` samples, in blocks that stay in cache."""
    count = len(phase) - 2 * m
    work = np.empty(min(_BLOCK, count))
    total = 0.0
    for start in range(0, count, _BLOCK):
        size = min(_BLOCK, count - start)
        block = work[:size]
        np.add(phase[start : start + size], phase[start + 2 * m : start + 2 * m + size], out=block)
        block -= phase[start + m : start + m + size]
        block -= phase[start + m : start + m + size]
        total += float(block @ block)
    return total


@np.errstate(invalid="ignore")  # what is not finite is told by who asks
def _every_start(samples: Array, lengths: NDArray[np.int64]) -> Array:
    """Return the sums of squares of all second differences for averaging lengths 1, 2, 4 ...: as `lengths`.

    Let W(i) be the sum of m samples from i, V(i) that of 2m. Since V(i) = W(i+m) + W(i),
    (W(i+m) - W(i))^2 = 2 W(i+m)^2 + 2 W(i)^2 - V(i)^2, and V is the next octave's W: an octave costs one
    difference of the phase and one product. A record that drifts far beside its noise loses digits so; octaves
    that lose too many are computed from their second differences.
    """
    count = len(samples)
    windows = np.append(lengths, 2 * lengths[-1])
    # cut where sums or differences of an octave begin to end in the phase: those of a block count alike
    cuts = np.unique([*range(1, count + 1, _BLOCK), *windows, *(count + 1 - windows), count + 1])
    squares = np.zeros((len(windows), len(cuts) - 1))
    phase = np.zeros(1 + -(-count // _BLOCK) * _BLOCK)
    level, centred, work = samples[:: count // _BLOCK].mean(), np.zeros(_BLOCK), np.empty(_BLOCK)
    for number, (begin, end) in enumerate(pairwise(cuts.tolist())):
        if begin % _BLOCK == 1:
            part = samples[begin - 1 : begin - 1 + _BLOCK]
            np.subtract(part, level, out=centred[: len(part)])
            centred[0] += phase[begin - 1]
            _running_sum(centred, phase[begin : begin + _BLOCK])
        here, sums = phase[begin:end], work[: end - begin]
        for octave, m in enumerate(windows[windows <= begin].tolist()):
            np.subtract(here, phase[begin - m : end - m], out=sums)
            squares[octave, number] = sums @ sums
    first = cuts[:-1] <= count - windows[:, None]
    second = cuts[:-1] >= 2 * windows[:, None]
    added = 2.0 * (squares * first + squares * second).sum(axis=1)[:-1]
    found = added - squares.sum(axis=1)[1:]
    for octave in np.flatnonzero(added > _LOSS * found).tolist():
        found[octave] = _sum_of_squares(phase[: count + 1], int(lengths[octave]))
    return np.asarray(found)


def _running_sum(values: Array, out: Array) -> None:
    """Write the running sum of `values` to `out`, (n,) both, n a multiple of `_ROW`."""
    rows = out.reshape(-1, _ROW)
    np.matmul(values.reshape(-1, _ROW), np.triu(np.ones((_ROW, _ROW))), out=rows)
    rows[1:] += np.cumsum(rows[:-1, -1])[:, None]


def _few_starts(samples: Array, octaves: int) -> tuple[Array, NDArray[np.int64]]:
    """Return the sums of squares and their terms for averaging lengths 1, 2, 4 ...; shape (octaves,) each.

    The sums over 2m samples are made of those over m, so the record is read once. From `FEW_STARTS` samples on
    every octave keeps every other start.
    """
    tally = _Tally(np.zeros(octaves), np.zeros(octaves, dtype=np.int64))
    inside = min(octaves, _IN_BLOCKS)
    rest = []
    size = 2 * _BLOCK
    room = size + (2 << inside)
    centred, work = np.empty(room), np.empty((3, room))
    level = samples[:size].mean()
    for start in range(0, len(samples), size):
        chunk = samples[start : start + room]
        sums = np.subtract(chunk, level, out=centred[: len(chunk)])
        kept = tally.descend(sums, work, range(inside), size)
        rest.append(kept[: size // _stride(1 << inside)].copy())
    if octaves > inside:
        remaining = np.concatenate(rest)
        room = len(remaining)
        tally.descend(remaining, np.empty((3, room)), range(inside, octaves), len(samples))
    return tally.squares, tally.terms


def _stride(m: int) -> int:
    """Return how many samples lie between starts at averaging length `m`."""
    return max(1, m // FEW_STARTS)


@dataclass
class _Tally:
    """Sums of squares and numbers of terms so far, by octave."""

    squares: Array
    terms: NDArray[np.int64]

    def descend(self, sums: Array, work: Array, octaves: range, own: int) -> Array:
        """Add the octaves of one stretch, whose first `own` samples are its starts, and return the last sums.

        `sums` are those over the first octave's length; `work` (3, len(sums)) is scratch.
        """
        for octave in octaves:
            m = 1 << octave
            stride = _stride(m)
            lag, step = m // stride, _stride(2 * m) // stride
            count = min(-(-own // stride), len(sums) - lag)
            if count <= 0:
                return sums[:0]
            difference = np.subtract(sums[lag : lag + count], sums[:count], out=work[2][:count])
            self.squares[octave] += difference @ difference
            self.terms[octave] += count
            early = sums[: len(sums) - lag : step]
            target = work[octave % 2][: len(early)]
            sums = np.add(early, sums[lag::step], out=target)
        return sums
