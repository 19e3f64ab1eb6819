"""Lines in what is left: chi-square tails beyond double precision, one frequency in runs of several profiles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bench.analysis.gap import Noise
from bench.analysis.gap._data import GapRun, Group
from bench.analysis.gap._lines import _log_tail, strongest_line
from bench.analysis.gap._rounding_noise import RoundingNoise
from tests.analysis.gap.conftest import made_run, stimulus


def test_tail_of_chi_square_goes_on_where_numbers_end() -> None:
    """For two degrees of freedom the tail is exp(-x / 2) exactly."""
    energy = np.array([10.0, 1e3, 1e5])
    np.testing.assert_allclose(_log_tail(energy, 2.0), -0.5 * energy)
    assert math.isfinite(float(_log_tail(np.array([1e6]), 64.0)[0]))


def _group(profile: str) -> tuple[Group, list[GapRun]]:
    run = made_run(profile, stimulus(4000), np.random.default_rng(1), profile=profile)
    runs = [run, replace(run, run_id=f"{profile} again")]
    return Group(profile, ("0",), (tuple(runs),)), runs


def test_a_line_too_weak_for_one_profile_is_found_in_all_together() -> None:
    groups = [_group(name)[0] for name in ("shock", "ramp", "room", "wave")]
    rng = np.random.default_rng(2)
    left = [rng.standard_normal((2, 3999)) for _ in groups]
    assert strongest_line(groups, left, Noise(0.004), {}) is None
    for rows in left:
        rows[:, 1604] += 5.5
    alone = strongest_line(groups[:1], left[:1], Noise(0.004), {})
    together = strongest_line(groups, left, Noise(0.004), {})
    assert together is not None
    assert together.profile == "shock, ramp, room, wave"
    # coefficient k has a period of 2 n / k samples, a window holds eight
    assert abs(2.0 * 4000.0 / together.period_s - 1605.0) <= 8.0
    assert alone is None or alone.log_evidence < together.log_evidence


def test_what_is_left_of_a_line_that_is_named_is_no_further_one() -> None:
    """Coefficient 1605 of 4000 samples of a second is at 0.2006 Hz, and so does 7.2006 Hz show."""
    group = _group("shock")[0]
    left = np.random.default_rng(3).standard_normal((2, 3999))
    left[:, 1604] += 9.0
    assert strongest_line([group], [left], Noise(0.004), {}) is not None
    for named_hz in (1605.0 / 8000.0, 7.0 + 1605.0 / 8000.0, 1.0 - 1605.0 / 8000.0):
        assert strongest_line([group], [left], Noise(0.004), {}, [named_hz]) is None
    assert strongest_line([group], [left], Noise(0.004), {}, [0.3]) is not None


def test_a_line_weaker_than_what_rounded_stamps_do_is_theirs() -> None:
    """Stamps of 1 ms at 10 deg/s: 2 (36000 x 0.29 ms)^2, 14.7 deg/h rms, of which a beat may make a line."""
    run = made_run("turned", stimulus(4000, rate_dps=10.0), np.random.default_rng(1))
    noise = RoundingNoise(
        np.full(4001, 1e-3 / math.sqrt(12.0)), np.zeros(4001), np.ones(4000), np.zeros(4001, np.bool_)
    )
    stamped = replace(run, rounding_noise=noise)
    left = np.random.default_rng(3).standard_normal((2, 3999))
    found = []
    for size in (9.0, 120.0):  # 2.5 and 33 deg/h
        left[:, 1604] = size
        for own in (run, stamped):
            group = Group("turned", ("0",), ((own, replace(own, run_id="again")),))
            found.append(strongest_line([group], [left], Noise(0.004), {}))
    weak, weak_of_stamps, strong, strong_of_stamps = found
    assert weak is not None and strong is not None and weak_of_stamps is None
    assert strong_of_stamps is not None and strong_of_stamps.amplitude_dph > math.sqrt(2.0) * 14.7
