"""Impulses and steady lines: found in each run's record before any fit, taken out of it, and named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import gamma

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._model_file import DisturbanceTerm, Model
from drivers.base.arrays import Array
from simulators.effects import Disturbance, catalogue

_SURE = 0.95
"""Highest probability stated: something else may look like it."""
_OUTLIER = 8.0
"""Standard deviations by which a sample must stand off its neighbours, itself or with the next one."""
_STEADY_DPS = 0.02
_NEAR = 41
_MOST_LINES = 6
_LONGEST_S = 60.0
"""What repeats more slowly is switched by something (a compressor, a controller) and no vibration or mains."""
_CLEAR = 14.0
"""Log evidence of a line, over all the frequencies looked at."""
_FINER = 4
_AROUND = 129
_ORDERS = 60
"""Harmonics of the table's angle that are not taken for lines."""
_STEADY_SHARE = 0.5
"""Least amplitude of a line in any quarter of a run against its largest."""
_SEEN = 3.0
_OVERTONES = 8


@dataclass(frozen=True)
class Disturbed:
    """What was found: runs with it taken out, and each kind as a term with its probability and a sentence."""

    runs: list[GapRun]
    terms: tuple[DisturbanceTerm, ...]
    probabilities: dict[str, float]
    sentences: dict[str, str]


def without_disturbances(runs: Sequence[GapRun], model: Model) -> Disturbed:
    """Find impulses and lines in runs against a model; those that the model has are taken out and not named."""
    known = {term.name for term in model.disturbances}
    terms, probabilities, sentences = [], {}, {}
    kept, found = _without_impulses(runs)
    if found is not None:
        terms.append(found[0])
        probabilities["impulses"], sentences["impulses"] = _SURE, found[1]
    kept, lines = _without_lines(kept, model)
    if lines:
        name = "vibration_or_mains_line"
        best = max(lines, key=lambda line: line.evidence)
        hours = sum(len(run.stimulus) * run.stimulus.period_s for run in runs) / 3600.0
        sigma = best.amplitude_dph / math.sqrt(2.0 * best.evidence)
        terms.append(
            _term(name, (best.amplitude_dph, best.frequency_hz), (sigma, 1.0 / (3600.0 * max(hours, 1e-3))))
        )
        probabilities[name] = _SURE
        sentences[name] = "; ".join(line.sentence for line in lines)
    named = tuple(term for term in terms if term.name not in known)
    return Disturbed(
        kept,
        named,
        {term.name: probabilities[term.name] for term in named},
        {term.name: f"{term.effect.meaning} {sentences[term.name]}" for term in named},
    )


def _term(name: str, values: tuple[float, ...], sigmas: tuple[float, ...]) -> DisturbanceTerm:
    effect = catalogue()[name]
    assert isinstance(effect, Disturbance)
    return DisturbanceTerm(effect, values, sigmas)


def _without_impulses(runs: Sequence[GapRun]) -> tuple[list[GapRun], tuple[DisturbanceTerm, str] | None]:
    """Return the runs with impulses missing, and how many and how large they are."""
    kept, sizes = [], []
    hours = 0.0
    for run in runs:
        at, angle_arcsec = _impulses(run)
        hours += len(run.stimulus) * run.stimulus.period_s / 3600.0
        sizes += angle_arcsec
        if len(at):
            output = run.output_dph.copy()
            output[at] = np.nan
            run = replace(run, output_dph=output)
        kept.append(run)
    if not sizes:
        return kept, None
    rate, size = len(sizes) / hours, float(np.sqrt(np.mean(np.square(sizes))))
    root = math.sqrt(len(sizes))
    sentence = (
        f"{len(sizes)} in {hours:.1f} h, {size:.3g} arcsec rms, largest {max(sizes, key=abs):.3g} arcsec; "
        "these samples are left out"
    )
    return kept, (_term("impulses", (rate, size), (rate / root, size / root)), sentence)


def _impulses(run: GapRun) -> tuple[NDArray[np.int64], list[float]]:
    """Return the samples that hold impulses, and the angle of each impulse in arcsec (deg/h times s).

    One or two samples off the mean of their neighbours, where the table turns steadily.
    """
    rest = run.output_dph - run.stimulus.input_rate_dph
    n = len(rest)
    if n < 8:
        return np.zeros(0, dtype=np.int64), []
    rate = run.stimulus.table_rate_dps
    level = run.stimulus.elevation_deg
    # two samples on either side with the table's rate the same
    still = np.ones(n, dtype=bool)
    for values, least in ((rate, _STEADY_DPS), (level, 0.01)):
        low = np.min([np.roll(values, k) for k in range(-3, 4)], axis=0)
        high = np.max([np.roll(values, k) for k in range(-3, 4)], axis=0)
        still &= high - low < least
    still[:3] = still[-3:] = False
    one = rest - 0.5 * (np.roll(rest, 1) + np.roll(rest, -1))
    two = 0.5 * (rest + np.roll(rest, -1)) - 0.5 * (np.roll(rest, 1) + np.roll(rest, -2))
    marks: list[int] = []
    taken: list[float] = []
    left = np.abs(np.stack([_scaled(one, still), _scaled(two, still)]))
    while True:
        kind, k = np.unravel_index(int(np.nanargmax(left)), left.shape)
        if not left[kind, k] > _OUTLIER or len(taken) > n // 50:
            break
        own = [int(k)] if kind == 0 else [int(k), int(k) + 1]
        size = float(one[k]) if kind == 0 else 2.0 * float(two[k])
        taken.append(size * run.stimulus.period_s)
        marks += own
        left[:, max(own[0] - 3, 0) : own[-1] + 4] = 0.0
    return np.array(sorted(marks), dtype=np.int64), taken


