"""Somebody else's FMU as nominal: run where the benchmark has fetched it; nothing of it is kept here."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks._fetched import CACHE
from benchmarks._foreign_fmu import CONTROLLER, controller_of_dymola


def test_a_controller_that_dymola_compiled_is_a_nominal() -> None:
    pytest.importorskip("fmpy", reason="an FMU needs the extra fmu, which is not installed here")
    place, sha256 = CONTROLLER
    file = CACHE / f"{sha256[:12]}-{Path(place).name}"
    if not file.exists():
        pytest.skip("not fetched: python -m benchmarks.real_data --only 'FMU of a controller by Dymola'")
    assert all(said.right for said in controller_of_dymola(file))
