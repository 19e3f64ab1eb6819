"""A steady line of one frequency in the output, as of vibration or mains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD
from simulators.effects._disturbance import Disturbance, Draws, Finding, Record, SamplePath
from simulators.effects._effect import DPH, Parameter, Unit
from simulators.effects._line_track import WANDERS, amplitude_near, tracked
from simulators.effects._stimulus import STEADY_DPS, Stimulus

_MOST_LINES = 6
_LONGEST_S = 60.0
"""What repeats more slowly is switched by something (a compressor, a controller) and no vibration or mains."""
_FEWEST_CYCLES = 8.0
"""Of a line in the longest run: fewer are a drift that comes back."""
_CLEAR = 14.0
"""Log evidence of a line, over all the frequencies looked at."""
_MOST_POWER = 1e4
"""Largest power of one bin over its surroundings that counts as evidence."""
_FINER = 4
_AROUND = 129
_ORDERS = 60
"""Harmonics of the table's angle that are not taken for lines."""
_STEADY_SHARE = 0.5
"""Least amplitude of a line in any quarter of a run against its largest."""
_SEEN = 3.0
_ALIKE = 0.5
"""Part by which a line's amplitude in a run in which the table moves may differ from that in the steady ones."""
_OVERTONES = 24
_SHORTEST_DWELL = 32
"""Samples at one rate of the table whose mean is taken out before lines are looked for among them."""


@dataclass(frozen=True)
class _SteadyLine:
    frequency_hz: float
    amplitude_dph: float
    evidence: float
    sampling_hz: float

    @property
    def sentence(self) -> str:
        return (
            f"{self.amplitude_dph:.3g} deg/h at {self.frequency_hz:.5g} Hz, or at what samples of "
            f"{1.0 / self.sampling_hz:g} s show so; taken out of the runs"
        )


def _find(records: Sequence[Record]) -> Finding | None:
    """Find lines in all steady runs of one period together; each run loses them with its own phase."""
    outputs = [record.output_dph for record in records]
    lines: list[_SteadyLine] = []
    for period_s in sorted({record.stimulus.period_s for record in records}):
        at = [
            k
            for k, own in enumerate(records)
            if own.stimulus.period_s == period_s and _is_steady(own.stimulus)
        ]
        steady = [records[k] for k in at]
        rests = [_rest(record) for record in steady]
        for _ in range(_MOST_LINES):
            taken = [line.frequency_hz * period_s for line in lines if line.sampling_hz == 1.0 / period_s]
            frequency, evidence = _strongest(rests, steady, period_s, taken)
            if evidence < _CLEAR:
                break
            fits = [_fitted(rest, frequency) for rest in rests]
            near = max(amplitude_near(rest, frequency) for rest in rests)
            largest = max(near, *(fit.amplitude for fit in fits))
            fits = [
                fit.moved(tracked(rest, frequency, largest, fit.wave))
                for rest, fit in zip(rests, fits, strict=True)
            ]
            if not _lasts(fits) or _overtone(rests, frequency):
                break
            waves = [fit.wave for fit in fits]
            rests = [rest - wave for rest, wave in zip(rests, waves, strict=True)]
            for k, wave in zip(at, waves, strict=True):
                outputs[k] = outputs[k] - wave
            amplitude = math.sqrt(2.0 * float(np.mean([np.mean(np.square(wave)) for wave in waves])))
            lines.append(_SteadyLine(frequency / period_s, amplitude, evidence, 1.0 / period_s))
    if not lines:
        return None
    for k, record in enumerate(records):
        if not _is_steady(record.stimulus):
            outputs[k] = outputs[k] - _waves(lines, record)
    best = max(lines, key=lambda line: line.evidence)
    hours = sum(len(record.stimulus) * record.stimulus.period_s for record in records) / 3600.0
    sigma = best.amplitude_dph / math.sqrt(2.0 * best.evidence)
    return Finding(
        (best.amplitude_dph, best.frequency_hz),
        (sigma, 1.0 / (3600.0 * max(hours, 1e-3))),
        "; ".join(line.sentence for line in lines),
        tuple(outputs),
    )


def _waves(lines: Sequence[_SteadyLine], record: Record) -> Array:
    """Return the lines of steady runs that a run in which the table moves has, too, as large as there, (n,)."""
    rest, waves = _levelled(record), np.zeros(len(record.output_dph))
    for line in lines:
        cycles = line.frequency_hz * record.stimulus.period_s
        folded = abs((cycles + 0.5) % 1.0 - 0.5)
        if folded * len(waves) > _SEEN:
            waves = waves + _wave_of(line, folded, rest - waves)
    return waves


