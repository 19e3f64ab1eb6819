"""The smooth form: its columns by hand, its promises on ring lasers of other physics, the choice, the file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from scipy.stats import t as student

from bench.analysis.common.state_file import read_state, write_state
from bench.analysis.common.statistics import attained
from bench.analysis.compensations import load_compensation
from bench.analysis.rlg import RampRun, RlgCompensation, _choice
from bench.analysis.rlg._basis import LAGS_S, OWN_SHARES, Basis, _cosines, _slack, lagged, own_columns
from bench.analysis.rlg._choice import EQUATION, MEAN, SMOOTH, Choice, choose_form
from bench.analysis.rlg._smooth import SmoothForm, fit_smooth
from bench.analysis.rlg._study import RlgStudy, run_rlg_study
from bench.present.report import (
    choice_sentence,
    expected_sentence,
    render_page,
    stepwise_page,
    stepwise_units_page,
)
from benchmarks.off_class._ring_lasers import FAMILIES, limits_pct, unit_runs
from drivers.base.errors import ConfigurationError, RecordError

Runs = Callable[[int], dict[str, RampRun]]
KINDS = ("train", "repeat", "reverse", "repeat", "faster", "partial")


@pytest.fixture(scope="module")
def backscatter() -> tuple[list[RampRun], RlgStudy]:
    """Six runs of a unit of another physics at a spread of 10 %, and the study of the first three on the rest."""
    runs = unit_runs(FAMILIES["backscatter"], 1, 0.10, KINDS)
    return runs, run_rlg_study(runs[:3], runs[3:])


def test_lags_follow_an_exponential_step_and_a_straight_ramp_at_uneven_times() -> None:
    times = np.cumsum([0.0, 100.0, 100.0, 400.0, 100.0, 50.0])
    ramp = lagged(times, 2.0 * times, (300.0, 5000.0))
    for column, tau in zip(ramp.T, (300.0, 5000.0), strict=True):
        assert column == pytest.approx(2.0 * (times - tau * (1.0 - np.exp(-times / tau))))
    level = lagged(times, np.full(6, 7.0), (300.0,))
    assert level == pytest.approx(np.full((6, 1), 7.0))


def test_a_cosine_is_averaged_over_the_row_that_a_ramp_makes() -> None:
    low, high, rate = -50.0, 75.0, 1.2
    found = _cosines(np.array([10.0, 10.0]), np.array([rate, 0.0]), low, high)
    half = 0.5 * rate * 100.0 / 60.0
    for order in (1, 7, 40):

        def wave(temp: float, order: int = order) -> float:
            return float(np.cos(np.pi * order * (temp - low) / (high - low)))

        assert found[0, order - 1] == pytest.approx(quad(wave, 10.0 - half, 10.0 + half)[0] / (2 * half))
        assert found[1, order - 1] == pytest.approx(wave(10.0))


def test_a_joint_holds_until_its_play_is_taken_up() -> None:
    assert _slack(np.array([0.0, 1.0, 3.0, 2.0, 0.0, -5.0]), 2.0).tolist() == [0.0, 0.5, 1.0, 0.5, -0.5, -1.0]


def test_columns_are_of_the_fitted_runs_and_return_from_a_state(backscatter) -> None:
    runs, _ = backscatter
    basis = Basis.of(runs[:3], one_temperature=False)
    every = np.concatenate([basis.matrix(run) for run in runs[:3]])
    assert np.abs(every.mean(axis=0)).max() < 1e-9
    assert basis.shares().shape == (10, every.shape[1]) and (basis.shares().sum(axis=0) > 0).all()
    restored = Basis.from_state(basis.to_state())
    assert np.array_equal(restored.matrix(runs[4]), basis.matrix(runs[4]))
    # the drives are scaled to one: T1 - T2 and what lags T1 by the first time constant, by hand
    drives = [run.case_c - run.block_c for run in runs[:3]]
    size = np.sqrt(np.mean(np.concatenate(drives) ** 2))
    behind = [run.block_c - lagged(run.time_s, run.case_c, LAGS_S[:1])[:, 0] for run in runs[:3]]
    for values, divisor in ((drives, size), (behind, np.sqrt(np.mean(np.concatenate(behind) ** 2)))):
        own = values[0] / divisor - np.mean(np.concatenate(values) / divisor)
        assert np.abs(basis.matrix(runs[0]) - own[:, None]).max(axis=0).min() < 1e-9
    single = Basis.of(runs[:3], one_temperature=True)
    elsewhere = replace(runs[4], block_c=runs[4].block_c + 99.0)
    assert np.array_equal(single.matrix(elsewhere), single.matrix(runs[4]))
    state = basis.to_state()
    for wrong in ({"scales": [1.0]}, {"kept": state["kept"][::-1]}, {"case_range_c": [5.0, 5.0]}):
        with pytest.raises(ValueError, match="none"):
            Basis.from_state(state | wrong)


def test_part_of_a_run_does_not_join_what_a_gap_parts() -> None:
    rows = np.arange(6.0)
    run = RampRun("r", "u", rows, *[rows] * 5, np.array([0, 0, 0, 1, 1, 1]), true_bias_dph=rows)
    part = run.part(np.array([True, False, True, True, True, False]))
    assert part.time_s.tolist() == [0.0, 2.0, 3.0, 4.0] and part.segment.tolist() == [0, 1, 2, 2]
    assert part.true_bias_dph is not None and part.true_bias_dph.tolist() == [0.0, 2.0, 3.0, 4.0]


def test_another_physics_is_followed_where_the_equation_is_not(backscatter) -> None:
    _, study = backscatter
    assert study.choice.taken == SMOOTH and study.chosen.name == SMOOTH
    share, equation = (attained(way.judged)[1] for way in (study.chosen, study.equation))
    limit = (
        100.0
        * np.mean(limits_pct(FAMILIES["backscatter"], 1, 0.10, KINDS, 3))
        / attained(study.chosen.judged)[0]
    )
    assert share > 85.0 > 50.0 > equation
    assert share == pytest.approx(limit, abs=5.0)
    assert np.mean([row.inside for row in study.chosen.judged]) > 0.85
    assert study.spread.low_pct < study.spread.pct < study.spread.high_pct
    expected = [row.improvement_pct for row in study.outlook]
    assert expected == sorted(expected) and [row.more_runs for row in study.outlook] == [0, 1, 2, 4, np.inf]
    low, high = study.promise.low_pct, study.promise.high_pct
    assert low < study.promise.middle_pct < high
    assert all(row.promise.low_pct <= row.improvement_pct for row in study.chosen.judged)


def test_what_a_run_left_out_says_is_computed_again(backscatter) -> None:
    runs, study = backscatter
    form = fit_smooth([runs[0], runs[2]], one_temperature=False).form
    left = runs[1].bias_dph - form.drift_dph(runs[1])
    assert study.choice.left_out[1] == runs[1].run_id
    assert study.choice.errors[SMOOTH][1] == pytest.approx(left.std() / runs[1].bias_dph.std(), rel=1e-6)


def test_an_interval_adds_up_what_few_runs_tell_and_what_is_known(backscatter) -> None:
    runs, _ = backscatter
    basis = Basis.of(runs[:3], one_temperature=False)
    count = len(basis.kept)
    doubt, apart = np.zeros((1, count)), np.zeros((1, count))
    own = np.zeros(OWN_SHARES.shape[1])
    own[0] = 4.0
    form = SmoothForm(basis, np.zeros(count), 1.0, doubt, apart, own, 9.0, 3)
    # offset: 4 (3 + 1) / (3 - 1) with two degrees of freedom, noise 9 and (1 - 3)^2 known
    few, many = student.ppf(0.975, 2), norm.ppf(0.975)
    half = form.half_width_dph(runs[3], np.full(len(runs[3].time_s), 3.0))
    assert half == pytest.approx(np.full(len(half), np.sqrt(few**2 * 8.0 + many**2 * 13.0)))
    apart[0, 3], doubt[0, 5] = 0.7, 0.2
    columns = basis.matrix(runs[3])
    whole = 8.0 + (0.7 * columns[:, 3]) ** 2 + (0.2 * columns[:, 5]) ** 2
    found = replace(form, apart=apart, doubt=doubt).half_width_dph(runs[3], np.full(len(columns), 1.0))
    assert found == pytest.approx(np.sqrt(few**2 * whole + many**2 * 9.0))
    column = columns[:, 3]
    with pytest.raises(ConfigurationError, match="one run says nothing"):
        replace(form, runs=1).promise(runs[3], column)


def test_a_promise_is_that_of_runs_drawn_from_the_form(backscatter) -> None:
    """Noise alone on a known drift: what is left is the noise, as 1 - s / sqrt(s^2 + d^2) says."""
    runs, _ = backscatter
    basis = Basis.of(runs[:3], one_temperature=False)
    coefficients = np.zeros(len(basis.kept))
    coefficients[0] = 2.0
    nothing = np.zeros((1, len(coefficients)))
    form = SmoothForm(basis, coefficients, 5.0, nothing, nothing, np.zeros(OWN_SHARES.shape[1]), 0.25, 3)
    drift = form.drift_dph(runs[0])
    promise = form.promise(runs[0], drift)
    expected = 100.0 * (1.0 - 0.5 / np.hypot(0.5, drift.std()))
    assert promise.middle_pct == pytest.approx(expected, abs=0.5)
    assert promise.high_pct - promise.low_pct < 6.0
    # a whole offset known or not changes no stability; nothing subtracted improves nothing
    assert form.promise(runs[0], drift + 9.0) == promise
    assert form.promise(runs[0], 0.0 * drift).middle_pct == pytest.approx(0.0, abs=1e-9)


def test_own_columns_are_an_offset_and_waves_over_the_run(backscatter) -> None:
    columns = own_columns(backscatter[0][0])
    assert columns.shape[1] == OWN_SHARES.shape[1] and (columns[:, 0] == 1.0).all()
    assert columns[0] == pytest.approx(1.0) and columns[-1] == pytest.approx((-1.0) ** np.arange(11))


def test_the_equation_stays_where_it_is_the_truth(runs: Runs) -> None:
    """A bias made of three of the eleven variables, one run: quarters of it are left out."""
    base = runs(0)["train"]
    rng = np.random.default_rng(0)
    made = -3e-4 * base.case_c + 0.03 * base.case_rate + rng.normal(0, 1e-3, len(base.time_s))
    study = run_rlg_study([replace(base, bias_dph=made)], [])
    assert study.choice.left_out == tuple(f"quarter {n}" for n in (1, 2, 3, 4))
    assert study.choice.taken == EQUATION and study.chosen is study.equation
    assert study.spread is None and study.promise is None and study.outlook == ()
    with pytest.raises(ConfigurationError, match="no interval"):
        study.chosen.compensation.half_width_dph(base)
    assert "nothing is promised" in expected_sentence(study)


@pytest.mark.parametrize(
    ("equation", "smooth", "taken"),
    [
        (1.0, 2.0, EQUATION),
        (2.0, 1.0, SMOOTH),
        (1.0, 1.0, MEAN),
    ],
)
def test_one_of_two_that_is_tied_is_taken_else_their_mean(
    monkeypatch, backscatter, equation, smooth, taken
) -> None:
    """What both leave is a wave of a size of its own, in quadrature; alike, they are tied."""
    runs = backscatter[0][:3]

    def made(size: float, shape: Callable[[np.ndarray], np.ndarray]) -> object:
        class Form:
            def drift_dph(self, run: RampRun) -> np.ndarray:
                return run.bias_dph - 1e-3 * size * shape(run.time_s / 900.0)

        return Form()

    monkeypatch.setattr(_choice, "fit_smooth", lambda *_, **__: type("F", (), {"form": made(smooth, np.sin)}))
    # the mean of two in phase is between them: tied with the better one only where they are alike
    found = choose_form(runs, lambda _: made(equation, np.sin), one_temperature=False)  # type: ignore[arg-type]
    assert found.taken == taken
    sizes = {name: np.mean(errors) for name, errors in found.errors.items()}
    assert sizes[EQUATION] / sizes[SMOOTH] == pytest.approx(equation / smooth)
    assert sizes[MEAN] == pytest.approx(0.5 * (sizes[EQUATION] + sizes[SMOOTH]))


def test_runs_of_which_nothing_can_be_left_out_get_the_equation_and_say_so(runs: Runs) -> None:
    """Seven rows for three variables: enough to fit, too few with a quarter left out."""
    train = runs(0)["train"]
    run = train.part(np.isin(np.arange(len(train.time_s)), range(40, 47)))
    study = run_rlg_study([run], [], ("T1", "T2", "dT1"))
    assert len(run.time_s) == 7 and study.choice.taken == EQUATION
    assert "too few rows" in study.choice.failed and "too few rows" in choice_sentence(study)


def test_the_file_of_a_smooth_form_is_read_back_and_what_is_none_refused(backscatter, tmp_path: Path) -> None:
    runs, study = backscatter
    path = tmp_path / "c.gyrocomp"
    made = study.chosen.compensation
    made.save(path)
    loaded = load_compensation(path)
    assert isinstance(loaded, RlgCompensation) and read_state(path)["format"] == 2
    for run in runs[3:]:
        assert np.array_equal(loaded.drift_dph(run), made.drift_dph(run))
        assert np.array_equal(loaded.half_width_dph(run), made.half_width_dph(run))
    assert loaded.promise(runs[4]) == study.chosen.judged[1].promise
    assert path.stat().st_size < 500_000
    with pytest.raises(ConfigurationError, match="another unit"):
        loaded.drift_dph(replace(runs[3], unit_id="other"))
    state = read_state(path)
    wrong = {
        "a share": state | {"smooth_share": 1.5},
        "a form": {key: value for key, value in state.items() if key != "smooth"},
        "coefficients": state | {"smooth": state["smooth"] | {"coefficients": np.zeros(3)}},
        "variances": state | {"smooth": state["smooth"] | {"noise": -1.0}},
    }
    for content in wrong.values():
        write_state(tmp_path / "x", content)
        with pytest.raises(RecordError, match="not a readable"):
            load_compensation(tmp_path / "x")
    # half of each is the mean of both
    mean = replace(made, smooth_share=0.5).drift_dph(runs[3])
    assert mean == pytest.approx(
        0.5 * (made.drift_dph(runs[3]) + replace(made, smooth_share=0.0).drift_dph(runs[3]))
    )


def test_pages_of_a_unit_and_of_several_have_what_the_study_says(backscatter, runs: Runs) -> None:
    _, study = backscatter
    page = render_page(stepwise_page(study, created_utc="2026-01-02T03:04:05.000+00:00"))
    told = study.chosen.judged[1]
    assert f"{told.promise.low_pct:.1f} to {told.promise.high_pct:.1f}" in page
    assert f"{study.outlook[2].improvement_pct:.1f}" in page and "no end of runs" in page
    assert (
        f"{100 * study.choice.errors[SMOOTH][0]:.1f}" in page
        and f"{study.spread.pct:.0f} % of the drift" in page
    )
    assert "Output over temperature" in page and "Gradient" in page
    other = run_rlg_study([runs(0)["train"]], [runs(0)["repeat"]])
    both = {"RLG-1": study, "RLG-0": other}
    page = render_page(stepwise_units_page(both, created_utc="2026-01-02T03:04:05.000+00:00"))
    for one in both.values():
        assert f">{one.chosen.mean_improvement_pct:.1f}<" in page and f">{one.chosen.name}<" in page
    assert page.count("<svg") == 2


def test_a_choice_knows_its_names() -> None:
    assert Choice(MEAN, {}, ()).failed == ""
