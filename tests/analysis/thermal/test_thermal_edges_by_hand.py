"""Where thermal fits begin, end and decide: windows, ties, thresholds and terms, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.analysis.thermal import _dataset, _lstm_training
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.analysis.thermal._diffusion import NODES
from bench.analysis.thermal._evaluate import noise_floor
from bench.analysis.thermal._features import centred_mean
from bench.analysis.thermal._grey_box import (
    _HIGH,
    _LOW,
    _STARTS,
    GreyBoxModel,
    GreyBoxParameters,
    _state_terms,
)
from bench.analysis.thermal._hybrid import HybridModel
from bench.analysis.thermal._leave_out import _tied_with_best, choose
from bench.analysis.thermal._linear_models import LaggedRidgeModel, StepwiseModel, _left_out_scores
from bench.analysis.thermal._lstm_training import _Batch, _batch, _initial_weights, _loss_of
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._regression import fit_ordinary, fit_ridge, target_noise
from bench.analysis.thermal._scale_factor import find_shift
from bench.analysis.thermal._selection import ModelScore
from bench.analysis.thermal._signals import LAG_TIMES_S, low_passes
from bench.analysis.thermal._stream import FeatureStream
from bench.analysis.thermal._types import ThermalRun
from bench.record.recording import Phase
from tests.analysis.thermal.test_thermal_choices_by_hand import Level, features


def test_terms_of_a_grey_box_are_those_of_its_layers_written_out():
    """Ten layers and what relaxes, at two moments; below the transition the coating is soft by a logistic."""
    layers = [[3.0 * j - 30.0 + k for j in range(NODES)] for k in (0.0, 12.0)]
    rates = [[0.1 * j * j - 2.0 * k for j in range(NODES)] for k in (1.0, -3.0)]
    slow, inner, rate_out = [-11.0, 4.0], [-20.0, 31.0], [0.7, -0.2]
    parameters = GreyBoxParameters(0.02, 0.01, 0.2, 1e-3, -12.0, 5.0)
    states = np.array([[*row, own] for row, own in zip(layers, slow, strict=True)])
    chain = SimpleNamespace(rates=lambda states, inputs: np.array([[*row, 77.0] for row in rates]))
    inputs = np.array([[own, 99.0] for own in inner])
    found = _state_terms(parameters, chain, states, inputs, np.array(rate_out))
    assert found.shape == (2, 10)
    for k in range(2):
        coil, rate = sum(layers[k]) / 10.0, sum(rates[k]) / 10.0
        u, v = (coil - 25.0) / 50.0, (inner[k] - 25.0) / 50.0
        soft = 1.0 / (1.0 + math.exp((coil + 12.0) / 5.0))
        # inside to outside: the outer layers count positive, the inner ones negative, alike in size
        across = sum(own * (j - 4.5) / 10.0 for j, own in enumerate(rates[k]))
        expected = [u, u * u, u**3, v, v * v, across, rate - rate_out[k], rate, rate * soft, coil - slow[k]]
        assert found[k] == pytest.approx(expected), k


def test_the_starts_of_a_grey_box_lie_within_its_bounds_and_apart():
    """A coil that follows its spool, and one that follows the case: the better coupled side is another."""
    low, high = _LOW.to_vector(), _HIGH.to_vector()
    assert (low < high).all()
    for start in _STARTS:
        assert (low < start.to_vector()).all() and (start.to_vector() < high).all()
    by_spool, by_case = _STARTS
    assert by_spool.k_in > by_spool.k_out and by_case.k_out > by_case.k_in
    assert GreyBoxModel().starts == _STARTS
    # relaxations between seven minutes and six hours, transitions between -50 and 20 degC can be found
    assert (_LOW.k_relax * 20_000.0, _HIGH.k_relax * 400.0) == pytest.approx((1.0, 1.0))
    assert (_LOW.transition_c, _HIGH.transition_c) == (-50.0, 20.0)


def test_who_is_a_standard_error_behind_is_tied_and_who_is_a_little_more_is_not():
    """Of three runs: -0.01, 0 and 0.31 behind is 0.1 +- 0.105, and 0.02, 0 and 0.28 is 0.1 +- 0.090."""
    best = np.array([1.0, 2.0, 3.0])
    near, far = best + np.array([-0.01, 0.0, 0.31]), best + np.array([0.02, 0.0, 0.28])
    assert _tied_with_best({("a",): best, ("a", "b"): near}) == [("a",), ("a", "b")]
    assert _tied_with_best({("a",): best, ("a", "b"): far}) == [("a",)]


def test_models_far_behind_on_the_validation_run_are_not_left_out_and_networks_sooner():
    """Half as much again is too much, of a network a tenth; as much as that is not."""
    runs = []
    for name in "abcd":
        run = features(name, 60, ord(name))
        runs.append(replace(run, bias_dph=run.t_in + 0.01 * np.random.default_rng(ord(name)).normal(size=60)))
    table = {"best": 0.5, "lstm": 0.55, "hybrid": 0.5501, "fair": 0.75, "late": 0.7501}
    models = {name: Level(name, 1.0 + 0.3 * k) for k, name in enumerate(table)}
    scores = [ModelScore(name, 1.0, None, score) for name, score in table.items()]
    choice = choose(models, scores, runs[:3], runs[3:])
    assert set(choice.folds[0].predictions) == {"best", "lstm", "fair"}
    assert [score.left_out for score in choice.scores] == [4, 4, 4, 0, 0]
    assert {score.name for score in choice.scores[3:]} == {"hybrid", "late"}
    # a network stays as it was fitted, the others learn from every run
    assert choice.models["lstm"] is models["lstm"] and choice.models["fair"] is not models["fair"]
    assert choose(models, scores, runs[:2], runs[3:]) is not None, "three runs are enough"
    assert choose(models, scores, runs[:1], runs[3:]) is None


def test_a_noise_floor_is_that_of_means_over_ten_seconds():
    """Second differences of 10 s means have six times their variance; of 100 s a tenth of it is left."""
    values = np.random.default_rng(5).normal(size=4000).cumsum()
    means = [values[k : k + 10].mean() for k in range(0, 4000, 10)]
    second = [a - 2.0 * b + c for a, b, c in zip(means, means[1:], means[2:], strict=False)]
    assert noise_floor(values) == pytest.approx(math.sqrt(sum(x * x for x in second) / len(second) / 60.0))
    assert noise_floor(7.0 + 0.01 * np.arange(4000.0)) == pytest.approx(0.0, abs=1e-12)


def test_a_run_without_its_window_counts_from_the_case_it_began_with():
    """Levels of 0, 4 and -3; the last one's window holds nothing, and its case was at 40 degC for one step."""
    runs = []
    for name, level, room in (("a", 0.0, 20.0), ("b", 4.0, 25.0), ("c", -3.0, 26.0)):
        run = features(name, 300, ord(name))
        t_out = run.t_out + room - run.t_out[5:10].mean()
        t_out[0] = 40.0 if name == "c" else t_out[0]
        runs.append(replace(run, t_out=t_out, bias_dph=0.3 * run.t_in + 0.02 * t_out + level))
    blind = [runs[0], runs[1], replace(runs[2], reference=(0.0, 1.0))]
    for wanted, zero in ((34.0, -3.0), (26.0, 4.0), (16.0, 0.0)):
        found = anchor_runs(blind, reference_temp_c=wanted)
        levels = [float(np.mean((run.bias_dph - 0.3 * run.t_in - 0.02 * run.t_out)[5:])) for run in found]
        assert levels == pytest.approx([zero] * 3, abs=0.1)


