"""Heading changes of a platform: the effect withheld, named, closed; friction and nothing told from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import (
    Diagnosis,
    LogGap,
    Model,
    Noise,
    PositionFinding,
    closed_model,
    diagnose,
    log_gaps,
    model_text,
    parse_model,
)
from bench.analysis.gap._position import PositionRun
from bench.analysis.heading import PlatformLog
from bench.lab.emulated import Plant
from bench.present.cli._console import Terminal
from bench.present.cli.gap._rehearse import print_gaps
from drivers.base.errors import ConfigurationError, RecordError
from simulators.plant.space_stable import SpaceStablePlatform, draw_platform, with_heading_effect
from tests.analysis.heading.conftest import SIX, _fly

Fly = Callable[..., tuple[PlatformLog, PlatformLog, SpaceStablePlatform]]
NOMINAL = Model("heading change", (), Noise(0.003))
OTHER = ((0.0, 48.0), (120.0, 48.0), (240.0, 48.0), (300.0, 48.0), (180.0, 48.0))


def _run(seed: int, stays: tuple[tuple[float, float], ...] = SIX, **kwargs: float) -> PlatformLog:
    friction = kwargs.pop("friction_dph", 0.0)
    parameters = replace(draw_platform(seed, **kwargs), friction_dph=friction)  # type: ignore[arg-type]
    return _fly(parameters, 1000 + seed + len(stays), stays)[1]


def _recorded(**logs: PlatformLog) -> list[PositionRun]:
    return [PositionRun(name, "p", log, f"sum of {name}") for name, log in logs.items()]


def _position(found: Diagnosis) -> PositionFinding:
    assert found.position is not None
    return found.position


def test_the_withheld_heading_effect_is_named_and_closes_a_held_out_run() -> None:
    first, second = _run(3), _run(3, OTHER)
    diagnosis = diagnose(_recorded(a=first), NOMINAL, _recorded(b=second))
    found = _position(diagnosis)
    assert found.verdict == "explained"
    assert [(cause.name, cause.probability) for cause in found.causes] == [("heading_effect", 0.95)]
    assert found.null_probability < 1e-6
    (held,) = found.held_out
    assert held.low <= held.share <= held.high
    assert held.share > 0.95
    assert held.rms_after < 0.25 * held.rms_before
    # the strongest place is where the position error of the run itself is largest
    worst = max(found.stays, key=lambda place: place.share)
    errors = np.hypot(first.north_as, first.east_as)
    assert worst.heading_deg == pytest.approx(first.heading_deg[int(np.argmax(errors))], abs=1.0)
    closed = parse_model(model_text(closed_model(diagnosis)), "closed")
    assert closed.fitted_on == {"a": "sum of a"}
    (term,) = closed.channel_terms
    # the core's time constant, as the plant was drawn
    assert term.values[9] == pytest.approx(draw_platform(3).core_tau_h, rel=0.2)
    # the second run against the model that has the effect: nothing is left to name
    assert diagnose(_recorded(b=second), closed).verdict == "no gap"
    with pytest.raises(ConfigurationError, match="cannot judge"):
        diagnose(_recorded(b=second), closed, _recorded(a=first))


@pytest.mark.parametrize("seed", [4, 8])
def test_a_platform_without_the_effect_has_no_gap(seed: int) -> None:
    found = _position(diagnose(_recorded(a=_run(seed, effect_dph=1e-9)), NOMINAL))
    assert found.verdict == "no gap"
    assert not found.causes
    assert found.null_probability > 0.9


def test_friction_steps_with_heading_and_is_not_called_temperature() -> None:
    found = diagnose(_recorded(a=_run(5, effect_dph=1e-9, friction_dph=1e-3)), NOMINAL)
    (cause,) = found.causes
    assert cause.name == "heading_steps"
    assert cause.term is None
    assert not found.closing


def test_too_few_headings_are_refused() -> None:
    with pytest.raises(RecordError, match="at least three are needed"):
        diagnose(_recorded(a=_run(3, ((0.0, 48.0), (90.0, 48.0)))), NOMINAL)


def test_a_plant_drifts_as_its_heading_effect_says() -> None:
    own = draw_platform(3, in_class=True).quiet()
    level, up = np.cos(np.radians(own.latitude_deg)), np.sin(np.radians(own.latitude_deg))
    # drift is K (x * constant + x * gravity times the vertical, [level cos, level sin, up]): by hand
    gains = np.column_stack(
        (own.constant + up * own.gravity[:, 2], level * own.gravity[:, 0], level * own.gravity[:, 1])
    )
    values = [*(own.scale_dph * gains).ravel().tolist(), own.core_tau_h]
    headings = np.repeat([0.0, 60.0, 240.0], 400)
    drifts = [
        SpaceStablePlatform(each, 1).advance(headings).thermal_dph
        for each in (own, with_heading_effect(own, values), with_heading_effect(own, None))
    ]
    np.testing.assert_allclose(drifts[1], drifts[0], atol=1e-12)
    assert np.abs(drifts[0]).max() > 1e-4
    assert not drifts[2].any()


def test_rehearsals_with_the_closed_model_come_nearer_to_a_run_that_was_not_fitted() -> None:
    first, second = _run(3), _run(3, OTHER)
    (term,) = closed_model(diagnose(_recorded(a=first), NOMINAL)).channel_terms
    drawn = draw_platform(3)
    logs = [
        _fly(with_heading_effect(drawn, values), seed, OTHER)[1]
        for values, seed in ((None, 51), (term.values, 51), (term.values, 52))
    ]
    all_, *stays = log_gaps(*(_recorded(x=log) for log in (second, *logs))).headings
    assert [each.part for each in stays] == ["120 deg", "240 deg", "300 deg", "180 deg"]
    assert all_.share > 0.9
    assert all_.rms_closed < 0.35 * all_.rms_nominal
    assert all_.rms_floor < 0.35 * all_.rms_nominal


def test_a_platform_follows_its_model_and_no_other_sort_of_model(tmp_path: Path) -> None:
    nominal = tmp_path / "nominal.toml"
    nominal.write_text(model_text(NOMINAL))
    examples = Path(__file__).parents[3] / "examples" / "nominal"
    plant = Plant(gap_model={"PINS-001": nominal, "PINS-002": examples / "rlg_ramp.toml"})
    assert plant.platform_drift_of("PINS-001") is None
    with pytest.raises(ConfigurationError, match=r"cannot follow.*scale_factor"):
        plant.platform_drift_of("PINS-002")


def test_a_rehearsals_table_has_a_row_for_every_heading(capsys: pytest.CaptureFixture[str]) -> None:
    gaps = [
        LogGap("all", "arcsec", 289.7, 40.5, 35.6, 0.996),
        LogGap("60 deg", "arcsec", 3.0, 2.0, 9.0, np.nan),
    ]
    print_gaps(Terminal(width=80), "heading", "rms arcsec", gaps, ".1f")
    said = capsys.readouterr().out
    assert "289.7" in said and "99.6" in said and "nan" not in said
