"""Emulated platform runs shared by the heading tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bench.analysis.heading import PlatformLog
from simulators.plant.space_stable import PlatformParameters, SpaceStablePlatform, draw_platform

STEP_S = 300.0
SIX = tuple((60.0 * k, 48.0) for k in range(6))


def _fly(
    parameters: PlatformParameters,
    seed: int,
    stays: tuple[tuple[float, float], ...],
    navigation: str = "linear",
) -> tuple[PlatformLog, PlatformLog, SpaceStablePlatform]:
    """Return (alignment, run) after ten warm days at heading 0."""
    platform = SpaceStablePlatform(parameters, seed, STEP_S, navigation=navigation)  # type: ignore[arg-type]
    logs = []
    for hours in (((0.0, 240.0),), stays):
        samples = platform.advance(np.concatenate([np.full(round(h * 12), psi) for psi, h in hours]))
        logs.append(
            PlatformLog(
                samples.time_s,
                samples.angle_rad,
                samples.north_as,
                samples.east_as,
                samples.temp_c,
                samples.heading_deg,
                parameters.latitude_deg,
                2.0 * parameters.damping * 806.8,
            )
        )
        platform.align()
    return logs[0], logs[1], platform


@pytest.fixture(scope="session")
def fly() -> Callable[..., tuple[PlatformLog, PlatformLog, SpaceStablePlatform]]:
    """The function that flies a platform: (parameters, seed, ((heading, hours), ...), navigation)."""
    return _fly


@pytest.fixture(scope="session")
def calibration() -> tuple[PlatformLog, PlatformLog]:
    """Alignment and six headings of 48 h of plant 3, with noise."""
    return _fly(draw_platform(3), 1003, SIX)[:2]
