"""How a run differs from those fitted is read off its own temperatures; hysteresis against a made one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bench.analysis.rlg import RampRun, _judge
from bench.analysis.rlg._judge import RampProfile, how_it_differs, hysteresis_dph, judge, profile_of
from bench.analysis.rlg._rows import ramp_run
from bench.analysis.rlg._study import run_rlg_study

Runs = Callable[[int], dict[str, RampRun]]


@pytest.mark.parametrize(
    ("low_c", "high_c", "words"),
    [
        (-20.0, 60.0, "another day"),
        (-25.0, 65.0, "another day"),
        (-15.0, 55.0, "another day"),
        (-25.1, 60.0, "beyond the range"),
        (-20.0, 65.1, "beyond the range"),
        (-14.9, 60.0, "part of the range"),
        (-20.0, 54.9, "part of the range"),
        (-14.9, 54.9, "part of the range"),
        (-14.9, 65.1, "beyond the range"),
    ],
)
def test_five_kelvin_at_either_end_are_the_same_range(
    monkeypatch: pytest.MonkeyPatch, low_c: float, high_c: float, words: str
) -> None:
    monkeypatch.setattr(_judge, "profile_of", lambda profile: profile)
    fitted = [RampProfile(1, 1.0, -20.0, 40.0), RampProfile(1, 1.0, 0.0, 60.0)]
    assert how_it_differs(RampProfile(1, 1.0, low_c, high_c), fitted) == words  # type: ignore[arg-type]


def test_a_run_is_named_by_what_its_temperatures_did(runs: Runs) -> None:
    of = runs(0)
    kinds = {kind: how_it_differs(of[kind], [of["train"]]) for kind in of if kind != "train"}
    assert kinds == {
        "repeat": "another day",
        "reverse": "other direction",
        "faster": "another rate",
        "partial": "part of the range",
    }
    assert how_it_differs(of["train"], [of["partial"]]) == "beyond the range"
    assert how_it_differs(of["reverse"], [of["partial"]]) == "other direction, beyond the range"
    assert how_it_differs(of["reverse"], [of["faster"]]) == "other direction, another rate"
    assert how_it_differs(of["reverse"], [of["train"], of["reverse"]]) == "another day"
    profile = profile_of(of["faster"])
    assert profile.direction == 1 and profile.rate == pytest.approx(1.0, abs=0.06)
    assert (profile.low_c, profile.high_c) == pytest.approx((-40.0, 65.0), abs=4.0)


def triangle() -> RampRun:
    time = np.arange(1.0, 40_001.0)
    temp = np.interp(time, [0, 20_000, 40_000], [-40.0, 60.0, -40.0])
    warming = np.where(time <= 20_000, 1.0, -1.0)
    return ramp_run("r", "u", time, temp, temp + 3.0, 1e-3 * temp + 2e-3 * warming)


def test_hysteresis_is_the_distance_of_the_two_branches() -> None:
    run = triangle()
    # 100 s at 0.3 K/min move 0.5 K: within the 2 K bins both branches see the same temperatures on average
    assert hysteresis_dph(run, run.bias_dph) == pytest.approx(4e-3, rel=0.05)
    assert hysteresis_dph(run, 1e-3 * run.case_c) < 5e-4
    up = ramp_run("r", "u", *(np.arange(1.0, 5001.0) * f for f in (1.0, 0.01, 0.01, 1e-6)))
    assert np.isnan(hysteresis_dph(up, up.bias_dph))


def test_the_equation_is_judged_on_both_branches(runs: Runs) -> None:
    of = runs(0)
    compensation = run_rlg_study([of["train"]], []).chosen.compensation
    row = judge(compensation, of["reverse"], [of["train"]])
    assert row.differs == "other direction"
    left = of["reverse"].bias_dph - compensation.drift_dph(of["reverse"])
    assert row.hysteresis_after_dph == hysteresis_dph(of["reverse"], left)
    assert row.hysteresis_after_dph < 0.2 * row.hysteresis_before_dph