def _wave_of(line: _SteadyLine, folded: float, rest: Array) -> Array:
    """Return a line of steady runs as it is in another, (n,), else zeros; NaN in `rest` is what is not known."""
    fit = _fitted(np.nan_to_num(rest), folded)
    alike = abs(fit.amplitude / line.amplitude_dph - 1.0) < _ALIKE
    return tracked(rest, folded, line.amplitude_dph, fit.wave if alike else np.zeros(len(rest)))


def _is_steady(s: Stimulus) -> bool:
    return bool(np.ptp(s.table_rate_dps) < STEADY_DPS and np.ptp(s.elevation_deg) < 0.01 and len(s) >= 512)


def _rest(record: Record) -> Array:
    """Return output less model, its gaps bridged."""
    rest = record.output_dph - record.predict(record.stimulus)
    missing = np.isnan(rest)
    rest[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), rest[~missing])
    return np.asarray(rest - rest.mean())


def _levelled(record: Record) -> Array:
    """Return output less model, NaN in gaps; of a table that dwells at rates less each mean, NaN between them."""
    rest, rate = _rest(record), record.stimulus.table_rate_dps
    rest[np.isnan(record.output_dph)] = np.nan
    edges = np.flatnonzero(np.abs(np.diff(rate)) > STEADY_DPS) + 1
    parts = np.split(np.arange(len(rest)), edges)
    dwells = [part for part in parts if len(part) >= _SHORTEST_DWELL]
    if 2 * sum(map(len, dwells)) < len(rest):
        return rest
    result = np.full(len(rest), np.nan)
    for part in dwells:
        # the samples at its ends hold a part of the change of rate
        inner = rest[part[1:-1]]
        result[part[1:-1]] = inner - (np.nanmean(inner) if np.isfinite(inner).any() else 0.0)
    return result


