"""Heading changes of a platform: the effect withheld, named, closed; friction and nothing told from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bench.gap import Model, Noise, diagnose_platform, model_text, parse_model, platform_closed
from bench.heading import PlatformLog
from drivers.errors import ConfigurationError, RecordError
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform
from tests.heading.conftest import SIX, _fly

Fly = Callable[..., tuple[PlatformLog, PlatformLog, SpaceStablePlatform]]
NOMINAL = Model("heading change", (), Noise(0.003))
OTHER = ((0.0, 48.0), (120.0, 48.0), (240.0, 48.0), (300.0, 48.0), (180.0, 48.0))


def _run(seed: int, stays: tuple[tuple[float, float], ...] = SIX, **kwargs: float) -> PlatformLog:
    friction = kwargs.pop("friction_dph", 0.0)
    parameters = replace(draw_platform(seed, **kwargs), friction_dph=friction)  # type: ignore[arg-type]
    return _fly(parameters, 1000 + seed + len(stays), stays)[1]


def test_the_withheld_heading_effect_is_named_and_closes_a_held_out_run() -> None:
    first, second = _run(3), _run(3, OTHER)
    found = diagnose_platform("p", {"a": first}, NOMINAL, {"b": second}, {"a": "sum of a"})
    assert found.verdict == "explained"
    assert set(found.causes) == {"heading_effect"}
    assert found.causes["heading_effect"] == 0.95
    assert found.null_probability < 1e-6
    (held,) = found.held_out
    assert held.low <= held.share <= held.high
    assert held.share > 0.95
    assert held.rms_after_as < 0.25 * held.rms_before_as
    # the strongest place is where the position error of the run itself is largest
    worst = max(found.places, key=lambda place: place.share)
    errors = np.hypot(first.north_as, first.east_as)
    assert worst.heading_deg == pytest.approx(first.heading_deg[int(np.argmax(errors))], abs=1.0)
    closed = parse_model(model_text(platform_closed(found, NOMINAL)), "closed")
    assert closed.fitted_on == {"a": "sum of a"}
    (term,) = closed.channel_terms
    # the core's time constant, as the plant was drawn
    assert term.values[9] == pytest.approx(draw_platform(3).core_tau_h, rel=0.2)
    # the second run against the model that has the effect: nothing is left to name
    assert diagnose_platform("p", {"b": second}, closed).verdict == "no gap"
    with pytest.raises(ConfigurationError, match="cannot judge"):
        diagnose_platform("p", {"b": second}, closed, {"a": first})


@pytest.mark.parametrize("seed", [4, 8])
def test_a_platform_without_the_effect_has_no_gap(seed: int) -> None:
    found = diagnose_platform("p", {"a": _run(seed, effect_dph=1e-9)}, NOMINAL)
    assert found.verdict == "no gap"
    assert not found.causes
    assert found.null_probability > 0.9


def test_friction_steps_with_heading_and_is_not_called_temperature() -> None:
    found = diagnose_platform("p", {"a": _run(5, effect_dph=1e-9, friction_dph=1e-3)}, NOMINAL)
    assert set(found.causes) == {"heading_steps"}
    assert found.term is None


def test_too_few_headings_are_refused() -> None:
    with pytest.raises(RecordError, match="at least three are needed"):
        diagnose_platform("p", {"a": _run(3, ((0.0, 48.0), (90.0, 48.0)))}, NOMINAL)
