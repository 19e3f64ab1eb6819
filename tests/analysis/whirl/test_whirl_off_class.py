"""Bearings that the fit was not made for: lines up to 20, memory of the angle, lines that change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from bench.analysis.whirl._change import change_findings
from bench.analysis.whirl._compensation import WhirlCompensation
from bench.analysis.whirl._direct import fit_direct, fit_memory
from bench.analysis.whirl._lines import choose_lines
from bench.analysis.whirl._residual import make_blocks, residual_increments
from bench.analysis.whirl._types import Complex
from benchmarks.off_class._bearings import FAMILIES, Bearing, lines_of, played, record
from drivers.base.arrays import Array

LINES = (-1.0, 1.0, 2.0, 3.0)


def told(bearing: Bearing, seed: int, judged: Sequence[Bearing] = (), **settings: float) -> list[str]:
    """Return code and line of what a fit of short runs tells of a bearing."""
    fit = fit_direct([record(bearing, seed, stretches=4, turns=2.0)[0]], LINES)
    others = [record(other, seed + 1, stretches=4, turns=2.0)[0] for other in judged]
    return [f"{found.code} {found.text.split()[1]}" for found in change_findings(fit, others)]


def test_lines_up_to_twenty_are_chosen_by_the_data() -> None:
    run, _ = record(FAMILIES["races, lines to 20"], 3, stretches=2)
    assert {-17.0, -12.0, 9.0, 11.0, 16.0, 20.0} <= set(choose_lines([run]))


@pytest.mark.parametrize("travel_deg", [1.0, 6.0, 12.0])
def test_the_travel_of_play_is_found_with_its_size(travel_deg: float) -> None:
    run, _ = record(played(travel_deg, 5.0 - 2.0j), 4, stretches=4, turns=2.0)
    fit = fit_memory([run], LINES)
    assert len(fit.travels_deg) == 1
    assert fit.travels_deg[0] == pytest.approx(travel_deg, rel=0.1)
    assert fit.play_arcsec is not None and fit.play_arcsec.value == pytest.approx(5.0 - 2.0j, abs=0.35)
    usual = fit_direct([run], LINES)
    assert fit.noise_arcsec_per_sqrt_s < usual.noise_arcsec_per_sqrt_s


def test_without_play_the_travel_stays_as_it_was() -> None:
    run, _ = record(FAMILIES["usual lines (in class)"], 5, stretches=4, turns=2.0)
    assert fit_memory([run], LINES).travels_deg == (0.5,)


def test_friction_is_made_up_of_plays_and_its_loop_is_that_of_another_reversal() -> None:
    """A shaft that comes over as 1 - exp(-angle / 4 deg): the jump within 4, 8, 16 deg of the turning point."""
    run, _ = record(FAMILIES["friction, exponential"], 6, stretches=6, turns=2.0)
    fit = fit_memory([run], LINES)
    assert len(fit.travels_deg) > 1
    made = WhirlCompensation.from_fit(fit, "U", {}, gauge="mean")
    back = np.radians(np.array([0.0, 4.0, 8.0, 16.0]))
    angle = np.concatenate([[0.0, 10.0], 10.0 - back[1:]])
    jump = made.tilt_arcsec(angle) - made.tilt_arcsec(angle[:1] + np.array([0.0]))[0]
    smooth = WhirlCompensation("U", fit.lines, fit.amplitudes_arcsec, fit.sd_arcsec, "mean", 0j)
    loop = (jump - smooth.tilt_arcsec(angle) + smooth.tilt_arcsec(np.zeros(1))[0])[1:]
    # The friction is +1 forward and -1 in reverse: it falls by 2 (1 - exp).
    expected = -2.0 * (2.0 - 1.0j) * (1.0 - np.exp(-back / np.radians(4.0)))
    assert loop == pytest.approx(expected, abs=0.25)


def test_blocks_are_the_sum_of_the_increments_whatever_their_length() -> None:
    run, _ = record(played(3.0, 5.0 - 2.0j), 4, stretches=2, turns=2.0)
    blocks = make_blocks(run)
    whole = residual_increments(run) * np.exp(1j * run.middle_rad)
    assert blocks.reverses and {0.2, 1.0} <= set(np.round(blocks.duration_s, 6))
    first, last = int(blocks.first[0]), int(blocks.last[-1])
    assert blocks.increment_arcsec.sum() == pytest.approx(whole[first:last].sum())
    assert blocks.duration_s.sum() == pytest.approx(run.time_s[last] - run.time_s[first])
    # At the start nobody knows from where the bearing came: 30 deg are left out.
    assert np.degrees(abs(blocks.first_rad[0] - run.angle_rad[0])) == pytest.approx(30.0, abs=6.5)


def grown(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    return FAMILIES["usual lines (in class)"](time_s, angle, rng) + (
        0.7 * time_s / time_s[-1] * lines_of({3.0: 1.0 + 0j})(angle)
    )


def other_in_reverse(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    reverse = np.gradient(angle) < 0.0
    return FAMILIES["usual lines (in class)"](time_s, angle, rng) + (
        0.6 * reverse * lines_of({2.0: 1.0j, 0.0: -1.0j})(angle)
    )


def mounted_anew(time_s: Array, angle: Array, rng: np.random.Generator) -> Complex:
    return FAMILIES["usual lines (in class)"](time_s, angle, rng) + lines_of({-1.0: 0.8 + 0j})(angle)


def test_a_line_that_changes_is_named_and_no_other() -> None:
    usual = FAMILIES["usual lines (in class)"]
    assert told(grown, 8) == ["change +3"]
    assert told(other_in_reverse, 8) == ["sense +2"]
    assert told(usual, 8, [mounted_anew]) == ["repeat -1"]


def test_a_bearing_that_does_not_change_is_said_nothing_of() -> None:
    """Ten bearings with play or without, each judged on another run: 1 % each of three findings."""
    usual, loose = FAMILIES["usual lines (in class)"], played(0.5, 5.0 - 2.0j)
    found = [told(bearing, seed, [bearing]) for bearing in (usual, loose) for seed in range(20, 25)]
    assert found == [[]] * 10