def _scaled(values: Array, still: NDArray[np.bool_]) -> Array:
    """Return values over their robust standard deviation, in the run and about each sample, whichever is larger.

    0 where the table does not turn steadily.
    """
    use = still & ~np.isnan(values)
    if use.sum() < 32:
        return np.zeros(len(values))
    centre = float(np.median(values[use]))
    away = np.abs(values[use] - centre)
    # the 95 % point beside the median: noise in steps may have a median of nothing
    sigma = max(float(np.median(away)) / 0.6745, float(np.quantile(away, 0.95)) / 1.96)
    # where the run is unquiet (a harmonic of a fast turn) its own neighbourhood counts
    near = median_filter(np.where(use, np.abs(values - centre), 0.0), _NEAR, mode="reflect") / 0.6745
    return np.where(use, (values - centre) / np.maximum(max(sigma, 1e-12), near), 0.0)


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


def _without_lines(runs: Sequence[GapRun], model: Model) -> tuple[list[GapRun], list[_SteadyLine]]:
    kept = list(runs)
    lines: list[_SteadyLine] = []
    for period_s in sorted({run.stimulus.period_s for run in runs}):
        at = [k for k, run in enumerate(runs) if run.stimulus.period_s == period_s and _is_steady(run)]
        rests = [_rest(runs[k], model) for k in at]
        for _ in range(_MOST_LINES):
            frequency, evidence = _strongest(rests, [runs[k] for k in at], period_s)
            if evidence < _CLEAR:
                break
            fits = [_fitted(rest, frequency) for rest in rests]
            if not _lasts(fits) or _overtone(rests, frequency):
                break
            waves = [fit.wave for fit in fits]
            rests = [rest - wave for rest, wave in zip(rests, waves, strict=True)]
            for k, wave in zip(at, waves, strict=True):
                kept[k] = replace(kept[k], output_dph=kept[k].output_dph - wave)
            amplitude = math.sqrt(float(np.mean([fit.amplitude**2 for fit in fits])))
            lines.append(_SteadyLine(frequency / period_s, amplitude, evidence, 1.0 / period_s))
    return kept, lines


def _is_steady(run: GapRun) -> bool:
    s = run.stimulus
    return bool(np.ptp(s.table_rate_dps) < _STEADY_DPS and np.ptp(s.elevation_deg) < 0.01 and len(s) >= 512)


def _rest(run: GapRun, model: Model) -> Array:
    """Return output less model, its gaps bridged."""
    rest = run.output_dph - model.predict(run.stimulus)
    missing = np.isnan(rest)
    rest[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), rest[~missing])
    return np.asarray(rest - rest.mean())


def _spectrum(rest: Array, size: int) -> Array:
    """Return the power of a Hann-windowed record over that of its surroundings, (size // 2 + 1,)."""
    window = np.hanning(len(rest))
    return _over_surroundings(np.abs(np.fft.rfft(rest * window, size)) ** 2)


def _over_surroundings(power: Array) -> Array:
    # the median of noise's exponential power is ln 2 of its mean; neighbours of a finer grid repeat each other
    around = median_filter(power[::_FINER], _AROUND, mode="reflect") / math.log(2.0)
    return np.asarray(power / np.interp(np.arange(len(power)), np.arange(0, len(power), _FINER), around))


def _strongest(rests: Sequence[Array], runs: Sequence[GapRun], period_s: float) -> tuple[float, float]:
    """Return the frequency (cycles a sample) of the strongest line of all runs together, and its log evidence."""
    if not rests:
        return 0.0, 0.0
    size = _FINER * max(len(rest) for rest in rests)
    frequency = np.arange(size // 2 + 1) / size
    total = np.zeros(len(frequency))
    count = np.zeros(len(frequency))
    for rest, run in zip(rests, runs, strict=True):
        use = ~_turned(run, frequency, len(rest))
        total[use] += np.minimum(_spectrum(rest, size)[use], 1e4)
        count += use
    use = (frequency > period_s / _LONGEST_S) & (frequency < 0.5 - 2.0 * _FINER / size) & (count > 0)
    if not use.any():
        return 0.0, 0.0
    log_p = np.zeros(len(frequency))
    log_p[use] = gamma.logsf(total[use], count[use])
    log_p[use & ~np.isfinite(log_p)] = -total[use & ~np.isfinite(log_p)]
    best = int(np.argmin(log_p))
    return float(frequency[best]), -float(log_p[best]) - math.log(len(frequency))


def _turned(run: GapRun, frequency: Array, n: int) -> NDArray[np.bool_]:
    """Return which frequencies are harmonics of the table's turning, or their aliases."""
    turns = abs(float(np.mean(run.stimulus.table_rate_dps))) * run.stimulus.period_s / 360.0
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


def _fitted(rest: Array, frequency: float) -> _SineFit:
    """Fit a sinusoid near a frequency (cycles a sample), to a small part of the record's resolution."""
    n = len(rest)
    time = np.arange(n) - 0.5 * (n - 1)
    window = np.hanning(n)
    best, step = frequency, 0.5 / n
    for _ in range(3):
        tries = best + step * np.linspace(-1.0, 1.0, 7)
        size = [abs(np.exp(-2j * np.pi * each * time) @ (rest * window)) for each in tries]
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
        ratio = _over_surroundings(power)
        for order in range(1, _OVERTONES + 1):
            at = max(round(frequency / order * n), 3)
            sizes[order] += power[at - 3 : at + 4].max() / len(rest) ** 2
            clear[order] += ratio[at - 3 : at + 4].max() / len(rests)
    return bool(((sizes[2:] > sizes[1]) & (clear[2:] > _CLEAR)).any())
