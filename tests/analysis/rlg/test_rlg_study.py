"""The ring laser's regression: rows, variables, improvement on held-out runs, the file, bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import statsmodels.api as sm

from bench.analysis.common.state_file import write_state
from bench.analysis.common.statistics import attained
from bench.analysis.rlg import CANDIDATES, RampRun, RlgCompensation
from bench.analysis.rlg._rows import ramp_run
from bench.analysis.rlg._study import CORRECTED, FIVE, PLAIN, run_rlg_study
from bench.analysis.rlg._variables import FIVE_TERMS, candidate_matrix
from drivers.base.errors import ConfigurationError, RecordError

Runs = Callable[[int], dict[str, RampRun]]
HELD_OUT = ("repeat", "reverse", "faster", "partial")


def series(count: int = 5000) -> dict[str, np.ndarray]:
    time = np.arange(1.0, count + 1.0)
    return {"time_s": time, "case_c": -40 + time / 180, "block_c": -42 + time / 180, "bias_dph": 1e-3 * time}


def test_rows_are_means_and_slopes_of_a_hundred_seconds() -> None:
    run = ramp_run("r", "u", **series())
    assert len(run.time_s) == 50 and run.time_s[0] == 50.5
    assert np.allclose(run.case_rate, 1 / 3) and np.allclose(run.block_rate, 1 / 3)
    assert np.allclose(run.case_c, -40 + run.time_s / 180) and np.allclose(run.bias_dph, 1e-3 * run.time_s)
    assert (run.segment == 0).all() and run.remarks == ()


def test_missing_seconds_do_not_bend_a_slope_and_missing_rows_are_named() -> None:
    data = series()
    data["case_c"][10:40] = np.nan
    data["bias_dph"][700:790] = np.nan
    run = ramp_run("r", "u", **data)
    assert run.case_rate[0] == pytest.approx(1 / 3)
    assert len(run.time_s) == 49 and 750.5 not in run.time_s
    assert run.remarks == ("1 of 50 rows left out: bias is missing in them",)
    assert run.segment.tolist() == [0] * 7 + [1] * 42


def test_a_stalled_ramp_is_named() -> None:
    data = series(12_000)
    data["case_c"][6000:9000] = data["case_c"][6000]
    assert ramp_run("r", "u", **data, ramps=[(0.0, 12_000.0)]).remarks == (
        "the ramp stalled from 6050 s for 50 min: these rows are kept, their rate is that of a dwell",
    )
    assert ramp_run("r", "u", **series(12_000), ramps=[(0.0, 12_000.0)]).remarks == ()


def test_empty_runs_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="hardly any rows"):
        ramp_run("r", "u", **series() | {"bias_dph": np.full(5000, np.nan)})


def test_variables_are_what_their_names_say() -> None:
    run = ramp_run("r", "u", **series())
    x = candidate_matrix([run], CANDIDATES)
    t1, t2, rate = run.case_c, run.block_c, 1 / 3
    by_hand = [t1, t2, rate, rate, t1 * rate, t2 * rate, rate**2, rate**2, t1**2, t2**2, 2.0]
    assert np.allclose(x, np.column_stack([np.broadcast_to(column, t1.shape) for column in by_hand]))
    for names, found in ((["T1", "T3"], "T3"), (["T1", "T2", "T1"], "T1, T2, T1"), ([], "no variable")):
        with pytest.raises(ConfigurationError, match="cannot be used") as refused:
            candidate_matrix([run], names)
        assert refused.value.found == found


@pytest.mark.parametrize("unit_seed", [0, 1, 2])
def test_every_unit_improves_on_runs_it_was_not_fitted_on(runs: Runs, unit_seed: int) -> None:
    of = runs(unit_seed)
    study = run_rlg_study([of["train"]], [of[kind] for kind in HELD_OUT])
    for variant in study.variants:
        rows = variant.judged
        assert [row.kind for row in rows] == list(HELD_OUT)
        assert np.mean([row.improvement_pct for row in rows]) >= 65.0  # the paper's figure
        assert min(row.improvement_pct for row in rows) > 60.0
    best = max(study.variants, key=lambda variant: variant.mean_improvement_pct)
    assert attained(best.judged)[1] >= 95.0
    assert all(row.improvement_pct < 1.01 * row.oracle_pct for row in best.judged)


def test_improvement_is_recomputed_from_scratch(runs: Runs) -> None:
    of = runs(0)
    study = run_rlg_study([of["train"]], [of["reverse"]])
    five = study.variant(FIVE)
    train, test = of["train"], of["reverse"]
    design = np.column_stack([np.ones(len(train.time_s)), candidate_matrix([train], FIVE_TERMS)])
    solution = np.linalg.lstsq(design, train.bias_dph, rcond=None)[0]
    left = (
        test.bias_dph
        - np.column_stack([np.ones(len(test.time_s)), candidate_matrix([test], FIVE_TERMS)]) @ solution
    )
    assert five.compensation.intercept_dph == pytest.approx(solution[0], rel=1e-6)
    assert five.judged[0].after_dph == pytest.approx(np.std(left, ddof=1), rel=1e-9)
    assert five.judged[0].before_dph == pytest.approx(np.std(test.bias_dph, ddof=1), rel=1e-12)


def test_nonsense_is_left_out_and_what_made_the_bias_is_found(runs: Runs) -> None:
    base = runs(0)["train"]
    rng = np.random.default_rng(0)
    made = -3e-4 * base.case_c + 0.03 * base.case_rate + rng.normal(0, 1e-3, len(base.time_s))
    run = replace(base, bias_dph=made)
    study = run_rlg_study([run], [])
    fit = study.variant(PLAIN).compensation
    assert {"T1", "dT1"} <= set(fit.variables) and len(fit.variables) <= 4
    assert fit.coefficients[fit.variables.index("dT1")] == pytest.approx(0.03, rel=0.15)
    assert study.variant(CORRECTED).result.n == len(run.time_s) - 1


def test_a_dead_channel_and_a_sum_are_left_out_with_a_reason(runs: Runs) -> None:
    base = runs(0)["train"]
    dead = replace(base, block_c=np.full_like(base.block_c, 20.0), block_rate=np.zeros_like(base.block_rate))
    study = run_rlg_study([dead], [])
    reasons = dict(study.left_out)
    assert {"T2", "dT2", "T2*dT2", "dT2^2", "T2^2"} <= set(reasons)
    assert "so alike" in reasons[FIVE]
    assert "constant" in reasons["T2"]
    # T1 - T2 is then T1 less a constant: equally good, so the first of the two is taken, whatever rounding says
    assert "adds nothing" in reasons["T1-T2"] and "T1" in study.variant(PLAIN).result.selected


def test_one_temperature_recorded_twice_is_noticed(runs: Runs) -> None:
    """Also in another unit and rounded to float32, as an import leaves it; two real temperatures are two."""
    made = runs(1)
    for twin in (lambda t: t, lambda t: (1.8 * t + 32.0).astype(np.float32).astype(float)):
        same = [replace(run, block_c=twin(run.case_c), block_rate=run.case_rate) for run in (made["train"],)]
        study = run_rlg_study(same, [])
        left = dict(study.left_out)
        assert {name for name in CANDIDATES if "T2" in name} <= set(left)
        assert "one temperature was recorded" in left["T1-T2"]
        assert not any("T2" in name for name in study.chosen.compensation.variables)
    assert not any("one temperature" in why for _, why in run_rlg_study([made["train"]], []).left_out)


def test_what_cannot_be_fitted_is_refused(runs: Runs) -> None:
    train = runs(0)["train"]
    short = ramp_run("short", "RLG-0", **series(1000))
    short = replace(short, case_rate=np.random.default_rng(1).normal(size=10), block_rate=np.arange(10.0))
    short = replace(short, block_c=np.arange(10.0) ** 2)
    with pytest.raises(ConfigurationError, match="too few rows"):
        run_rlg_study([short], [])
    with pytest.raises(ConfigurationError, match="of one unit"):
        run_rlg_study([train], [runs(1)["repeat"]])
    with pytest.raises(ConfigurationError, match="fitting and for judging"):
        run_rlg_study([train], [train])


def test_the_file_returns_what_was_written_and_notices_a_change(runs: Runs, tmp_path: Path) -> None:
    of = runs(0)
    fit = run_rlg_study([of["train"]], [of["repeat"]]).variant(PLAIN).compensation
    path = tmp_path / "rlg.gyrocomp"
    fit.save(path)
    loaded = RlgCompensation.load(path)
    assert loaded == fit and np.array_equal(loaded.drift_dph(of["repeat"]), fit.drift_dph(of["repeat"]))
    assert fit.equation().startswith("B = ") and all(name in fit.equation() for name in fit.variables)
    content = path.read_bytes()
    path.write_bytes(content[:200] + bytes([content[200] ^ 1]) + content[201:])
    with pytest.raises(RecordError, match="not a readable"):
        RlgCompensation.load(path)
    write_state(path, {"kind": "whirl", "format": 1})
    with pytest.raises(RecordError, match="whirl, format 1"):
        RlgCompensation.load(path)


def test_another_units_compensation_is_refused_and_foreign_conditions_counted(runs: Runs) -> None:
    of = runs(0)
    fit = run_rlg_study([of["train"]], []).variant(PLAIN).compensation
    with pytest.raises(ConfigurationError, match="another unit"):
        fit.drift_dph(runs(1)["repeat"])
    assert fit.outside(of["partial"]).mean() < 0.02  # rates at rest scatter about their own extremes
    assert fit.outside(of["faster"]).mean() > 0.3


def with_a_sum(seed: int) -> RampRun:
    """Thirty rows whose bias follows T1 and T2; dT2 is nearly their sum and enters first."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(30, 4))
    x[:, 3] = x[:, 0] + x[:, 1] + rng.normal(0.0, 0.8, 30)
    bias = 0.6 * x[:, 0] + 0.6 * x[:, 1] + 0.1 * x[:, 3] + rng.normal(size=30)
    return RampRun("r", "u", 100.0 * np.arange(30), *x.T, bias, np.zeros(30, np.int64))


@pytest.mark.parametrize(("seed", "least", "most"), [(133, 0.07, 0.10), (37, 0.10, 0.14)])
def test_what_both_temperatures_explain_leaves_from_a_p_value_of_a_tenth_on(
    seed: int, least: float, most: float
) -> None:
    """The p-value of dT2 beside T1 and T2 by statsmodels; the runs were chosen for one near a tenth."""
    run = with_a_sum(seed)
    three = sm.add_constant(np.column_stack([run.case_c, run.block_c, run.block_rate]))
    p_value = sm.OLS(run.bias_dph, three).fit().pvalues[3]
    assert least < p_value < most
    plain = run_rlg_study([run], [], ("T1", "T2", "dT1", "dT2")).variant(PLAIN).result
    assert plain.steps[1].term == "dT2" and plain.steps[1].p < 0.05
    assert set(plain.selected) == ({"T1", "T2", "dT2"} if p_value <= 0.10 else {"T1", "T2"})
