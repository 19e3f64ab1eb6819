"""Our Allan deviation and intervals beside Stable32's: `python -m benchmarks.stable32 [--write]`.

Data and Stable32's tables are those that allantools publishes with its tests; they are fetched, checked by their
SHA-256 and kept in a cache only. Stable32 prints five digits: a difference of 5e-5 of a figure is its last digit.
Its intervals (68.3 %) are compared where it takes the noise for white or flicker phase, white, flicker or random
walk of the rate, by that exponent, as far as ours knows it (it has no flicker phase).
"""

from __future__ import annotations

import argparse
import gzip
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval
from benchmarks._fetched import CACHE, fetched
from benchmarks._sections import RESULTS, write_section
from drivers.base.arrays import Array

_PLACE = "aewallin/allantools@5d2452b3afceb47551434292737884adf8c867a5:tests/"
_FEW = 10.0
"""Averaging times in a record below which ways to count degrees of freedom differ by more than some percent."""
_OCTAVES = """Stable32's octaves of the OCXO are those of frequencies near 1. Summed in double precision without
taking off their mean, these lose the third digit to rounding. Its table of every averaging time, of the same data
less their mean, agrees."""
_BY_TIME = ("tau_s", "deviation", "terms", "relative_error")


@dataclass(frozen=True)
class Set:
    """Data and a table of Stable32: files with their SHA-256, and what makes rates at 1 Hz of the numbers."""

    name: str
    data: tuple[str, str]
    table: tuple[str, str]
    rates: Callable[[Array], Array]
    as_summed: bool = False
    """Compare a running sum of the numbers as they are, as well: see `_summed`."""


def _fractional(hz: Array) -> Array:
    return hz / 1e7 - 1.0


_OCXO = ("ocxo/ocxo_frequency.txt", "2c507ce0fee6a2010116c6cfe78724d8f87b527f55cdbfe901afbdc9b214d3ac")
SETS = (
    Set(
        "PHASE.DAT, which comes with Stable32",
        ("phasedat/PHASE.DAT", "ce9b432432850d9072ae106696528fa3377db7fe3686521171b429b6cb5afbaa"),
        (
            "phasedat/phase_dat_oadev_octave.txt",
            "2cedf752b5e89490ad7679b524c2c0c3ecaca37931e28723f2f1c735803d7741",
        ),
        np.diff,
    ),
    Set(
        "caesium clock, 5071A",
        ("Cs5071A/5071A_phase.txt.gz", "aff036af22b8f9bea68bf5a0ad3fb6cd7bef31cbdf32cfbdf171b8b76b66d415"),
        ("Cs5071A/oadev_decade.txt", "ceae0684e1bb81efaa6c0f92ce78039e92136980f65ec5e6ba514c05dbd5e0ce"),
        np.diff,
    ),
    Set(
        "time interval counter, 53230A",
        (
            "Keysight53230A_ti_noise_floor/tic_phase.txt",
            "232719a28eb73efbbc790caabe0a0806e2f162f21ba4a57faf9e11a918a96359",
        ),
        (
            "Keysight53230A_ti_noise_floor/tic_oadev.txt",
            "8495e350c227b66ab9b3e860a53add38a37157ed99a6fe6501bad0f4b709e508",
        ),
        np.diff,
    ),
    Set(
        "flicker frequency noise",
        (
            "pink_frequency/pink_frequency.txt",
            "b6b88ba58d3d6508ec8a7fd834e02568ce74a8462daec76a84b3346db6d3802a",
        ),
        (
            "pink_frequency/s32_oadev_octave.txt",
            "a9619442db961cca7259c6143534e227b6d7e90ef3bfda385f06d4cb8109f6b3",
        ),
        np.asarray,
    ),
    Set(
        "OCXO, every averaging time",
        _OCXO,
        (
            "ocxo/stable32_oadev_alltau.txt",
            "c88ffb4a9361115f05f1fe1310fe624555d901c12eb878df49785416ba4cbc1a",
        ),
        _fractional,
    ),
    Set(
        "OCXO, octaves",
        _OCXO,
        ("ocxo/oadev_octave.txt", "f052f0aaecc83fc7f4648c02eb7d701a8520e484787609e68912449d31421853"),
        _fractional,
        as_summed=True,
    ),
)


def _numbers(path: Path) -> list[list[float]]:
    data = path.read_bytes()
    text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("latin-1")
    return [[float(word) for word in line.split()] for line in text.splitlines() if line[:1] not in ("#", "")]


def _summed(values: Array, lengths: Array) -> Array:
    """Return the overlapping Allan deviation of a plain running sum of numbers as they are, in double precision.

    Of numbers near 1 the sum grows to their count, and each step is rounded to 2e-16 of that.
    """
    phase = np.concatenate(([0.0], np.cumsum(values)))
    found = []
    for m in lengths.astype(int).tolist():
        second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
        found.append(float(np.sqrt(0.5 * np.mean(second**2)) / m))
    return np.array(found)


def compared(one: Set, cache: Path) -> tuple[str, ...]:
    """Return a row: name, averaging times, worst difference of deviations and of intervals' ends, relative."""
    raw = np.array(_numbers(fetched(_PLACE + one.data[0], one.data[1], cache)))[:, 0]
    table = np.array(_numbers(fetched(_PLACE + one.table[0], one.table[1], cache)))
    rates = one.rates(raw)
    lengths, low, sigma, high = table[:, 0], table[:, 4], table[:, 5], table[:, 6]
    ours = allan_deviation(rates, 1.0, lengths)
    worst = float(np.abs(ours.deviation / sigma - 1.0).max())
    known = (low > 0.0) & (table[:, 3] != 1) & (lengths * _FEW < len(rates))
    ends = "not in its table"
    if known.any():
        alpha = table[known, 3].astype(np.int64)
        part = replace(ours, **{name: getattr(ours, name)[known] for name in _BY_TIME})
        found = np.concatenate(confidence_interval(part, level=0.683, alpha=alpha))
        off = found / np.concatenate((low[known], high[known])) - 1.0
        ends = f"{np.abs(off).max():.1e}"
    row = (one.name, str(len(lengths)), f"{worst:.1e}", ends)
    if one.as_summed:
        again = float(np.abs(_summed(raw / 1e7, lengths) / sigma - 1.0).max())
        return (*row[:2], f"{worst:.1e}; of a running sum of f / 10 MHz, not less 1: {again:.1e}", ends)
    return row


def main() -> None:
    """Print the table; `--write` puts it into benchmarks/RESULTS.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=CACHE, help="where fetched files are kept")
    parser.add_argument("--write", action="store_true", help="write the section of benchmarks/RESULTS.md")
    asked = parser.parse_args()
    heads = ("data", "averaging times", "deviation: worst difference", "ends of the 68.3 % interval")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    lines += [f"| {' | '.join(compared(one, asked.cache))} |" for one in SETS]
    lines += ["", _OCTAVES]
    print("\n".join(lines))
    if asked.write:
        write_section("stable32", "python -m benchmarks.stable32", lines, RESULTS)


if __name__ == "__main__":
    main()
