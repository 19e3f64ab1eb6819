"""The constants against figures printed elsewhere, and that nobody writes them out a second time."""

import ast
import math
from pathlib import Path

import pytest

from drivers.base import constants
from drivers.base.constants import EARTH_RATE_DPH, EARTH_RATE_RAD_S, earth_rate_north_dph, earth_rate_up_dph

ROOT = Path(__file__).parents[2]
HOME = ROOT / "drivers" / "base" / "constants.py"


def test_the_earths_rate_is_the_same_in_both_units() -> None:
    assert math.degrees(EARTH_RATE_RAD_S) * 3600.0 == pytest.approx(EARTH_RATE_DPH, rel=1e-8)
    assert 2.0 * math.pi / EARTH_RATE_RAD_S == pytest.approx(86164.1, abs=0.05)  # IERS: 86164.0989 s


def test_the_earths_rate_at_a_place() -> None:
    """39.1 deg north: 9.486 deg/h up; 0.1 deg off east lets 0.02037 deg/h of the north component in."""
    assert earth_rate_up_dph(39.1) == pytest.approx(9.4860, abs=1e-3)
    assert earth_rate_north_dph(39.1) * math.sin(math.radians(0.1)) == pytest.approx(0.02037, abs=1e-5)
    assert math.hypot(earth_rate_north_dph(-61.0), earth_rate_up_dph(-61.0)) == pytest.approx(EARTH_RATE_DPH)
    assert earth_rate_up_dph(-61.0) < 0.0


@pytest.mark.parametrize(("latitude_deg", "mps2"), [(0.0, 9.7803253359), (90.0, 9.8321849379)])
def test_normal_gravity_at_equator_and_pole(latitude_deg: float, mps2: float) -> None:
    """NIMA TR8350.2, table 3.4."""
    assert constants.gravity_mps2(latitude_deg) == pytest.approx(mps2, abs=1e-9)
    assert mps2 - constants.gravity_mps2(latitude_deg, 1000.0) == pytest.approx(3.086e-3)


def test_constants_are_written_once() -> None:
    values = {
        node.value
        for node in ast.walk(ast.parse(HOME.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value > 0.0
    } - {1e-6, 1.0, 2.0, 3600.0}
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.value}"
        for room in ("bench", "drivers", "procedures", "simulators")
        for path in (ROOT / room).rglob("*.py")
        if path != HOME
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and type(node.value) is float and node.value in values
    ]
    assert wrong == []
