"""What has no name is closed by forms judged on a profile left out, or refused; repeats that differ are told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model, closed_model, diagnose, model_text, parse_model
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._learn import learned
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._prepare import prepare
from simulators.effects import FORMS, PPM, Stimulus, Variant, learned_shape
from tests.analysis.gap.conftest import made_run, stimulus

PROFILES = {"short": 4000, "long": 7000, "longer": 9000}


def _runs(rng: np.random.Generator, extra: object, profiles: dict[str, int] = PROFILES) -> list[GapRun]:
    runs = []
    for profile, n in profiles.items():
        for repeat in range(3):
            s = stimulus(n)
            added = extra(s, profile, repeat)  # type: ignore[operator]
            runs.append(made_run(f"{profile} {repeat}", s, rng, added, profile=profile))
    return runs


def _fringes(s: object, profile: str, repeat: int) -> np.ndarray:
    """An etalon in the light path: fringes over temperature, in no formula of the catalogue."""
    return np.asarray(0.8 * np.sin(2.0 * np.pi * s.warm_k / 14.0))  # type: ignore[attr-defined]


def test_fringes_are_closed_on_a_profile_left_out_and_the_model_file_keeps_them(nominal: Model) -> None:
    runs = _runs(np.random.default_rng(3), _fringes)
    kept, judges = (
        [r for r in runs if not r.run_id.endswith("2")],
        [r for r in runs if r.run_id.endswith("2")],
    )
    found = diagnose(kept, nominal, judges)
    learned = found.rate.learned
    assert found.verdict == "unknown"
    assert learned is not None
    assert learned.share > 0.6
    assert set(learned.by_profile) == set(PROFILES)
    closed = closed_model(found)
    again = parse_model(model_text(closed), "closed")
    s = stimulus(6000)
    left = _fringes(s, "", 0) - (again.predict(s) - found.model.predict(s))
    assert np.std(left) < 0.3 * np.std(_fringes(s, "", 0))
    assert again.predict(s) == pytest.approx(closed.predict(s), rel=1e-12)


def test_what_one_profile_alone_shows_is_not_learned(nominal: Model) -> None:
    """Bursts at times of their own, in one profile only: every fit of them is a memory of that profile."""

    def bursts(s: object, profile: str, repeat: int) -> np.ndarray:
        time_s = s.time_s  # type: ignore[attr-defined]
        return np.where((profile == "long") & (time_s % 1700.0 < 300.0) & (time_s > 3000.0), 1.5, 0.0)

    learned = diagnose(_runs(np.random.default_rng(5), bursts), nominal).rate.learned
    assert learned is None or not learned.terms


def test_a_telegraph_is_told_as_differing_between_repeats_and_a_random_walk_is_not(nominal: Model) -> None:
    rng = np.random.default_rng(8)

    def telegraph(s: object, profile: str, repeat: int) -> np.ndarray:
        n = len(s)  # type: ignore[arg-type]
        level = np.cumsum(rng.random(n) < 1.0 / 600.0) % 2
        return np.asarray(0.6 * (level - 0.5))

    found = diagnose(_runs(rng, telegraph), nominal).rate
    assert found.unknown_probability > 0.9
    assert not found.causes
    assert {part.follows for part in found.unknown_parts} == {"the repeat"}
    assert "steps in one repeat" in found.unknown_parts[0].sentence

    def walk(s: object, profile: str, repeat: int) -> np.ndarray:
        return np.asarray(np.cumsum(rng.normal(0.0, 0.2 / 60.0, len(s))))  # type: ignore[arg-type]

    found = diagnose(_runs(rng, walk), nominal).rate
    assert "rate_random_walk" in found.stochastic
    assert found.unknown_probability < 0.5


def test_a_cause_that_held_out_runs_do_not_show_is_not_named(nominal: Model) -> None:
    """The diagnosed runs warm up, the held-out one does not: the name belongs to the diagnosed runs alone."""
    rng = np.random.default_rng(11)

    def warm_up(s: object, profile: str, repeat: int) -> np.ndarray:
        amplitude = 0.0 if repeat == 2 else 2.0
        return np.asarray(amplitude * np.exp(-s.time_s / 900.0))  # type: ignore[attr-defined]

    runs = _runs(rng, warm_up)
    kept, judges = (
        [r for r in runs if not r.run_id.endswith("2")],
        [r for r in runs if r.run_id.endswith("2")],
    )
    assert "warm_up" in {cause.name for cause in diagnose(kept, nominal).rate.causes}
    found = diagnose(kept, nominal, judges).rate
    assert not found.causes
    assert "warm_up" in {cause.name for cause in found.resembles}
    assert any("held-out" in text for text in found.warnings)
    assert abs(found.held["warm_up"]) < 0.2  # as much of it as there is there


def test_of_a_cause_it_is_told_how_much_of_it_held_out_runs_show(nominal: Model) -> None:
    """All of it in a run that warms up as the others did; nothing follows from one that begins hours later."""
    rng = np.random.default_rng(12)

    def warm_up(s: object, profile: str, repeat: int) -> np.ndarray:
        return np.asarray(2.0 * np.exp(-s.time_s / 900.0))  # type: ignore[attr-defined]

    runs = _runs(rng, warm_up)
    kept = [run for run in runs if not run.run_id.endswith("2")]
    (same,) = (run for run in runs if run.run_id == "long 2")
    assert diagnose(kept, nominal, [same]).rate.held["warm_up"] == pytest.approx(1.0, abs=0.1)
    s = stimulus(4000)
    later = made_run("later", replace(s, time_s=s.time_s + 20_000.0), rng, np.zeros(len(s)), profile="short")
    bare = Model("without parameters that could be another beside the warm-up", (), nominal.noise)
    found = diagnose(kept, bare, [later]).rate
    assert [cause.name for cause in found.causes] == ["warm_up"] and np.isnan(found.held["warm_up"])


def _frost(s: object, profile: str, repeat: int) -> np.ndarray:
    """Frost dries off while the gyro warms through some kelvins: one temperature alone does not say so."""
    warm_k, warming = s.warm_k, s.warming_k_per_min  # type: ignore[attr-defined]
    return np.asarray(3.0 * np.exp(-0.5 * ((warm_k + 20.0) / 5.0) ** 2) * np.tanh(warming / 0.3))


def _stretched(s: object, profile: str, repeat: int) -> np.ndarray:
    """Damage by the speed of change, whichever way, some minutes late."""
    late = s.lagged(s.warming_k_per_min, 90.0)  # type: ignore[attr-defined]
    return np.asarray(2.0 * np.sqrt(np.abs(late) + 0.01))


@pytest.mark.parametrize("hidden", [_frost, _stretched])
def test_what_two_inputs_do_together_or_late_is_closed_on_a_profile_that_no_fit_saw(
    hidden: object, nominal: Model
) -> None:
    found = diagnose(_runs(np.random.default_rng(7), hidden), nominal)
    learned = found.rate.learned
    assert learned is not None
    assert learned.terms
    closed = closed_model(found)
    s = stimulus(12000)
    true = hidden(s, "", 0)  # type: ignore[operator]
    left = true - (closed.predict(s) - found.model.predict(s))
    assert np.std(left) < 0.5 * np.std(true)


def test_the_response_to_changes_of_rate_is_what_a_hat_about_each_delay_makes_of_them() -> None:
    """Against the sum over the rate's own steps: a hat of half width 4 s about 0, 4, 8 and 12 s."""
    n, period_s = 200, 0.5
    rate = np.repeat([0.0, 6.0, -2.0, 0.0], 50)
    angle = np.concatenate(([0.0], np.cumsum(rate * period_s)))
    room = np.full(n, 25.0)
    s = Stimulus(period_s * np.arange(1, n + 1), room, room, angle, np.full(n, 90.0), 45.0, period_s)
    delays = (0.0, 4.0, 8.0, 12.0)
    shape = learned_shape(delays)
    columns = FORMS["response to changes of rate"].effect(shape).columns(s, shape)
    fine_s = (np.arange(20 * n) + 0.5) * period_s / 20.0
    for delay, column in zip(delays, columns, strict=True):
        steps = ((25.0, 6.0), (50.0, -8.0), (75.0, 2.0))
        hats = [step * np.maximum(1.0 - np.abs(fine_s - at - delay) / 4.0, 0.0) for at, step in steps]
        assert column == pytest.approx(np.sum(hats, axis=0).reshape(n, 20).mean(axis=1), abs=0.02)


