"""The clocks of unit and bench against the pulses at a unit's trigger input: one a second from a receiver, say.

A unit with such an input sends with each sample how long ago the last pulse came. By its own clock the pulse
was at `count * tick - since`; pulses come at equal intervals, so the slope of these instants over the intervals
is how fast the unit's clock is. The bench's clock follows from how fast the unit's is against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.record.recording._free_parts import PulseReport
from bench.record.recording._timing import StreamTiming

_LATE = 1.5
"""The first sample that tells of a pulse comes so many samples after it at most: a filter may delay it."""
_BENCH_OFF_PPM = 100.0
"""The bench's clock is told off beyond this: a free quartz has half of it, a disciplined one next to nothing."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass
class PulseTimer:
    """Gathers the pulses of a stream, batch by batch: one row a pulse.

    `tick_s`: a count's length by the unit's own clock. `interval_s`: the time between pulses, two samples at
    least. `begins`: int64 (m,), the samples at which the unit was switched on again: its count there is another.
    `resolution_s`: the step of the time that the unit tells, 0 where nobody knows.
    """

    tick_s: float
    interval_s: float
    begins: Ints
    resolution_s: float = 0.0
    _seen: int = 0
    _last: tuple[int, float] = (0, math.nan)
    _instants: list[Floats] = field(default_factory=list)
    _of: list[Ints] = field(default_factory=list)

    def feed(self, count: Ints, since_s: Floats) -> None:
        """Take the unwrapped counts of consecutive samples and the time since the last pulse, (n,) each."""
        if not len(count):
            return
        sample = self._seen + np.arange(len(count))
        elapsed_s = np.diff(count, prepend=self._last[0]) * self.tick_s
        before_s = np.concatenate(([self._last[1]], since_s[:-1]))
        with np.errstate(invalid="ignore"):
            # without a pulse the time grows with the count, or stands where it can grow no more
            fresh = before_s + elapsed_s - since_s > 0.5 * self.interval_s
            fresh &= (since_s >= 0.0) & (since_s <= _LATE * elapsed_s) & (since_s != before_s)
        fresh &= ~np.isin(sample, self.begins)
        self._instants.append(count[fresh] * self.tick_s - since_s[fresh])
        self._of.append(np.searchsorted(self.begins, sample[fresh], side="right"))
        self._seen += len(count)
        self._last = int(count[-1]), float(since_s[-1])

    def report(self, timing: StreamTiming) -> PulseReport | None:
        """Return what the pulses of a whole stream say; None for a unit that tells of no pulses."""
        if not self._seen:
            return None
        instants_s, of = np.concatenate(self._instants), np.concatenate(self._of)
        found = PulseReport(len(instants_s), 0, self.interval_s)
        true_s, unit_s, counts = [np.zeros(0)], [np.zeros(0)], 0
        for each in np.unique(of):
            own_s = instants_s[of == each]
            number = np.cumsum(np.rint(np.diff(own_s, prepend=own_s[0]) / self.interval_s))
            found = replace(found, missed=found.missed + int(number[-1]) + 1 - len(own_s))
            true_s.append(self.interval_s * (number - number.mean()))
            unit_s.append(own_s - own_s.mean())
            counts += 1
        true, unit = np.concatenate(true_s), np.concatenate(unit_s)
        free, spread = len(true) - counts - 1, float(true @ true)
        if free < 1:
            return found
        error = float(true @ (unit - true)) / spread
        left = unit - (1.0 + error) * true
        scatter_s = math.sqrt(float(left @ left) / free)
        # a clock that is nearly right is rounded alike for long: half a step along half of the line at worst
        rounded = 1.5 * self.resolution_s / math.sqrt(12.0 * spread / len(true)) / math.sqrt(3.0)
        uncertainty = math.hypot(scatter_s / math.sqrt(spread), rounded)
        by_arrival = timing.residual_s / float(np.ptp(instants_s))
        bench = (1.0 + error) / (1.0 + 1e-6 * timing.clock_error_ppm) - 1.0
        return replace(
            found,
            scatter_s=scatter_s,
            unit_clock_error_ppm=1e6 * error,
            unit_clock_uncertainty_ppm=1e6 * uncertainty,
            bench_clock_error_ppm=1e6 * bench,
            bench_clock_uncertainty_ppm=1e6 * math.hypot(uncertainty, by_arrival),
        )


def warnings_of(pulses: PulseReport | None) -> tuple[str, ...]:
    """Return what an operator should know of a stream's pulses."""
    if pulses is None:
        return ()
    if not pulses.pulses:
        return (
            "the unit tells the time since a pulse, and no pulse came: check the cable of its trigger input",
        )
    texts = []
    if pulses.missed:
        texts.append(
            f"{pulses.missed} of {pulses.pulses + pulses.missed} pulses at the unit's input are missing"
        )
    off, uncertainty = pulses.bench_clock_error_ppm, pulses.bench_clock_uncertainty_ppm
    if off is not None and uncertainty is not None and abs(off) > _BENCH_OFF_PPM + 2.0 * uncertainty:
        texts.append(f"the bench's clock is off by {off:+.0f} ppm against the pulses at the unit's input")
    return tuple(texts)