def test_without_overlap_there_is_no_shift():
    """One rises while the other falls: every overlap correlates below nothing, and nothing is none."""
    up = np.linspace(0.0, 50.0, 60)
    for other in (50.0 - up, 20.0 - 0.3 * up):
        found = find_shift(up, other, max_shift_s=600)
        assert -60 < found < 60
    assert find_shift(up, 50.0 - up, max_shift_s=7) in (-7, 7)


def test_low_passes_are_of_forty_seconds_and_of_three_times_as_much_each():
    """A file keeps the time constants that it was fitted with, and one with others is refused."""
    assert tuple(40.0 * 3.0**k for k in range(6)) == LAG_TIMES_S
    step = low_passes(np.array([[0.0, 1.0]]), 40.0)[0, 1]
    assert step == pytest.approx([1.0 - math.exp(-(3.0**-k)) for k in range(6)])


def test_a_target_that_stands_still_is_taught_as_its_middle():
    run = features("a", 30, 1, bias_dph=np.full(30, 4.0), sf=True)
    settings = LstmSettings(hidden=2, warm_up=3)
    weights = _initial_weights(settings, np.array([-99.0] * 3), np.array([99.0] * 3),
                               np.array([4.0, 0.0]), np.array([0.0, 8.0]))  # fmt: skip
    batch = _batch([run], weights, settings)
    assert batch.mask[:, 0, 0].numpy().tolist() == [0.0] * 8 + [1.0] * 25
    assert not batch.targets[:, 0, 0].numpy().any()
    assert batch.targets[8:, 0, 1].numpy() == pytest.approx(run.sf_error_ppm[5:] / 8.0, abs=1e-6)
    assert weights.denormalise(np.array([5.0, 0.5])).tolist() == [4.0, 4.0]


