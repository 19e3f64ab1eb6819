"""Perfect gyros behind loggers drawn at random: whatever wrote the log, there is no gap in it.

Run as `python -m benchmarks.any_logger [FIRST [COUNT [LOGGERS]]]`, LOGGERS one of `exact`, `stamps`, `codes`,
`both`, all if left out. Each case is three motions of a table, two runs each, of a gyro that differs from the
table by its own noise only. Drawn are the time between rows and its jitter, ticks and drift of the clock, rows
that are missing, digits of the stamps, codes of the angle, its jumps by a turn, attitude and noise. The log goes
through a mapping file as anybody's does. Every answer but "no gap" is printed with what was drawn.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq

from bench.analysis.gap import diagnose, parse_model, read_recordings
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError

LATITUDE_DEG = 48.0
LOGGERS = ("exact", "stamps", "codes", "both")
MOTIONS = ("steps", "sine", "slow", "heads", "still")
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_MODEL = """
format = 1
name = "nominal"
noise = {{ arw_deg_per_sqrt_h = {0}, bias_instability_dph = {1} }}
[[effect]]
name = "scale_factor"
parameters = {{ sf_ppm = 0.0 }}
sigma = {{ sf_ppm = 30.0 }}
[[effect]]
name = "bias_linear"
parameters = {{ bias_dph_per_50k = 0.0 }}
sigma = {{ bias_dph_per_50k = 0.4 }}
"""
_MAPPING = f"""
format = 1
unit_id = "G"
latitude_deg = {LATITUDE_DEG}
[columns]
time = {{ name = "t", unit = "s" }}
output = {{ name = "rate", unit = "deg/h" }}
angle = {{ name = "table", unit = "deg" }}
"""


@dataclass(frozen=True)
class Logger:
    """What was drawn: how rows are off their grid, digits of the stamps, codes of the angle (0: none), noise."""

    row_s: float
    clock: str
    jitter_s: float
    tick_s: float
    digits: int
    cut_off: bool
    code_deg: float
    wraps: bool
    lost: float
    elevation_deg: float
    arw_deg_per_sqrt_h: float
    bias_instability_dph: float

    def __str__(self) -> str:
        return ", ".join(f"{field.name} {getattr(self, field.name)}" for field in fields(self))


def drawn(rng: np.random.Generator, loggers: str) -> Logger:
    """Return a logger of one of `LOGGERS`."""
    row_s = float(rng.choice([0.02, 0.05, 0.1, 0.25, 0.5, 1.0]))
    elevation_deg = float(rng.choice([90.0, 90.0, 0.0, 30.0]))
    # a level axis feels the Earth's rate by its heading, which slow rows do not tell where the table turns fast
    row_s = row_s if elevation_deg == 90.0 else min(row_s, 0.1)
    digits = [2, 3, 4, 6] if row_s >= 0.1 else [3, 4, 6]
    codes_deg = [360.0 / 2**14, 360.0 / 2**16, 360.0 / 2**20, 1e-4, 1e-3, 1e-2]
    return Logger(
        row_s,
        str(rng.choice(["even", "jitter", "late", "ticks", "drift"])),
        float(rng.choice([0.005, 0.02, 0.05])) * row_s,
        float(rng.choice([1.0 / 64.0, 0.01, 0.012, 0.001, 1.0 / 1024.0])),
        int(rng.choice(digits)) if loggers in ("stamps", "both") else 9,
        bool(rng.integers(2)),
        float(rng.choice(codes_deg)) if loggers in ("codes", "both") else 0.0,
        bool(rng.integers(2)),
        float(rng.choice([0.0, 0.0, 0.0, 0.005, 0.05])),
        elevation_deg,
        float(rng.choice([0.001, 0.01, 0.1])),
        float(rng.choice([0.0, 0.02, 0.2])),
    )


def motion(kind: str, rng: np.random.Generator) -> tuple[Callable[[Array], Array], float]:
    """Return the table's angle in deg as a function of time, and how long the motion is, s."""
    faster, top = float(rng.choice([20.0, 50.0, 100.0, 300.0])), float(rng.choice([10.0, 20.0, 40.0, 80.0]))
    if kind == "still":
        return np.zeros_like, 1800.0
    if kind == "sine":
        period_s = float(rng.uniform(9.0, 61.3))
        size = top * period_s / (2.0 * np.pi)
        return lambda t: size * (1.0 - np.cos(2.0 * np.pi * np.maximum(t - 20.0, 0.0) / period_s)), 620.0
    if kind == "heads":
        rate = min(top, 20.0)
        rates = [0.0, *([rate, 0.0] * 8)]
        dwells_s = [90.0, *([45.0 / rate - rate / faster, 90.0] * 8)]
    else:
        sizes = top * (np.linspace(0.25, 1.0, 4) if kind == "steps" else np.array([0.01, 0.03, 0.1]))
        rates = [0.0, *(sign * size for size in sizes.tolist() for sign in (1.0, -1.0)), 0.0]
        dwells_s = [float(rng.choice([40.0, 60.0, 90.0])) if kind == "steps" else 120.0] * len(rates)
    times_s, values = [0.0], [0.0]
    for rate, dwell_s in zip(rates, dwells_s, strict=True):
        times_s += [times_s[-1] + abs(rate - values[-1]) / faster]
        times_s += [times_s[-1] + dwell_s]
        values += [rate, rate]
    at_s, rate_dps = np.array(times_s), np.array(values)
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (rate_dps[1:] + rate_dps[:-1]) * np.diff(at_s))))

    def angle_deg(t: Array) -> Array:
        k = np.clip(np.searchsorted(at_s, t, side="right") - 1, 0, len(at_s) - 2)
        since, change = t - at_s[k], (rate_dps[k + 1] - rate_dps[k]) / np.maximum(at_s[k + 1] - at_s[k], 1e-9)
        return np.asarray(angle[k] + rate_dps[k] * since + 0.5 * change * since**2)

    return angle_deg, float(at_s[-1])


