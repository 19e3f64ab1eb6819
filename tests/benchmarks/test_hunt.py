"""The benchmark of searches: cases, programmes, journal, marks and tables, without a search."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import UNKNOWN
from bench.campaign.hunt import ALIKE, BUDGET, DECIDED, NO_GAP
from benchmarks.hunt import _seek
from benchmarks.hunt.__main__ import _checked
from benchmarks.hunt._cases import NULL, OUTSIDE, PAIR, Case, drawn_case, is_right
from benchmarks.hunt._plants import families
from benchmarks.hunt._programme import programme_of
from benchmarks.hunt._seek import Searched, Step, among, keep, keep_all, kept, stay_alike
from benchmarks.hunt._strategies import standard_tests
from benchmarks.hunt._table import tables, to_right_h

STEP = Step("thermal-ramp", "t", 2.0, 0.5, 0.25, False, "shupe", 0.9, 1.0, 2.0)
ONE = Searched(
    "mems", "mems 1", "single", 1, 0, "squeezed", {"squeezed": 1.0}, "search", "in process", DECIDED, "shupe",
    0.97, True, 6.0, (STEP,),
)  # fmt: skip


@pytest.fixture(scope="module")
def plants():
    return families()


def test_a_case_is_the_same_however_often_it_is_drawn(plants):
    first = [drawn_case(plants["ring_laser"], number, 3) for number in range(4)]
    assert first == [drawn_case(plants["ring_laser"], number, 3) for number in range(4)]
    assert [case.kind for case in first] == ["single", NULL, PAIR, OUTSIDE]
    assert [len(case.gap) for case in first] == [1, 0, 2, 1]
    assert set(first[3].gap) <= set(plants["ring_laser"].foreign)
    # what the catalogue has is searched for where nothing else is there
    assert drawn_case(plants["fibre_optic"], 3, 3).kind == "single"


def test_an_effect_of_one_sign_is_never_of_the_other(plants):
    """A dead zone that adds rate is none: the lab's plant refuses it."""
    fibre, ring = plants["fibre_optic"], plants["ring_laser"]
    assert not fibre.signed("dead_zone") and not fibre.signed("saturation") and fibre.signed("gradient")
    assert ring.signed("bias_curve") is ring.family.effects["bias_curve"].signed
    cases = [drawn_case(fibre, number, seed) for seed in range(5) for number in (0, 2, 3, 4, 6)]
    sizes = [size for case in cases for name, size in case.gap.items() if not fibre.signed(name)]
    assert sizes and min(sizes) > 0.0
    assert {math.copysign(1.0, size) for case in cases for size in case.gap.values()} == {-1.0, 1.0}


def test_an_effect_has_the_size_that_was_asked_for_and_the_axis_of_the_bench_hides_some(plants):
    plant = plants["ring_laser"]
    assert plant.size("gradient", 60.0, 5) == pytest.approx(2.0 * plant.size("gradient", 30.0, 5))
    assert plant.size("mass", 30.0, 5) == 0.0


def test_right_is_exactly_what_acts_by_any_of_its_names(plants):
    plant = plants["ring_laser"]
    single = Case("ring_laser", 0, "single", 1, {"lag": 1.0})
    assert is_right(plant, single, DECIDED, "thermal_lag") and is_right(plant, single, DECIDED, "relaxation")
    assert not is_right(plant, single, BUDGET, "thermal_lag")
    for wrong in (NO_GAP, "shupe", "shupe + thermal_lag", f"thermal_lag + {UNKNOWN}"):
        assert not is_right(plant, single, DECIDED, wrong)
    pair = Case("ring_laser", 0, PAIR, 1, {"lag": 1.0, "warm_up": 1.0})
    assert is_right(plant, pair, DECIDED, "thermal_lag + warm_up") and not is_right(
        plant, pair, DECIDED, "warm_up"
    )
    foreign = Case("ring_laser", 0, OUTSIDE, 1, {"fringes": 1.0})
    assert is_right(plant, foreign, DECIDED, UNKNOWN) and not is_right(plant, foreign, DECIDED, NO_GAP)
    assert is_right(plant, Case("ring_laser", 0, NULL, 1, {}), DECIDED, NO_GAP)