def test_a_network_that_is_asked_for_by_name_is_that_of_the_design_notes():
    """24 units; learnt in ten minutes' pieces after half an hour of the first sample, both of 10 s steps."""
    notes = LstmSettings()
    assert (notes.hidden, notes.epochs, notes.patience, notes.seed) == (24, 300, 40, 0)
    assert (notes.chunk * 10, notes.warm_up * 10) == (600, 1800)
    assert (notes.learning_rate, notes.final_learning_rate) == (0.006, 0.0002)
    assert (notes.gradient_clip, notes.weight_decay) == (1.0, 1e-5)
    # what a linear model leaves is less: a smaller one learns it in fewer epochs, else alike
    assert HybridModel().second.settings == replace(notes, hidden=16, epochs=120)


def test_one_sample_of_a_target_counts_as_that_target():
    """Errors of 3 of the first target everywhere, and of 1 in the only sample of the second."""
    error, mask = np.full((6, 1, 2), 3.0), np.zeros((6, 1, 2))
    mask[:, 0, 0], mask[4, 0, 1], error[4, 0, 1] = 1.0, 1.0, 1.0
    parts = (np.zeros((6, 1, 3)), -error, mask, np.zeros((6, 1, 2)))
    batch = _Batch(*(torch.tensor(part, dtype=torch.float32) for part in parts))
    found = _loss_of(lambda inputs: (torch.zeros(6, 1, 2), None), lambda hidden: hidden, batch)
    assert found == pytest.approx((9.0 + 1.0) / 2.0)


def test_a_unit_of_scale_factor_groups_alone_is_fitted_in_full():
    """The first target is carried by no run: the second one is anchored, chosen and fitted all the same."""
    rng = np.random.default_rng(4)
    runs = []
    for name in "ab":
        run = features(name, 300, ord(name), bias=False, sf=True)
        runs.append(replace(run, sf_error_ppm=3.0 * run.t_in + (0.0 if name == "a" else 40.0)))
    found = anchor_runs(runs)
    levels = [float(np.mean(run.sf_error_ppm - 3.0 * run.t_in)) for run in found]
    assert levels[0] == pytest.approx(levels[1], abs=1.0) and found[0].bias_dph is None
    noisy = [replace(run, sf_error_ppm=run.sf_error_ppm + rng.normal(0.0, 0.5, 300)) for run in found]
    assert target_noise(noisy).keys() == {"sf_error_ppm"}
    terms = [run.t_in[:, None] for run in noisy]
    for fitted in (fit_ordinary(terms, noisy), *fit_ridge(terms, noisy, [1e-9])):
        assert fitted.coefficients[0, 1] / fitted.scale[0] == pytest.approx(3.0, abs=0.02)
        assert not fitted.coefficients[:, 0].any() and fitted.intercept[0] == 0.0
    for model in (StepwiseModel(), LaggedRidgeModel()):
        model.fit(noisy, ())
        predicted = model.predict(noisy[0])
        assert np.std(predicted.sf_error_ppm - 3.0 * noisy[0].t_in) < 0.3 and not predicted.bias_dph.any()
    scores = _left_out_scores(terms, noisy)
    assert np.isinf(scores[:, 0]).all() and scores[0, 1] == pytest.approx(0.55, abs=0.1)
    # of one run alone nothing is left to be fitted when it is left out
    assert np.isinf(_left_out_scores(terms[:1], noisy[:1])).all()


