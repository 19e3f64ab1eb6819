"""What guards the ratios: which are kept, what counts as lost, how a loss is confirmed; exponents and costs."""

import json
import math

import numpy as np
import pytest

from benchmarks._guard import better, keep, lost, ratios
from benchmarks._measure import Pair, cost, in_turns, row
from benchmarks.growth import exponent


def made(ratio, name="peer 1.2.3", benchmark="work"):
    return row(benchmark, Pair(1.0, ratio, ratio), name)


def test_a_loss_of_more_than_a_quarter_is_reported_and_a_missing_row_too():
    kept = {"m": {"work / peer": 10.0, "gone / peer": 3.0}}
    assert lost("m", [made(7.6)], kept) == ["m: gone / peer: not measured, kept 3"]
    assert lost("m", [made(7.4), made(3.0, benchmark="gone")], kept) == ["m: work / peer: 7.4, kept 10"]
    assert lost("other", [made(0.1)], kept) == []


def test_versions_do_not_part_a_ratio_from_the_kept_one_and_limits_are_not_kept(tmp_path):
    rows = [made(2.0), made(3.0, "limit: the disk"), made(4.0, "goal")]
    assert ratios(rows) == {"work / peer": 2.0}
    keep("m", rows, tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text()) == {"m": {"work / peer": 2.0}}


def test_of_two_measurements_the_better_counts():
    first, second = [made(7.0), made(9.0, benchmark="b")], [made(8.0), made(5.0, benchmark="b")]
    assert [each["ratio"] for each in better(first, second)] == [8.0, 9.0]


def test_turns_find_which_work_takes_longer():
    short, long = np.ones(1000), np.ones(1_000_000)
    assert in_turns(short.sum, long.sum, turns=3, least_s=0.002).ratio > 5.0


def test_cost_has_the_peak_of_the_work_alone_and_hands_errors_on():
    def prepare():
        np.ones(8_000_000).sum()  # 61 MiB that are gone before the work begins
        return lambda: np.ones(4_000_000).sum()

    assert 25.0 < cost(prepare).memory_mib < 45.0
    with pytest.raises(ZeroDivisionError):
        cost(lambda: lambda: 1 / 0)


def test_the_exponent_is_that_of_the_last_step():
    assert exponent((1, 10, 100), [5.0, 1.0, 100.0]) == pytest.approx(2.0)
    assert exponent((1, 2, 4), [1.0, 3.0, 6.0 * math.sqrt(2.0) / 2.0]) == pytest.approx(0.5)