def test_what_acts_may_be_among_the_fewest_explanations_that_are_left(plants):
    plant, case = plants["ring_laser"], Case("ring_laser", 0, "single", 1, {"azimuth": 1.0})
    assert among(plant, case, ["shupe", "azimuth_error"])
    assert not among(plant, case, ["shupe", "gradient"])
    assert not among(plant, case, ["gradient + azimuth_error"]) and not among(plant, case, [])


def test_one_of_several_stays_so_only_if_no_single_further_run_decides(plants, monkeypatch):
    """The runs of the search come first, as they were made; then each that the bench can make, alone."""
    plant, case = plants["ring_laser"], Case("ring_laser", 0, "single", 1, {"azimuth": 1.0})
    step = replace(STEP, procedure=plant.designs[3].procedure, text=plant.designs[3].text)
    monkeypatch.setattr(type(plant), "recorded", lambda self, design, gap, seed, number: (gap, seed, number))
    seen = []

    def concluded(runs, model, designs, until):
        seen.append([(run.design, run.recordings) for run in runs])
        sure = 0.96 if runs[-1].design == deciding and len(designs) in few else 0.9
        return SimpleNamespace(probability=sure)

    monkeypatch.setattr(_seek, "conclude", concluded)
    deciding, few = "", (1, len(plant.designs))
    assert stay_alike(plant, case, [step])
    assert [runs[-1][0] for runs in seen] == [design.key for design in plant.designs]
    assert all(runs[0] == (plant.designs[3].key, (case.gap, case.seed, 0)) for runs in seen)
    assert [runs[-1][1][2] for runs in seen] == list(range(1, 1 + len(plant.designs)))
    deciding = plant.designs[5].key
    assert not stay_alike(plant, case, [step])
    # decided only as long as the rest of the bench is not looked at: it is not
    few = (1,)
    assert stay_alike(plant, case, [step])


def test_a_programme_takes_the_time_that_its_procedure_expects(plants):
    for plant in plants.values():
        for design in [*plant.designs, *standard_tests(plant)]:
            programme = programme_of(design)
            assert all(part.end_s - part.start_s > 256 for part in programme.parts)
            if design.procedure != "standard-test":  # of which only the rates are recorded
                assert programme.end_s / 3600.0 == pytest.approx(design.hours, abs=0.06), design.text


def test_recordings_of_a_unit_without_a_gap_hold_noise_alone(plants):
    """White noise of the data sheet: 60 N in a second, whatever the family."""
    for plant in plants.values():
        design = next(each for each in plant.designs if each.procedure == "zero-bias-cold-shock")
        (run,) = plant.recorded(design, {}, 7, 0).runs
        error = run.output_dph - run.stimulus.input_rate_dph
        white = 60.0 * plant.model.noise.arw_deg_per_sqrt_h
        assert np.nanstd(np.diff(error)) == pytest.approx(np.sqrt(2.0) * white, rel=0.15), plant.name
        (again,) = plant.recorded(design, {}, 7, 1).runs
        assert not np.array_equal(run.output_dph, again.output_dph)
        assert run.stimulus.t_in_c.min() < 0.0 < 20.0 < run.stimulus.t_in_c.max()


def test_a_journal_gives_back_what_was_kept_and_no_half_line(tmp_path):
    keep(tmp_path, ONE)
    keep(tmp_path, replace(ONE, strategy="fixed", hours=30.0))
    with (tmp_path / "searches.jsonl").open("a") as file:
        file.write('{"family": "me')
    assert list(kept([tmp_path])) == [ONE, replace(ONE, strategy="fixed", hours=30.0)]
    assert list(kept([tmp_path / "none"])) == []


