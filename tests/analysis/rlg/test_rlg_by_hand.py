"""Parts of the ring laser's study by hand: turns, terms, verdicts, stalls, profiles, hysteresis, variables."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.common.compensation import UnitMismatch, provenance
from bench.analysis.common.stepwise import stepwise
from bench.analysis.rlg import CANDIDATES, RampRun, RlgCompensation
from bench.analysis.rlg._cycle import AxisGain, Spread, _sound_rows, _terms, _turns, study_chamber_cycle
from bench.analysis.rlg._dataset import _lost, _text
from bench.analysis.rlg._judge import (
    ANOTHER_DAY,
    RampProfile,
    how_it_differs,
    hysteresis_dph,
    judge,
    profile_of,
)
from bench.analysis.rlg._rows import _slope_per_min, _stalls, ramp_run
from bench.analysis.rlg._study import (
    StepwiseVariant,
    _collinear,
    _compensation,
    _one_column,
    _segments,
    _usable,
)
from bench.analysis.rlg._variables import candidate_matrix
from drivers.base.errors import ConfigurationError, RecordError


def test_temperature_turns_where_it_comes_back_by_more_than_ten_degrees():
    up_and_down = np.concatenate((np.linspace(20, 60, 41), np.linspace(59, -30, 90), np.linspace(-29, 0, 30)))
    assert _turns(up_and_down) == [40, 130]
    assert _turns(-up_and_down) == [40, 130]
    # nine degrees back are no turn, eleven are; the top is the last of those as warm
    ripple = np.concatenate(
        (np.linspace(0, 30, 31), np.linspace(29, 21, 9), np.linspace(22, 40, 19), [40.0, 28.9])
    )
    assert _turns(ripple) == [59]
    assert _turns(np.linspace(0, 10, 11)) == [] and _turns(np.array([0.0, 9.0, -9.0, 9.0])) == []
    assert (
        _turns(np.array([0.0, 11.0, 0.9, 12.0])) == [1, 2] and _turns(np.array([0.0, 11.0, 1.0, 12.0])) == []
    )


def test_terms_of_a_cycle_are_powers_the_rate_and_what_lags_by_twelve_means():
    temp = np.array([3.0, 5.0, 9.0, 9.0, 1.0])
    static, dynamic = _terms(temp)
    assert static.tolist() == [[t, t**2, t**3] for t in temp]
    rate = [2.0, 3.0, 2.0, -4.0, -8.0]
    lagged = [3.0]
    for value in temp[1:]:
        lagged.append(lagged[-1] + (value - lagged[-1]) / 12.0)
    assert dynamic[:, :3].tolist() == static.tolist() and dynamic[:, 3].tolist() == rate
    assert dynamic[:, 4] == pytest.approx(temp * rate) and dynamic[:, 5] == pytest.approx(temp - lagged)


def gain(static, dynamic, *, terms=(), one_way=False, rms=None):
    before, none = Spread(10.0, 10.0), np.zeros(3)
    parts = [Spread(own, own if rms is None else rms) for own in (static, dynamic)]
    return AxisGain("x", before, *parts, ("T",), ("T", *terms), none, none, none, one_way)


def test_verdicts_on_an_axis():
    leave = "hardly reproducible: leave it uncompensated"
    assert gain(8.1, 8.1).verdict == leave and not gain(8.1, 8.1).gains
    assert gain(7.9, 9.9).gains and gain(9.9, 7.9).gains and gain(8.0, 9.0).best_pct == pytest.approx(20.0)
    assert gain(7.0, 6.0).static_pct == pytest.approx(30.0) and gain(7.0, 6.0).dynamic_pct == pytest.approx(
        40.0
    )
    assert gain(5.0, 5.0).verdict == "follows temperature in part; rate and past explain nothing more"
    assert gain(1.9, 5.0).verdict == "follows temperature; rate and past explain nothing more"
    assert gain(5.0, 5.0, one_way=True).verdict.endswith("; one leg tells nothing of rate and past")
    assert (
        gain(5.0, 4.0, terms=("dT", "lag T")).verdict
        == "depends on the temperature's past or rate (dT, lag T)"
    )
    # five per cent more are no dependence, nor are terms of temperature alone
    assert gain(5.0, 4.6, terms=("dT",)).verdict.startswith("follows temperature in part")
    assert gain(5.0, 2.0, terms=("T^2",)).verdict.startswith("follows temperature; ")
    far = gain(3.0, 5.0, rms=6.1).verdict
    assert far.endswith(f"; the legs lie {math.sqrt(6.1**2 - 9.0):.3g} apart, which it does not foretell")
    assert "apart" not in gain(3.0, 5.0, rms=6.0).verdict


def test_rows_far_from_their_neighbours_and_without_a_value_are_left_out():
    rng = np.random.default_rng(1)
    temp = np.linspace(0.0, 30.0, 500)
    rates = {"x": rng.normal(size=500), "y": 5.0 * rng.normal(size=500)}
    rates["x"][100] = rates["y"][200] = 500.0
    rates["y"][7] = temp[300] = np.nan
    use, remarks = _sound_rows(temp, rates)
    assert np.flatnonzero(~use).tolist() == [7, 100, 200, 300]
    assert remarks == ["2 rows without a value left out", "2 outlying rows left out, the first at row 100"]
    # a distance of a normal output is beyond its sigma in one of three rows, and beyond eight of them in none
    for sigmas, found in ((7.0, []), (9.5, [250])):
        spike = rates["x"].copy()
        spike[[100, 250]] = [0.0, np.median(spike[246:255]) + sigmas]
        use, _ = _sound_rows(np.linspace(0.0, 30.0, 500), {"x": spike})
        assert np.flatnonzero(~use).tolist() == found
    coarse = np.zeros(500)
    coarse[::50] = 1.0
    use, remarks = _sound_rows(np.linspace(0, 30, 500), {"x": coarse})
    assert use.all() and remarks == []


def test_a_cycle_is_judged_on_the_leg_behind_its_last_turn():
    """Temperature up, down and up again; an axis follows it, another its past, a third is missing."""
    rng = np.random.default_rng(2)
    temp = np.concatenate(
        (np.linspace(-30, 50, 1500), np.linspace(50, -40, 1500), np.linspace(-40, 60, 2000))
    )
    rates = {"x": 0.3 * temp + rng.normal(size=5000), "y": np.full(5000, np.nan), "z": rng.normal(size=5000)}
    rates["y"][:2499] = 1.0
    found = study_chamber_cycle(temp, rates)
    assert (found.turn, found.block, len(found.temp_c)) == (120, 25, 200)
    x, z = found.axes
    assert (x.axis, x.terms_static, x.one_way) == ("x", ("T",), False) and x.static_pct > 95.0 and not z.gains
    assert found.failed == (("y", "more than half of its values are missing"),)
    held = (np.arange(200) > 120) & (found.temp_c <= found.temp_c[:121].max())
    beyond = int(((np.arange(200) > 120) & ~held).sum())
    assert found.remarks == (f"{beyond} of 79 means of the held-out leg are beyond the fitted range",)
    left = (x.means - x.means[:121].mean())[held]
    assert x.before.sigma == pytest.approx(np.std(left, ddof=1))
    assert x.before.rms == pytest.approx(math.sqrt(np.mean(left**2)))
    assert x.after_static.rms == pytest.approx(math.sqrt(np.mean(x.left_static[held] ** 2)))
    assert x.after_dynamic.sigma == pytest.approx(np.std(x.left_dynamic[held], ddof=1))
    one = study_chamber_cycle(temp[1500:], {"x": rates["x"][1500:]})
    assert one.axes[0].one_way and "goes one way only" in one.remarks[0]
    with pytest.raises(RecordError, match="no axis can be judged"):
        study_chamber_cycle(temp, {"y": np.ones(5000)})


def test_a_slope_is_that_of_the_values_that_there_are():
    rng = np.random.default_rng(1)
    block = np.cumsum(rng.normal(size=(3, 100)), axis=1)
    block[1, [0, 5, 99]] = np.nan
    at = np.arange(100.0)
    expected = [60.0 * np.polyfit(at[np.isfinite(row)], row[np.isfinite(row)], 1)[0] for row in block]
    assert _slope_per_min(block) == pytest.approx(expected)


@pytest.mark.parametrize(("rows", "named"), [(8, False), (9, True), (12, True)])
def test_a_ramp_stalls_if_the_case_stands_still_for_a_quarter_of_an_hour(rows, named):
    """A fifth of the usual rate is still; the first quarter of an hour of a ramp does not count."""
    time_s = 50.0 + 100.0 * np.arange(60)
    rate = np.full(60, -0.5)
    rate[20 : 20 + rows] = 0.099
    rate[:9] = 0.0
    found = _stalls(time_s, rate, [(0.0, 6000.0)])
    said = f"the ramp stalled from 2050 s for {rows * 100 / 60:.0f} min: these rows are kept, "
    assert found == ([said + "their rate is that of a dwell"] if named else [])
    rate[20 : 20 + rows] = 0.101
    assert _stalls(time_s, rate, [(0.0, 6000.0)]) == []
    assert _stalls(time_s, rate, [(7000.0, 8000.0)]) == []


def test_rows_of_a_ramp_have_more_than_half_of_their_seconds():
    time_s = np.arange(1.0, 1051.0)
    case, block = 0.01 * time_s, np.full(1050, 7.0)
    bias = np.arange(1050.0)
    bias[200:250], bias[300:349] = np.nan, np.nan
    case[510:570] = np.nan
    truth = 2.0 * np.arange(1050.0)
    run = ramp_run("r", "u", time_s, case, block, bias, true_bias_dph=truth, checksum="c", kind="k")
    assert run.time_s.tolist() == [50.5, 150.5, 350.5, 450.5, 650.5, 750.5, 850.5, 950.5]
    assert run.segment.tolist() == [0, 0, 1, 1, 2, 2, 2, 2]
    assert run.bias_dph[[0, 2]].tolist() == [49.5, 374.0]
    assert run.true_bias_dph[[0, 2]].tolist() == [99.0, 699.0]
    assert run.remarks == (
        "1 of 10 rows left out: bias is missing in them", "1 of 10 rows left out: case (T1) is missing in them",
    )  # fmt: skip
    assert (run.checksum, run.kind, run.block_rate.tolist()) == ("c", "k", [0.0] * 8)


def ramp(low=-40.0, high=60.0, rate=1.0, first=1, n=100, run_id="r", **changes):
    """Up and down between two temperatures."""
    half = np.linspace(low, high, n) if first > 0 else np.linspace(high, low, n)
    case = np.concatenate((half, half[::-1]))
    rates = np.repeat([first * rate, -first * rate], n)
    time_s = 100.0 * np.arange(2.0 * n)
    bias = 0.01 * case + 0.2 * np.sign(rates)
    run = RampRun(
        run_id,
        "u",
        time_s,
        case,
        case + 1.0,
        rates,
        0.9 * rates,
        bias,
        np.zeros(2 * n, np.int64),
        checksum="s",
    )
    return replace(run, **changes)


def test_profiles_differ_by_direction_rate_and_range():
    assert profile_of(ramp()) == RampProfile(1, 1.0, -40.0, 60.0)
    slow = replace(ramp(first=-1), case_rate=np.concatenate(([0.4], ramp(first=-1).case_rate[1:])))
    assert profile_of(slow) == RampProfile(-1, 1.0, -40.0, 60.0)
    fitted = [ramp(), ramp(rate=1.2)]
    assert how_it_differs(ramp(), ()) == "" and how_it_differs(ramp(), fitted) == ANOTHER_DAY
    assert how_it_differs(ramp(first=-1), fitted) == "other direction"
    assert how_it_differs(ramp(rate=1.55), fitted) == ANOTHER_DAY
    assert (
        how_it_differs(ramp(rate=1.57), fitted) == "another rate" == how_it_differs(ramp(rate=0.76), fitted)
    )
    assert how_it_differs(ramp(rate=0.78), fitted) == ANOTHER_DAY
    for low, high, said in (
        (-44.9, 64.9, ANOTHER_DAY), (-45.1, 60.0, "beyond the range"), (-40.0, 65.1, "beyond the range"),
        (-34.9, 60.0, "part of the range"), (-40.0, 54.9, "part of the range"), (-35.1, 55.1, ANOTHER_DAY),
    ):  # fmt: skip
        assert how_it_differs(ramp(low, high), fitted) == said, (low, high)
    assert (
        how_it_differs(ramp(-80.0, 60.0, 2.0, -1), fitted)
        == "other direction, another rate, beyond the range"
    )


def test_hysteresis_is_the_rms_distance_of_the_branches_where_both_went():
    run = ramp()
    assert hysteresis_dph(run, run.bias_dph) == pytest.approx(0.4, abs=0.01)
    assert hysteresis_dph(run, 0.01 * run.case_c) == pytest.approx(0.0, abs=0.01)
    warm = np.where(run.case_c >= 10.0, 1.0, 0.0) * np.where(run.case_rate > 0, 3.0, 0.0)
    assert hysteresis_dph(run, warm) == pytest.approx(3.0 * math.sqrt(0.5), rel=0.03)
    one_way = ramp_part(run, slice(0, 100))
    assert math.isnan(hysteresis_dph(one_way, one_way.bias_dph))
    # rows of less than half of the usual rate belong to no branch
    dwell = replace(
        run, case_rate=np.where(np.arange(200) % 100 < 10, 0.49 * np.sign(run.case_rate), run.case_rate)
    )
    odd = run.bias_dph + np.where(np.arange(200) % 100 < 10, 99.0, 0.0)
    assert hysteresis_dph(dwell, odd) == pytest.approx(0.4, abs=0.01)


def ramp_part(run, part):
    names = ("time_s", "case_c", "block_c", "case_rate", "block_rate", "bias_dph", "segment")
    return replace(run, **{name: getattr(run, name)[part] for name in names})


def test_an_equation_is_judged_by_what_it_leaves():
    run = replace(ramp(), true_bias_dph=0.01 * ramp().case_c)
    equation = RlgCompensation(
        unit_id="u", variables=("T1", "dT1"), coefficients=(0.01, 0.1), intercept_dph=0.5,
        temp_range_c=(-40.0, 50.0), rate_range=(-1.0, 0.5), **provenance({}),
    )  # fmt: skip
    assert equation.drift_dph(run) == pytest.approx(0.5 + 0.01 * run.case_c + 0.1 * run.case_rate)
    assert replace(equation, variables=(), coefficients=()).drift_dph(run).tolist() == [0.5] * 200
    assert equation.outside(run).tolist() == ((run.case_c > 50.0) | (run.case_rate > 0.5)).tolist()
    found = judge(equation, run, [run])
    left = run.bias_dph - equation.drift_dph(run)
    assert found.before_dph == pytest.approx(np.std(run.bias_dph, ddof=1))
    assert found.after_dph == pytest.approx(np.std(left, ddof=1))
    assert found.improvement_pct == pytest.approx(100.0 * (1.0 - found.after_dph / found.before_dph))
    assert found.oracle_dph == pytest.approx(np.std(run.bias_dph - run.true_bias_dph, ddof=1))
    assert found.oracle_pct == pytest.approx(100.0 * (1.0 - found.oracle_dph / found.before_dph))
    assert (found.apart.outside, found.apart.count) == (int(equation.outside(run).sum()), 200)
    assert found.apart.inside_after == pytest.approx(np.std(left[~equation.outside(run)], ddof=1))
    assert found.hysteresis_before_dph == pytest.approx(0.4, abs=0.01)
    assert found.hysteresis_after_dph == pytest.approx(0.2, abs=0.01)
    assert judge(equation, replace(run, true_bias_dph=None)).oracle_pct is None
    with pytest.raises(UnitMismatch):
        equation.drift_dph(replace(run, unit_id="v"))
    rows = (found, replace(found, improvement_pct=0.0))
    variant = StepwiseVariant("v", equation, rows, None)
    assert variant.mean_improvement_pct == pytest.approx(0.5 * found.improvement_pct)
    assert math.isnan(replace(variant, judged=()).mean_improvement_pct)


def test_what_varies_is_usable_and_one_temperature_is_not_two():
    run = ramp()
    x = candidate_matrix([run], ("T1", "T2", "dT1", "T1-T2"))
    usable, left = _usable(x, ("T1", "T2", "dT1", "T1-T2"), twins=False)
    assert (
        usable == ("T1", "T2", "dT1") and [name for name, _ in left] == ["T1-T2"] and "constant" in left[0][1]
    )
    usable, left = _usable(x, ("T1", "T2", "dT1", "T1-T2"), twins=True)
    assert usable == ("T1", "dT1") and [name for name, _ in left] == ["T2", "T1-T2"]
    assert _one_column([run]) and _one_column([run, replace(run, block_c=1.8 * run.case_c + 32.0)]) is False
    noise = np.random.default_rng(1).normal(size=200)
    size = float(np.std(run.block_c))
    assert _one_column([replace(run, block_c=run.block_c + 0.9e-5 * size * noise)])
    assert not _one_column([replace(run, block_c=run.block_c + 1.2e-5 * size * noise)])


def test_terms_that_are_sums_of_others_are_named_and_runs_are_segments_of_their_own():
    rng = np.random.default_rng(1)
    one, two = rng.normal(size=(2, 80))
    x = np.column_stack((one, two, one + two, rng.normal(size=80)))
    result = stepwise(x, 3.0 * one - 2.0 * two + 0.1 * rng.normal(size=80), names=("a", "b", "a+b", "c"))
    found = _collinear(result)
    (out,) = {"a", "b", "a+b"} - set(result.selected)
    assert [name for name, _ in found] == [out] and "a sum of the variables already in (" in found[0][1]
    segments = [np.array([0, 0, 1]), np.array([0, 2, 2]), np.array([0])]
    assert _segments([SimpleNamespace(segment=own) for own in segments]).tolist() == [0, 0, 1, 2, 4, 4, 5]


def test_a_compensation_has_the_equation_its_statistics_and_its_ranges():
    rng = np.random.default_rng(1)
    runs = [ramp(run_id="a"), ramp(-20.0, 70.0, 0.5, run_id="b", checksum="t")]
    x = candidate_matrix(runs, ("T1", "dT1", "T2"))
    y = np.concatenate([run.bias_dph for run in runs]) + 0.01 * rng.normal(size=400)
    result = stepwise(x, y, names=("T1", "dT1", "T2"))
    found = _compensation(runs, result)
    inside = [("T1", "dT1", "T2").index(name) for name in result.selected]
    design = np.column_stack((np.ones(400), x[:, inside]))
    weights = np.linalg.lstsq(design, y, rcond=None)[0]
    assert found.variables == result.selected and found.coefficients == pytest.approx(weights[1:], rel=1e-6)
    assert found.intercept_dph == pytest.approx(weights[0], rel=1e-6)
    assert (found.temp_range_c, found.rate_range) == ((-40.0, 70.0), (-1.0, 1.0))
    left = float(np.sum((y - design @ weights) ** 2))
    r2 = 1.0 - left / float(np.sum((y - y.mean()) ** 2))
    k = len(inside)
    assert found.statistics["r2"] == pytest.approx(r2) and found.statistics["multiple_r"] == pytest.approx(
        math.sqrt(r2)
    )
    assert found.statistics["rmse_dph"] == pytest.approx(math.sqrt(left / (400 - k - 1)))
    assert found.statistics["adjusted_r2"] == pytest.approx(1.0 - (1.0 - r2) * 399 / (399 - k))
    assert found.statistics["f"] == pytest.approx(r2 / k / ((1.0 - r2) / (399 - k)), rel=1e-6)
    assert dict(found.runs) == {"a": "s", "b": "t"}
    case = np.array([-40.0, 70.0, -41.0, 71.0, 0.0, 0.0, -41.0, 71.0, -41.0])
    rate = np.array([1.0, -1.0, 0.0, 0.0, -1.1, 1.1, -1.1, 1.1, 1.1])
    beside = SimpleNamespace(case_c=case, case_rate=rate)
    assert found.outside(beside).tolist() == [False, False] + [True] * 7
    text = found.equation()
    assert text.startswith(f"B = {found.intercept_dph:.6g} ") and all(
        name in text for name in found.variables
    )
    assert replace(found, variables=("T1", "T2"), coefficients=(-2.5, 0.5), intercept_dph=1.0).equation() == (
        "B = 1 - 2.5·T1 + 0.5·T2"
    )
    none = replace(found, variables=(), coefficients=(), intercept_dph=-0.25)
    assert none.equation() == "B = -0.25" and none.drift_dph(runs[0]).tolist() == [-0.25] * 200


def test_variables_are_products_of_two_temperatures_and_their_rates():
    run = replace(ramp(), block_rate=0.3 * ramp().case_rate, block_c=2.0 * ramp().case_c + 5.0)
    a, b, da, db = run.case_c, run.block_c, run.case_rate, run.block_rate
    expected = [a, b, da, db, a * da, b * db, da**2, db**2, a**2, b**2, a - b]
    assert (
        len(CANDIDATES) == 11 and pytest.approx(np.array(expected)) == candidate_matrix([run], CANDIDATES).T
    )
    more = ("T1*T2", "(T1-T2)^2", "dT1-dT2", "T1^3", "T2^3", "sign(dT1)")
    expected = [a * b, (a - b) ** 2, da - db, a**3, b**3, np.tanh(10.0 * da)]
    assert pytest.approx(np.array(expected)) == candidate_matrix([run], more).T
    for names in (("T1", "T1"), (), ("T1", "T3")):
        with pytest.raises(ConfigurationError, match="cannot be used"):
            candidate_matrix([run], names)


@pytest.mark.parametrize(("missing", "said"), [(10, False), (11, True), (500, True)])
def test_lost_samples_are_remarked_beyond_a_thousandth(missing, said):
    run = SimpleNamespace(manifest=SimpleNamespace(stream={"g": {"sample_rate_hz": 100.0}, "h": {}}))
    valid = np.ones(10_000, np.int8)
    valid[:missing] = 0
    found = _lost(run, "g", {"valid": valid}, 100)
    expected = f"{missing} of 10000 samples are missing or not valid: the means are noisier than usual"
    assert found == ([expected] if said else [])
    assert _lost(run, "h", {"valid": valid}, 100) == [] and _lost(run, "other", {"valid": valid}, 100) == []
    assert [_text(each) for each in (1.5, 20, None, "x")] == ["1.5", "20", "?", "?"]
