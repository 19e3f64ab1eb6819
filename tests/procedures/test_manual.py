"""The bench by hand: what is ordered is done and recorded, what the limits forbid is not sent."""

import numpy as np
import pytest

from bench.control.by_hand import Order, parse_order
from bench.control.lease import take_lease
from bench.control.procedure import find_procedure
from bench.control.questions import Reply
from bench.control.runner import RunRequest
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.rehearsal import run_in_lab
from bench.lab.testing import usual_bench
from bench.record.benchfile import Band, ForbiddenState, LimitsSection
from bench.record.events.run import AirDemand, AngleDemand, Answer, Note, RateDemand
from bench.record.recording import Run, read_events
from drivers.base.errors import BenchInUse, ConfigurationError


class Hands:
    """Orders, each after so many looks of 0.2 s; then nobody any more."""

    def __init__(self, *orders):
        self.orders = list(orders)

    def ask(self, question):
        looks, text = self.orders.pop(0) if self.orders else (10**9, "")

        def answer():
            nonlocal looks
            looks -= 1
            return Reply(text, "Ada") if looks < 0 else None

        return answer


@pytest.fixture
def usual_file():
    return usual_bench(None)


@pytest.fixture
def by_hand(usual_file, tmp_path):
    """Return what runs `manual` on an emulated lab with those orders, and limits of the bench."""

    def run(*orders, limits=None, **parameters):
        manual = find_procedure("manual")
        file = usual_file.model_copy(update={"limits": limits or usual_file.limits})
        with EmulatedLab(file, Plant(seed=3)) as lab:
            request = RunRequest(manual, manual.parse(parameters), file, tmp_path / "runs", Hands(*orders))
            return run_in_lab(request, lab)

    return run


def told(result, kind):
    return [event for _, event in read_events(result.folder).of(kind)]


def test_orders_are_carried_out_and_signed(by_hand):
    result = by_hand(
        (0, "spin 5"), (150, "stop"), (100, "point 90"), (150, "air 30"), (900, "chamber off"), (0, "done")
    )
    assert result.outcome == "completed", result.reason
    table = Run.open(result.folder).turntable()
    seconds = table["time_ns"] / 1e9
    at_rate = seconds[np.abs(table["rate_dps"] - 5.0) < 0.01]
    assert 20.0 < at_rate[-1] - at_rate[0] < 35.0
    assert abs(table["angle_deg"][-1] - 90.0) < 0.01 and abs(table["rate_dps"][-1]) < 0.001
    air = Run.open(result.folder).chamber(("time_ns", "air_temp_c"))["air_temp_c"]
    assert 28.0 < air.max() < 32.0
    answers = told(result, Answer)
    assert [answer.answer for answer in answers][:2] == ["spin 5", "stop"] and {
        answer.by for answer in answers
    } == {"Ada"}
    assert [demand.set_point_c for demand in told(result, AirDemand)][:1] == [30.0]


def test_a_stop_does_not_wait_for_the_turn_before_it(by_hand):
    result = by_hand(
        (0, "spin 10"), (2, "stop"), (60, "point 179"), (5, "stop"), (100, "done"), max_rate_dps=10
    )
    assert result.outcome == "completed", result.reason
    demands = read_events(result.folder)
    turned_s = demands.of(RateDemand)[0][0]
    angle_s = demands.of(AngleDemand)[0][0]
    stops = [
        time_s for time_s, demand in demands.of(RateDemand) if demand.rate_dps == 0.0 and time_s > angle_s
    ]
    assert turned_s < angle_s and stops[0] - angle_s < 2.5
    table = Run.open(result.folder).turntable()
    assert 1.0 < abs(table["angle_deg"][-1]) < 178.0


@pytest.mark.parametrize(
    ("orders", "why"),
    [
        (["spin 11"], "more than this run may order"),
        (["air 41"], "more than this run may order"),
        (["air 9"], "more than this run may order"),
        (["spin fast"], "does not know"),
        (["explode"], "does not know"),
        (["spin 5", "point 90"], "the table turns"),
    ],
)
def test_what_may_not_be_is_told_and_not_sent(by_hand, orders, why):
    result = by_hand(*((60, order) for order in orders), (5, "done"))
    assert result.outcome == "completed", result.reason
    assert [why in note.text for note in told(result, Note)].count(True) == 1
    sent = [*told(result, AngleDemand), *told(result, AirDemand), *told(result, RateDemand)]
    assert sent == [demand for demand in told(result, RateDemand) if demand.rate_dps in (0.0, 5.0)]


def test_a_rule_of_the_bench_forbids_an_order(by_hand):
    rule = ForbiddenState(name="fast when warm", rate_dps=Band(above=4.0), air_temp_c=Band(above=20.0))
    result = by_hand((0, "spin 5"), (20, "spin 3"), (60, "done"), limits=LimitsSection(forbid=(rule,)))
    assert result.outcome == "completed", result.reason
    assert any("forbidden on this bench: fast when warm" in note.text for note in told(result, Note))
    assert [demand.rate_dps for demand in told(result, RateDemand)][:1] == [3.0]


def test_a_bench_that_nobody_orders_anything_gives_itself_back(by_hand):
    result = by_hand((0, "spin 5"), idle_min=1.0)
    assert result.outcome == "completed" and 60.0 < result.duration_s < 120.0
    assert any("nobody ordered anything" in note.text for note in told(result, Note))
    assert all(state.confirmed for state in result.safe)


def test_no_aborts(by_hand):
    result = by_hand((0, "spin 5"), (50, "no"))
    assert result.outcome == "aborted" and "Ada answered 'no'" in result.reason
    assert all(state.confirmed for state in result.safe)


@pytest.mark.concurrent
def test_a_bench_in_use_is_refused(usual_file, tmp_path):
    manual = find_procedure("manual")
    with take_lease(usual_file, "a run"), pytest.raises(BenchInUse):
        run_in_lab(RunRequest(manual, manual.parse({}), usual_file, tmp_path, Hands()), None)


@pytest.mark.parametrize(
    ("text", "order"),
    [
        ("spin -5.5", Order("spin", -5.5)),
        (" Point 1e2 ", Order("point", 100.0)),
        ("chamber  OFF", Order("chamber off")),
    ],
)
def test_orders_as_people_type_them(text, order):
    assert parse_order(text) == order


@pytest.mark.parametrize(
    "text", ["", "spin", "spin nan", "spin inf", "spin 1 2", "spin 5;stop", "stop 5", "air x"]
)
def test_what_is_no_order(text):
    with pytest.raises(ConfigurationError, match="does not know"):
        parse_order(text)