def test_the_tables_count_wrong_and_open_ends_as_the_whole_budget():
    wrong = replace(ONE, case="mems 2", right=False, acts="gradient")
    still = replace(ONE, case="mems 3", right=False, ended=BUDGET, hours=60.0)
    fixed = [replace(one, strategy="fixed", hours=18.0) for one in (ONE, wrong, still)]
    assert [to_right_h(one) for one in (ONE, wrong, still)] == [6.0, 60.0, 60.0]
    text = "\n".join(tables([ONE, wrong, still, *fixed], ["a"]))
    assert (
        "| the search | 3 | 33 % [6, 79] | 33 % [6, 79] | 0 of 1 | 67 % [21, 94] | 60.0 [6.0, 60.0] |" in text
    )
    assert "0.50 [0.50, 0.50] |" in text  # a quarter nat told of half a nat
    assert "| squeezed (mems) | 3 | 1 | 1 | 60.0 |" in text
    assert "| mems 2 | squeezed | decided: gradient 97 % | 6.0 | another name |" in text


def test_ends_that_leave_several_open_have_a_row_of_their_own():
    right = replace(ONE, ended=ALIKE, one_of=("shupe", "gradient"), among=True, hours=4.0)
    decidable = replace(right, case="mems 2", right=False)
    other = replace(right, case="mems 3", right=False, among=False)
    assert (right.wrong, decidable.wrong, other.wrong) == (False, True, True)
    text = "\n".join(tables([right, decidable, other], ["a"]))
    assert "| the search | 3 | 33 % [6, 79] | 67 % [21, 94] | 0 of 0 | 100 % [44, 100] | 60.0 " in text
    assert "before the check | 3 | 2, 2, 2 | 2 | 1 | 0 |" in text
    assert "alike: shupe, gradient | 4.0 | a further run decides |" in text
    assert "alike: shupe, gradient | 4.0 | none of those named |" in text


def test_slopes_of_the_first_three_runs_and_of_later_ones_stand_apart():
    first, later = replace(STEP, expected=0.5, gained=1.0), replace(STEP, expected=0.2, gained=0.02)
    one = replace(ONE, steps=(first, first, first, later))
    # 1.5 + 0.004 over 0.75 + 0.04
    parts = "| 1.90 [1.90, 1.90] | 2.00 [2.00, 2.00] | 0.10 [0.10, 0.10] |"
    assert f"{parts} 1.90 [1.90, 1.90] |" in "\n".join(tables([one], ["a"]))
    assert f"{parts} - |" in "\n".join(tables([replace(one, kind=PAIR)], ["a"]))


def test_a_claim_that_is_not_checked_yet_is_neither_right_nor_wrong(plants, tmp_path, monkeypatch):
    to_check = replace(ONE, ended=ALIKE, one_of=("shupe", "gradient"), among=True, right=False, checked=False)
    assert not to_check.wrong
    assert "before the check | 1 | 2 | 1 | 0 | 1 |" in "\n".join(tables([to_check], ["a"]))
    asked = []

    def stays(plant, case, steps):
        asked.append((plant.name, case, tuple(steps)))
        return len(asked) == 1

    monkeypatch.setattr(_seek, "stay_alike", stays)
    other = replace(to_check, case="mems 2", seed=2, kind=PAIR)
    keep_all(tmp_path, [ONE, to_check, other])
    assert list(_checked(tmp_path)) == [
        replace(to_check, right=True, checked=True),
        replace(other, checked=True),
    ]
    assert [(one.right, one.wrong) for one in kept([tmp_path])] == [
        (True, False),
        (True, False),
        (False, True),
    ]
    assert asked[1] == ("mems", Case("mems", 0, PAIR, 2, {"squeezed": 1.0}), (STEP,))
    assert list(_checked(tmp_path)) == [] and len(asked) == 2
