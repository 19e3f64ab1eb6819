"""The plant's own numerical routines against scipy's, and what a lab imports at its start."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import lfilter

from bench.lab.emulated import Plant, lab_config
from bench.lab.testing import usual_bench
from simulators.plant.noise import follow
from simulators.plant.thermal import AIR, Lag, Link, build_network, tick_matrix


@given(
    count=st.integers(1, 200),
    columns=st.sampled_from([(), (1,), (3,)]),
    decay=st.floats(0.0, 1.0),
    seed=st.integers(0, 99),
)
def test_a_recursion_is_the_filter_of_one_pole(count, columns, decay, seed):
    driven = np.random.default_rng(seed).standard_normal((count, *columns))
    expected = lfilter([1.0], [1.0, -decay], driven, axis=0)
    assert follow(driven, decay) == pytest.approx(expected, rel=1e-11, abs=1e-11)


@given(
    conductance=st.floats(1e-3, 50.0),
    capacity=st.floats(1.0, 1e4),
    time_constant_s=st.floats(0.05, 1e4),
    dt_s=st.sampled_from([0.01, 1.0, 600.0]),
)
def test_a_tick_is_the_exponential_of_the_network(conductance, capacity, time_constant_s, dt_s):
    network = build_network(
        {"case": capacity, "coil": 50.0},
        [Link("case", "coil", conductance), Link("case", AIR, 2.0)],
        {"coil": 3.0},
        [Lag("sensor", ("case", "coil"), time_constant_s)],
    )
    generator = np.zeros((5, 5))
    generator[:3] = np.hstack((network.dynamics, network.drive))
    nothing = np.zeros((0, 3))
    assert tick_matrix(network, nothing, nothing, dt_s) == pytest.approx(
        expm(generator * dt_s)[:3], rel=1e-9, abs=1e-11
    )


def loaded_by_a_lab(names: str) -> str:
    code = f"import sys, simulators.lab.__main__; print([m for m in {names.split()} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return found.stdout.strip()


def test_a_lab_starts_without_scipy():
    assert loaded_by_a_lab("scipy pandas torch can") == "[]"


def test_a_lab_starts_without_pydantic():
    assert loaded_by_a_lab("pydantic") == "[]"


def test_a_lab_of_a_fog_is_built_without_pydantic():
    file = usual_bench(None)
    config = lab_config(file.model_copy(update={"gyro": file.gyro[:1]}), Plant())
    code = """import sys
from simulators.config import LabConfig
from simulators.lab._build import build_lab
build_lab(LabConfig.from_line(sys.stdin.buffer.read()))
sys.exit("pydantic" in sys.modules)"""
    subprocess.run([sys.executable, "-c", code], input=config.to_line(), check=True)