SHAPES = {
    "bias over T_in": learned_shape((-70.0, -50.0, -30.0, -10.0, 5.0)),
    "bias over late T_in": learned_shape((-70.0, -40.0, -20.0, 5.0)),
    "bias over T_out": learned_shape((-70.0, -40.0, 5.0), late_s=300.0),
    "bias over T_in and dT_in/dt": learned_shape((-70.0, -30.0, 5.0), (-3.0, -1.0, 0.0, 2.0), 200.0),
    "memory of T_in": learned_shape((200.0, 600.0, 2000.0)),
    "memory of T_out": learned_shape((200.0, 2000.0)),
    "loops of T_in": learned_shape((5.0, 20.0)),
    "scale factor over T_in": learned_shape((-70.0, -30.0, 5.0)),
    "scale factor over T_in - T_out": learned_shape((-10.0, 0.0, 10.0)),
    "scale factor's memory of T_in": learned_shape((600.0,)),
    "time since power-on": learned_shape((300.0, 3000.0)),
}


def test_a_curve_over_the_rate_goes_on_between_the_rates_that_were_run() -> None:
    """Turns at 5, 10, 20 and 40 deg/s; asked at 15 and 30, where no run has been."""

    def turned(rates_dps: Sequence[float], n: int = 3600) -> Stimulus:
        rate = np.repeat(rates_dps, n // len(rates_dps)).astype(float)
        angle = np.concatenate(([10.0], 10.0 + np.cumsum(rate)))
        return replace(stimulus(len(rate), cold=False), angle_deg=angle)

    def hidden(s: Stimulus) -> np.ndarray:
        part = s.axis_rate_dps / 40.0
        return np.asarray(9.0 * part**2 * (1.0 + 0.5 * part))

    rng = np.random.default_rng(4)
    up = (0.0, 5.0, 10.0, 20.0, 40.0, 0.0, -5.0, -10.0, -20.0, -40.0)
    runs = [
        made_run(f"{profile} {repeat}", s, rng, hidden(s), profile=profile)
        for profile, rates in (("up", up), ("down", up[::-1]), ("mixed", (*up[::3], *up[1::3], *up[2::3])))
        for repeat in range(2)
        if (s := turned(rates))
    ]
    model = Model("m", (), Noise(0.004))
    found = learned(prepare(runs, model, []), model, [])
    assert "learned: bias over rate" in [term.variant.effect.name for term in found.terms]
    asked = turned((15.0, 30.0, -15.0, -30.0))
    off = replace(model, terms=found.terms).predict(asked) - model.predict(asked) - hidden(asked)
    assert np.std(off) < 0.2 * np.std(hidden(asked))


@pytest.mark.parametrize("name", SHAPES)
def test_a_plant_executes_a_learned_form_as_the_diagnosis_does(name: str) -> None:
    """By the second, knowing the past only, within the smoothing of a minute that the diagnosis has beside."""
    s = stimulus(9000)
    shape = SHAPES[name]
    variant = Variant(FORMS[name].effect(shape), shape)
    values = [1.0 + 0.5 * number for number in range(len(variant.effect.parameters))]
    step = variant.stepper(values)
    executed = np.array([step(float(t), float(o)) for t, o in zip(s.t_in_c, s.t_out_c, strict=True)])
    expected = np.asarray(values) @ variant.columns(s)
    if variant.effect.unit == PPM:
        expected = expected * 1e6 / s.input_rate_dph
    assert np.std(executed - expected) < 0.08 * np.std(expected)


def test_what_suits_most_repeats_and_harms_one_is_not_learned(nominal: Model) -> None:
    """A wave over temperature in four repeats of five; the fifth of each profile is free of it."""
    rng = np.random.default_rng(9)
    runs = []
    for profile, n in PROFILES.items():
        for repeat in range(5):
            s = stimulus(n)
            added = _fringes(s, profile, repeat) * (repeat < 4)
            runs.append(made_run(f"{profile} {repeat}", s, rng, added, profile=profile))
    learned = diagnose(runs, nominal).rate.learned
    assert learned is not None and not learned.terms
    assert learned.reason.endswith("4 further away")