def _spectrum(rest: Array, size: int) -> Array:
    """Return the power of a Hann-windowed record over that of its surroundings, (size // 2 + 1,)."""
    window = np.hanning(len(rest))
    return _over_surroundings(np.abs(np.fft.rfft(rest * window, size)) ** 2, size // len(rest))


def _over_surroundings(power: Array, finer: int) -> Array:
    """Return power over the median around it; `finer`: points of its grid from one frequency of the record to
    the next, which repeat each other.
    """
    from scipy.ndimage import median_filter  # here: a lab starts without scipy (decision 0021)

    # the median of noise's exponential power is ln 2 of its mean
    around = median_filter(power[::finer], _AROUND, mode="reflect") / math.log(2.0)
    return np.asarray(power / np.interp(np.arange(len(power)), np.arange(0, len(power), finer), around))


def _strongest(
    rests: Sequence[Array], records: Sequence[Record], period_s: float, taken: Sequence[float]
) -> tuple[float, float]:
    """Return the frequency (cycles a sample) of the strongest line of all runs together, and its log evidence.

    What is near those `taken` is what they left.
    """
    if not rests:
        return 0.0, 0.0
    size = _FINER * max(len(rest) for rest in rests)
    frequency = np.arange(size // 2 + 1) / size
    total = np.zeros(len(frequency))
    power = np.zeros(len(frequency))
    count = np.zeros(len(frequency))
    for rest, record in zip(rests, records, strict=True):
        use = ~_turned(record.stimulus, frequency, len(rest))
        spectrum = _spectrum(rest, size)
        total[use] += np.minimum(spectrum[use], _MOST_POWER)  # one run alone must not outvote all others
        power[use] += spectrum[use]
        count += use
    slowest = max(period_s / _LONGEST_S, _FEWEST_CYCLES * _FINER / size)
    use = (frequency > slowest) & (frequency < 0.5 - 2.0 * _FINER / size) & (count > 0)
    for other in taken:
        use &= np.abs(frequency - other) > WANDERS * other
    if not use.any():
        return 0.0, 0.0
    from scipy.stats import gamma

    log_p = np.zeros(len(frequency))
    log_p[use] = gamma.logsf(total[use], count[use])
    log_p[use & ~np.isfinite(log_p)] = -total[use & ~np.isfinite(log_p)]
    # all bins of a strong line reach the limit: take the highest of them
    alike = np.flatnonzero(log_p == log_p.min())
    best = int(alike[np.argmax(power[alike])])
    return float(frequency[best]), -float(log_p[best]) - math.log(len(frequency))


def _turned(s: Stimulus, frequency: Array, n: int) -> NDArray[np.bool_]:
    """Return which frequencies are harmonics of the table's turning, or their aliases."""
    turns = abs(float(np.mean(s.table_rate_dps))) * s.period_s / 360.0
    near = np.zeros(len(frequency), dtype=bool)
    if turns * n < 0.5:
        return near
    width = 3.0 / n + 1e-4 * turns
    for order in range(1, _ORDERS + 1):
        folded = abs((order * turns + 0.5) % 1.0 - 0.5)
        near |= np.abs(frequency - folded) < width
    return near


@dataclass(frozen=True)
class _SineFit:
    """A sinusoid fitted to a record: the wave, its amplitude, and those of the record's quarters; their sigma."""

    wave: Array
    amplitude: float
    quarters: Array
    sigma: float

    def moved(self, wave: Array) -> _SineFit:
        """Return this with the wave of a line that wanders, if it is another one."""
        if wave is self.wave:
            return self
        size, *quarters = (
            math.sqrt(2.0 * float(np.mean(np.square(part)))) for part in (wave, *np.array_split(wave, 4))
        )
        return _SineFit(wave, size, np.array(quarters), self.sigma)


def _fitted(rest: Array, frequency: float) -> _SineFit:
    """Fit a sinusoid near a frequency (cycles a sample), to a small part of the record's resolution."""
    n = len(rest)
    time = np.arange(n) - 0.5 * (n - 1)
    window = np.hanning(n)
    best, step = frequency, 0.5 / n
    for _ in range(3):
        tries = best + step * np.linspace(-1.0, 1.0, 7)
        size = [abs(np.exp(-2j * np.pi * frequency * time) @ (rest * window)) for frequency in tries]
        best, step = float(tries[int(np.argmax(size))]), 0.25 * step
    turn = 2.0 * np.pi * best * time
    columns = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    # where the window is small the slow part of the record counts little
    values = np.linalg.lstsq(columns * window[:, None], rest * window, rcond=None)[0]
    wave = columns @ values
    spread = float(np.median(np.abs(np.diff(rest - wave)))) / 0.6745 / math.sqrt(2.0)
    quarters = []
    for part in np.array_split(np.arange(n), 4):
        own = np.hanning(len(part))[:, None]
        fit = np.linalg.lstsq(columns[part] * own, rest[part] * own[:, 0], rcond=None)[0]
        quarters.append(float(np.hypot(*fit)))
    return _SineFit(wave, float(np.hypot(*values)), np.array(quarters), spread * math.sqrt(3.0 / (n / 4.0)))


def _lasts(fits: Sequence[_SineFit]) -> bool:
    """Return whether the line is there in every quarter of the runs, as far as their noise lets one see."""
    amplitude = np.sqrt(np.mean([fit.quarters**2 for fit in fits], axis=0))
    noise = math.sqrt(float(np.mean([fit.sigma**2 for fit in fits])) * 2.0 / len(fits))
    least, most = float(amplitude.min()), float(amplitude.max())
    return least + _SEEN * noise > _STEADY_SHARE * most and most > _SEEN * noise


def _overtone(rests: Sequence[Array], frequency: float) -> bool:
    """Return whether there is a stronger line at a whole part of the frequency: then this is its overtone."""
    sizes = np.zeros(_OVERTONES + 1)
    clear = np.zeros(_OVERTONES + 1)
    for rest in rests:
        n = _FINER * len(rest)
        power = np.abs(np.fft.rfft(rest * np.hanning(len(rest)), n)) ** 2
        ratio = _over_surroundings(power, _FINER)
        for order in range(1, _OVERTONES + 1):
            at = max(round(frequency / order * n), 3)
            sizes[order] += power[at - 3 : at + 4].max() / len(rest) ** 2
            clear[order] += ratio[at - 3 : at + 4].max() / len(rests)
    return bool(((sizes[2:] > sizes[1]) & (clear[2:] > _CLEAR)).any())


class _Line:
    """A sinusoid on the rate with a phase drawn at power-on, its mean over each sample exactly."""

    def __init__(self, values: Sequence[float], draws: Draws) -> None:
        amplitude_dph, frequency_hz = values
        self._swing_rad = amplitude_dph * ARCSEC_RAD / (2.0 * math.pi * frequency_hz) if frequency_hz else 0.0
        self._frequency_hz = frequency_hz
        self._phase = 2.0 * math.pi * float(draws.generator(0).random())

    def __call__(self, path: SamplePath) -> Array:
        """Return what it adds to the angle increments, rad (n,)."""
        turn = 2.0 * math.pi * np.modf(self._frequency_hz * path.edges_s)[0] + self._phase
        return np.asarray(-self._swing_rad * np.diff(np.cos(turn)))


STEADY_LINE = Disturbance(
    "vibration_or_mains_line",
    (Parameter("amplitude_dph", 0.0, 1e6, DPH), Parameter("frequency_hz", 0.0, 1e4, Unit("Hz"))),
    "IEEE Std 952, sinusoidal noise",
    "A steady line of one frequency, as of vibration or mains, seen at its alias where samples are slow.",
    _find,
    _Line,
)