def rows(
    logger: Logger, angle_deg: Callable[[Array], Array], long_s: float, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return stamps in s, rates in deg/h and angles in deg, (m,); a rate is the mean since the row before."""
    count = int(long_s / logger.row_s)
    t = rng.uniform(0.0, logger.row_s) + np.arange(count + 1.0) * logger.row_s
    if logger.clock == "jitter":
        t += rng.uniform(-logger.jitter_s, logger.jitter_s, len(t))
    elif logger.clock == "late":
        t = np.sort(t + np.minimum(rng.exponential(logger.jitter_s, len(t)), 0.9 * logger.row_s))
    elif logger.clock == "ticks":
        t = np.unique(np.rint(t / logger.tick_s) * logger.tick_s)
    elif logger.clock == "drift":
        t *= 1.0 + float(rng.uniform(-3e-4, 3e-4))
    lasts, later = np.diff(t), rng.uniform(0.0, 2.0)
    angle = angle_deg(np.maximum(t - later, 0.0))
    inside = t[:-1, None] + lasts[:, None] * (0.5 + 0.5 * _PLACES)
    heading = np.radians(angle_deg(np.maximum(inside - later, 0.0)))
    up = np.sin(np.radians(logger.elevation_deg))
    level = np.cos(np.radians(logger.elevation_deg)) * (np.cos(heading) @ (0.5 * _WEIGHTS))
    rate = 3600.0 * np.diff(angle) / lasts * up + earth_rate_up_dph(LATITUDE_DEG) * up
    rate += earth_rate_north_dph(LATITUDE_DEG) * level + _noise_dph(logger, lasts, rng)
    read = angle[1:]
    if logger.code_deg:
        read = np.floor(read / logger.code_deg) * logger.code_deg
    if logger.wraps:
        read = np.mod(read, 360.0)
    unit = 10.0**-logger.digits
    stamps = np.floor(t[1:] / unit) * unit if logger.cut_off else np.rint(t[1:] / unit) * unit
    kept = rng.random(len(rate)) >= logger.lost
    return stamps[kept], rate[kept], read[kept]


def _noise_dph(logger: Logger, lasts_s: Array, rng: np.random.Generator) -> Array:
    """Return white noise, and flicker of as much as its Allan deviation's bottom says (IEEE Std 952)."""
    white = 60.0 * logger.arw_deg_per_sqrt_h / np.sqrt(lasts_s) * rng.normal(size=len(lasts_s))
    frequency = rfftfreq(len(lasts_s), logger.row_s)
    frequency[0] = frequency[1]
    shape = logger.bias_instability_dph / np.sqrt(2.0 * np.pi * frequency * 2.0 * logger.row_s)
    return np.asarray(white + irfft(rfft(rng.normal(size=len(lasts_s))) * shape, len(lasts_s)))


def answer(seed: int, loggers: str, folder: Path) -> tuple[str, Logger]:
    """Return what is said of a case, its verdict first, and its logger; its files are in `folder`."""
    rng = np.random.default_rng([seed, LOGGERS.index(loggers)])
    logger, text = drawn(rng, loggers), _MAPPING
    for kind in rng.permutation(MOTIONS)[:3].tolist():
        moved = int(rng.integers(1 << 31))
        for repeat in range(2):
            angle_deg, long_s = motion(kind, np.random.default_rng(moved))
            columns = rows(logger, angle_deg, long_s, rng)
            log = [f"{t:.{logger.digits}f},{rate:.6f},{at:.7f}" for t, rate, at in zip(*columns, strict=True)]
            (folder / f"{kind}{repeat}.csv").write_text(
                "\n".join(["t,rate,table", *log]) + "\n", encoding="utf-8"
            )
            text += f'[[run]]\nfile = "{kind}{repeat}.csv"\nprofile = "{kind}"\ncondition = "x"\n'
            text += f"elevation_deg = {logger.elevation_deg}\n"
    (folder / "map.toml").write_text(text, encoding="utf-8")
    noise = _MODEL.format(logger.arw_deg_per_sqrt_h, logger.bias_instability_dph)
    try:
        found = diagnose(read_recordings([folder / "map.toml"]).runs, parse_model(noise, "nominal"))
    except ConfigurationError as error:
        return f"refused: {error}", logger
    names = [cause.name for cause in found.causes] + list(found.rate.stochastic)
    return ": ".join([found.verdict, *([", ".join(names)] if names else [])]), logger


def main() -> int:
    """Print the table; 0 always: it is a measurement."""
    first, count, *which = [*sys.argv[1:], *["0", "40"][len(sys.argv) - 1 :]]
    right: dict[str, int] = {}
    for loggers in which or LOGGERS:
        right[loggers] = 0
        for seed in range(int(first), int(first) + int(count)):
            with tempfile.TemporaryDirectory() as folder:
                said, logger = answer(seed, loggers, Path(folder))
            right[loggers] += said == "no gap"
            if said != "no gap":
                print(f"{loggers} {seed}: {said}; {logger}", flush=True)
    print("\n| logger | no gap |\n|---|---|")
    for loggers, number in right.items():
        print(f"| {loggers} | {number}/{count} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
