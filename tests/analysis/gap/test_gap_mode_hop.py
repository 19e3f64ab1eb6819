"""A step of the bias at a temperature: against relays sample by sample, and where the records say that it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulators.effects import SlowRates, Stimulus
from tests.analysis.gap.conftest import effect, stimulus


@pytest.mark.parametrize("at_c", [-60.0, 12.5, 48.0])
def test_a_mode_hop_is_looked_for_at_every_temperature_of_the_runs(at_c: float) -> None:
    s = stimulus(4000)
    t_in_c = s.t_in_c + (at_c - 10.0)
    warm = Stimulus(s.time_s, t_in_c, t_in_c, s.angle_deg, s.elevation_deg, 39.1)
    none = np.zeros(0)
    propose = effect("mode_hop").propose
    assert propose is not None
    shapes = propose(SlowRates(none, none, none.astype(np.int64), [(warm, np.zeros(4000))]))
    assert min(abs(shape["at_c"] - at_c) for shape in shapes) <= 2.5
    flat = Stimulus(s.time_s, np.full(4000, 20.0), t_in_c, s.angle_deg, s.elevation_deg, 39.1)
    assert not propose(SlowRates(none, none, none.astype(np.int64), [(flat, np.zeros(4000))]))


def test_a_mode_hop_back_is_later_by_its_loop() -> None:
    """A relay with two thresholds, sample by sample (Visintin, Models of Hysteresis, 1994, ch. IV)."""
    n, at_c, loop_k = 40_000, 7.0, 3.0
    time_s = np.arange(1.0, n + 1.0)
    t_in_c = 7.0 + 9.0 * np.sin(2.0 * math.pi * time_s / 16_000.0) * np.linspace(1.0, 0.1, n)
    s = Stimulus(time_s, t_in_c, t_in_c, np.zeros(n + 1), np.zeros(n), 39.1)
    over, expected = t_in_c[0] > at_c, np.empty(n)
    for k, now_c in enumerate(t_in_c):
        over = now_c > at_c - 0.5 * loop_k if over else now_c > at_c + 0.5 * loop_k
        expected[k] = 0.5 if over else -0.5
    shape = {"at_c": at_c, "lag_s": 0.0, "width_k": 0.02, "loop_k": loop_k, "toward_case": 0.0}
    column = effect("mode_hop").columns(s, shape)[0]
    assert np.count_nonzero(np.diff(expected)) == 4
    assert np.mean(np.abs(column - expected) > 0.05) < 0.01
    without = effect("mode_hop").columns(s, shape | {"loop_k": 0.0})[0]
    assert np.mean(np.abs(without - expected) > 0.5) > 0.1


@pytest.mark.parametrize(
    ("at_c", "loop_k", "part", "above_k"),
    [(13.7, 1.8, 0.0, 1.5), (-4.2, 0.0, 0.0, 1.5), (8.0, 3.0, 0.6, 1.5), (31.0, 0.5, 0.9, 15.5)],
)
def test_where_a_hop_is_and_how_wide_its_loop_is_read_off_the_records(
    at_c: float, loop_k: float, part: float, above_k: float
) -> None:
    """A relay with two thresholds, sample by sample; noise of a third of it, a slope beside, rows missing.

    What hops is `part` of the way from the sensor to the case, whose temperature comes before and goes further:
    the last place is one that the sensor never reaches.
    """
    n, rng, records = 9_000, np.random.default_rng(4), []
    time_s = np.arange(1.0, n + 1.0)
    for phase in (0.0, 2.0):
        t_in_c = at_c + above_k + 14.0 * np.sin(2.0 * math.pi * time_s / 4_400.0 + phase)
        t_out_c = at_c + above_k + 18.0 * np.sin(2.0 * math.pi * time_s / 4_400.0 + phase + 0.9)
        own_c = t_in_c - part * (t_in_c - t_out_c)
        over, output = own_c[0] > at_c, np.empty(n)
        for k, now_c in enumerate(own_c):
            over = now_c > at_c - 0.5 * loop_k if over else now_c > at_c + 0.5 * loop_k
            output[k] = -3.0 * over
        output += 0.2 * t_in_c + rng.normal(0.0, 1.0, n)
        output[500:900] = np.nan
        records.append((Stimulus(time_s, t_in_c, t_out_c, np.zeros(n + 1), np.zeros(n), 39.1), output))
    propose, none = effect("mode_hop").propose, np.zeros(0)
    assert propose is not None
    first, *others = propose(SlowRates(none, none, none.astype(np.int64), records))[-3:]
    assert first["at_c"] == pytest.approx(at_c, abs=0.15)
    assert first["loop_k"] == pytest.approx(loop_k, abs=0.3)
    assert first["toward_case"] == part
    assert all(abs(other["at_c"] - first["at_c"]) > 3.0 for other in others)


def test_records_that_show_no_hop_propose_none_beside_the_grid() -> None:
    """Runs each at one temperature, a run without a row, and one in which nothing is left."""
    n, none, propose = 400, np.zeros(0), effect("mode_hop").propose
    assert propose is not None
    sweep = stimulus(4000)

    def at(level_c: float) -> Stimulus:
        return Stimulus(
            np.arange(1.0, n + 1.0), *[np.full(n, level_c)] * 2, np.zeros(n + 1), np.zeros(n), 39.1
        )

    def shapes(*records: tuple[Stimulus, np.ndarray]) -> list[dict[str, float]]:
        return list(propose(SlowRates(none, none, none.astype(np.int64), records)))

    steady = shapes((at(-20.0), np.zeros(n)), (at(30.0), np.ones(n)))
    assert steady and len({tuple(shape.values()) for shape in steady}) == len(steady)
    assert not any(
        shape["width_k"] == 0.1 and shape["loop_k"] == 0.0 == shape["toward_case"] for shape in steady
    )
    for output in (np.full(4000, np.nan), np.zeros(4000)):
        assert len(shapes((sweep, output))) % 6 == 0  # the grid's six forms at every place, and no more


def test_what_hops_may_be_nearer_to_the_case() -> None:
    s = stimulus(12_000)
    shape = {"at_c": -5.0, "lag_s": 0.0, "width_k": 0.01, "loop_k": 0.0}
    for part in (0.0, 0.4, 1.0):
        place_c = s.warm_k + 25.0 - part * s.gradient_k
        column = effect("mode_hop").columns(s, shape | {"toward_case": part})[0]
        assert np.mean(np.sign(column) != np.sign(place_c + 5.0)) < 1e-3
    assert effect("mode_hop").columns(s, shape)[0] == pytest.approx(
        effect("mode_hop").columns(s, shape | {"toward_case": 0.0})[0]
    )
