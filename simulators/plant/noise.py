"""Reproducible noise: counter-based generators in blocks, flicker as a sum of Markov processes, quantisation.

Every number is a function of (seed, owner, stream, index) and not of how calls are cut, since Philox is started
anew for each block of 4096 with the block's index in its counter.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.base.arrays import Array

BLOCK = 4096
_STEPS = 32
FLICKER_TIMES_S = tuple(3.0**power for power in range(9))
"""Correlation times of the flicker's nine processes, 1 s to 1.8 h, a factor of 3 apart."""


@dataclass(frozen=True)
class NoiseParameters:
    """Angle random walk N, bias instability B (flicker; ADEV floor 0.664 B), angle quantum."""

    arw_deg_per_sqrt_h: float
    bias_instability_dph: float
    quantum_arcsec: float


@dataclass(frozen=True)
class NoiseSource:
    """Names an independent family of random streams: run seed, owner (a unit's name), stream number."""

    seed: int
    owner: str
    stream: int = 0

    def generator(self, block: int) -> np.random.Generator:
        """Return the generator of one block of this stream."""
        key = np.array([self.seed & 0xFFFFFFFFFFFFFFFF, zlib.crc32(self.owner.encode())], dtype=np.uint64)
        counter = np.array([0, block, self.stream, 0], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=key, counter=counter))

    def substream(self, stream: int) -> NoiseSource:
        """Return the source with the same seed and owner and another stream number."""
        return NoiseSource(self.seed, self.owner, stream)

    def uniform(self, number: int) -> Callable[[int, int], Array]:
        """Return what gives numbers of [-0.5, 0.5) by start and count: `number` streams behind this one."""
        return SampleNoise(self.substream(self.stream + number), "uniform").values


class SampleNoise:
    """White noise by sample index: standard normal, or uniform on [-0.5, 0.5)."""

    def __init__(self, source: NoiseSource, kind: Literal["normal", "uniform"]) -> None:
        self._source = source
        self._kind = kind
        self._blocks: dict[int, Array] = {}

    def values(self, start: int, count: int) -> Array:
        """Return samples `start` ... `start + count - 1`, float64 (count,); do not write to the result."""
        first, offset = divmod(start, BLOCK)
        if offset + count <= BLOCK:
            return self._block(first)[offset : offset + count]
        last = (start + count - 1) // BLOCK
        joined = np.concatenate([self._block(block) for block in range(first, last + 1)])
        return joined[offset : offset + count]

    def _block(self, block: int) -> Array:
        found = self._blocks.get(block)
        if found is None:
            rng = self._source.generator(block)
            found = rng.standard_normal(BLOCK) if self._kind == "normal" else rng.random(BLOCK) - 0.5
            self._blocks = {key: kept for key, kept in self._blocks.items() if key >= block - 1}
            self._blocks[block] = found
        return found


class TickNoise:
    """Sum of first-order Markov processes of equal sigma at 1 s ticks, stationary from tick 0."""

    def __init__(self, source: NoiseSource, times_s: Sequence[float], sigma: float) -> None:
        self._source = source
        self._decay = [math.exp(-1.0 / time_s) for time_s in times_s]
        self._sigma = sigma
        self._state = [0.0] * len(self._decay)
        self._block = -1
        self._values: list[float] = []

    def value(self, tick: int) -> float:
        """Return the process at `tick`; ticks do not go back to an earlier block."""
        while tick >= (self._block + 1) * BLOCK:
            self._next_block()
        return self._values[tick % BLOCK]

    def _next_block(self) -> None:
        self._block += 1
        normals = self._source.generator(self._block).standard_normal((len(self._decay), BLOCK))
        total = np.zeros(BLOCK)
        for index, decay in enumerate(self._decay):
            drive = math.sqrt(1.0 - decay * decay)
            if self._block == 0:
                # stationary start: the first value has the process's own variance
                normals[index, 0] /= drive
            driven = drive * normals[index]
            driven[0] += decay * self._state[index]
            path = follow(driven, decay)
            self._state[index] = float(path[-1])
            total += path
        self._values = (total * self._sigma).tolist()


def flicker(source: NoiseSource, bias_instability_dph: float) -> TickNoise:
    """Return flicker noise in deg/h of coefficient B (IEEE Std 952): nine Markov processes.

    Processes of variance sigma^2 with correlation times a factor r apart sum, between their corner
    frequencies, to the one-sided density sigma^2 / (f ln r); flicker's is B^2 / (pi f), so
    sigma = B sqrt(ln r / pi).
    """
    return TickNoise(source, FLICKER_TIMES_S, bias_instability_dph * math.sqrt(math.log(3.0) / math.pi))


class GyroNoise:
    """What one gyro axis adds to its angle increments: white noise (ARW) and the quantisation of its angle."""

    def __init__(self, source: NoiseSource, parameters: NoiseParameters) -> None:
        self._white = SampleNoise(source, "normal")
        self._quantised = SampleNoise(source.substream(source.stream + 1), "uniform")
        self._white_rad_per_sqrt_s = math.radians(parameters.arw_deg_per_sqrt_h) / 60.0
        self._quantum_rad = math.radians(parameters.quantum_arcsec / 3600.0)

    def increments_rad(self, start: int, count: int, period_s: float) -> Array:
        """Return the noise of samples `start` ... in rad, float64 (count,).

        Quantising an accumulated angle adds the difference of successive rounding errors, each uniform over one
        quantum (IEEE Std 952, quantisation noise).
        """
        white = self._white.values(start, count) * (self._white_rad_per_sqrt_s * math.sqrt(period_s))
        error = self._quantised.values(start, count + 1)
        return np.asarray(white + (error[1:] - error[:-1]) * self._quantum_rad)


def follow(driven: Array, decay: float) -> Array:
    """Return x with x[k] = decay x[k-1] + driven[k] and x[-1] = 0, along the first axis; shaped like `driven`.

    Blocks of 32 are a matrix product each; only the last values of the blocks follow one another in a loop.
    """
    count = len(driven)
    blocks = -(-count // _STEPS)
    padded = np.zeros((blocks * _STEPS, *driven.shape[1:]))
    padded[:count] = driven
    padded = padded.reshape(blocks, _STEPS, -1)
    powers = decay ** np.arange(_STEPS + 1)
    lag = np.subtract.outer(np.arange(_STEPS), np.arange(_STEPS))
    within = np.where(lag >= 0, powers[np.abs(lag)], 0.0) @ padded
    carried = np.zeros(within.shape[2])
    entries = np.empty((blocks, within.shape[2]))
    for block in range(blocks):
        entries[block] = carried
        carried = within[block, -1] + powers[_STEPS] * carried
    within += powers[1:, None] * entries[:, None, :]
    return within.reshape(blocks * _STEPS, *driven.shape[1:])[:count]