@pytest.mark.parametrize(
    ("known", "there"), [([0, 3], True), ([1], False), ([2, 3], True), ([0, 1, 2], True)]
)
def test_at_the_end_of_a_series_half_of_the_window_that_there_is_will_do(known, there):
    """Of five around the second sample there are four: two of them are enough, at either end."""
    values = np.full(30, np.nan)
    values[known] = np.array([3.0, 5.0, 10.0])[: len(known)]
    found = centred_mean(values, 5)[1]
    assert (found == pytest.approx(np.nanmean(values))) if there else math.isnan(found)
    assert centred_mean(values[::-1].copy(), 5)[-2] == pytest.approx(found, nan_ok=True)


def test_sections_of_a_folder_are_grouped_and_end_where_the_next_one_begins(monkeypatch):
    """Two groups of two rates, recorded in turn; the last section ends where the test is closed."""
    asked = []
    told = ((10.0, 7, 5.0), (400.0, 3, 20.0), (800.0, 7, -5.0), (1200.0, 3, -20.0))
    sections = [(at_s, SimpleNamespace(group=group, rate_dps=rate)) for at_s, group, rate in told]
    kept = list(sections)
    run = SimpleNamespace(
        of=lambda kind: kept, checksum="sum", manifest=SimpleNamespace(run_id="r"),
        phases=lambda: (Phase("reference", 10.0, 1500.0), Phase("close", 1500.0, 1600.0)),
    )  # fmt: skip
    group = ThermalRun("x", "u", *(np.zeros(3),) * 3, None, np.zeros(3), (0.0, 1.0))
    monkeypatch.setattr(_dataset, "Run", SimpleNamespace(open=lambda folder: run))
    monkeypatch.setattr(_dataset, "gyros_of", lambda run, names: names or ("first", "second"))
    monkeypatch.setattr(_dataset, "_rate_run", lambda run, *rest: asked.append(rest) or rest[1])
    monkeypatch.setattr(_dataset, "scale_factor_group", lambda rates: replace(group, phases=[*rates]))
    found = load_thermal_runs(Path("f"))
    assert asked == [("first", 5.0, 10.0, 400.0), ("first", 20.0, 400.0, 800.0),
                     ("first", -5.0, 800.0, 1200.0), ("first", -20.0, 1200.0, 1500.0)]  # fmt: skip
    assert [each.run_id for each in found] == ["r group 7", "r group 3"]
    assert [each.phases for each in found] == [[5.0, -5.0], [20.0, -20.0]]
    assert {each.checksum for each in found} == {"sum"} and found[0].meta == {"gyro": "first"}
    kept[:] = sections[::2]
    (alone,) = load_thermal_runs(Path("f"), "second")
    assert (alone.run_id, alone.meta, asked[-1]) == ("r", {"gyro": "second"}, ("second", -5.0, 800.0, 1500.0))


def test_every_epoch_has_its_own_learning_rate_and_the_best_ones_weights_stay(monkeypatch):
    """Half a cosine from 0.9 to 0.1 in five epochs; the loss is lowest after the third."""
    settings = LstmSettings(hidden=2, epochs=5, learning_rate=0.9, final_learning_rate=0.1, warm_up=1)
    weights = _initial_weights(settings, *(np.full(3, edge) for edge in (-1.0, 1.0)), np.zeros(2), np.ones(2))
    network, head = _lstm_training._network(weights)
    rates, losses = [], iter((5.0, 4.0, 2.0, 3.0, 2.0))

    def epoch(network, head, batch, optimiser, settings):
        rates.extend(group["lr"] for group in optimiser.param_groups)
        with torch.no_grad():
            head.bias.fill_(float(len(rates)))

    monkeypatch.setattr(_lstm_training, "_epoch", epoch)
    monkeypatch.setattr(_lstm_training, "_loss_of", lambda *parts: next(losses))
    _lstm_training._descend(network, head, None, None, settings)
    shape = 0.4 * math.sqrt(0.5)
    assert rates == pytest.approx([0.9, 0.5 + shape, 0.5, 0.5 - shape, 0.1])
    assert head.bias.tolist() == [3.0, 3.0]


def test_a_stretch_without_targets_changes_nothing_and_spoils_nothing():
    """Ten steps that teach, ten of which nothing is known, ten that teach: as if the middle had no step."""
    settings = LstmSettings(hidden=2, chunk=10, warm_up=0, seed=3)
    weights = _initial_weights(settings, np.full(3, -1.0), np.ones(3), np.zeros(2), np.ones(2))
    network, head = _lstm_training._network(weights)
    rng = np.random.default_rng(0)
    mask = np.ones((20, 1, 2))
    mask[10:] = 0.0
    parts = (rng.normal(size=(20, 1, 3)), np.ones((20, 1, 2)), mask, mask)
    whole = _Batch(*(torch.tensor(part, dtype=torch.float32) for part in parts))
    first = _Batch(*(torch.tensor(part[:10], dtype=torch.float32) for part in parts))
    found = []
    for batch in (whole, first):
        network, head = _lstm_training._network(weights)
        optimiser = torch.optim.SGD([*network.parameters(), *head.parameters()], lr=0.1)
        _lstm_training._epoch(network, head, batch, optimiser, settings)
        found.append(
            [parameter.detach().numpy() for parameter in (*network.parameters(), *head.parameters())]
        )
    for one, other in zip(*found, strict=True):
        assert np.isfinite(one).all() and one == pytest.approx(other)
    assert found[0][-1] != pytest.approx(weights.b_output, abs=1e-4)


def test_a_mean_that_runs_empty_between_two_steps_holds_its_last_value():
    """One reading a second, a step a minute; the case is silent from 300 s on, the gyro from 500 to 700 s.

    The last known value leaves the window of 100 s behind 598 s, between the steps at 540 and at 600 s.
    """
    stream, steps = FeatureStream(60), {}
    for second in range(900):
        inside = math.nan if 500 <= second < 700 else 0.01 * second
        case = math.nan if second >= 300 else 20.0 + 0.02 * second
        found = stream.push(inside, case)
        assert (found is None) == (second % 60 != 0)
        steps[second] = found
    t_in = {second: found[0] for second, found in steps.items() if found is not None}
    assert t_in[480] == pytest.approx(4.80 - 0.495) and t_in[540] == pytest.approx((4.41 + 4.99) / 2.0)
    assert t_in[600] == t_in[660] == pytest.approx(4.99)
    assert t_in[720] == pytest.approx((7.00 + 7.20) / 2.0)
    # the case's last value is that of 299 s, alone in its window at 398 s
    assert [steps[second][1] for second in (420, 600, 840)] == pytest.approx([25.98] * 3)
    assert steps[600][3] == pytest.approx(4.99 - 25.98)
    # of changes over a minute the last one known is that of 499 s, and they come back a minute behind the gyro
    assert [steps[second][2] for second in (480, 540, 600, 720)] == pytest.approx([0.6] * 4)
