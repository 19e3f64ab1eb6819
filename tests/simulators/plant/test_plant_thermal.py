"""Heat flow: fixed point, energy balance, step against independent integration; Shupe's integral in closed form.

Figures of checks 1 to 4 are those of the thermal design notes.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from benchmarks._thermal_runs import RunSetup, _shock, _start, simulate_thermal_run
from benchmarks._without import without
from simulators.plant.chamber import ChamberAir, ChamberDemand, ChamberParameters
from simulators.plant.fog import fog_network, shupe_row
from simulators.plant.fog_parameters import FOG_MID, FOG_NAV, FogParameters, spread
from simulators.plant.noise import NoiseSource
from simulators.plant.shupe import (
    Fibre,
    Winding,
    layer_weights_m2,
    pigtail_weight_m2,
    rotation_per_integral_dph,
)
from simulators.plant.thermal import AIR, Lag, Link, build_network, tick_matrix

WINDINGS = ("cylinder", "dipole", "quadrupole")


@pytest.mark.parametrize("grade", [FOG_MID, FOG_NAV])
def test_steady_state_is_a_fixed_point_and_passes_the_board_power(grade: FogParameters) -> None:
    network = fog_network(grade)
    state = np.linalg.solve(network.dynamics, -network.drive @ [-20.0, 1.0])
    n = len(network.names)
    step = tick_matrix(network, np.eye(n), np.eye(n))
    after = step @ np.concatenate((state, [-20.0, 1.0]))
    np.testing.assert_allclose(after[:n], state, atol=1e-9)
    case, fixture = (state[network.names.index(name)] for name in ("case", "fixture"))
    to_air = 1.5 * (case + 20.0) + 2.0 * (fixture + 20.0)
    assert to_air == pytest.approx(3.0, abs=1e-9)


def test_slowest_time_constants() -> None:
    poles = np.sort(-1.0 / np.linalg.eigvals(fog_network(FOG_MID).dynamics).real)[::-1]
    np.testing.assert_allclose(poles[:4], [2700.0, 1158.0, 687.0, 272.0], rtol=0.005)


def test_tick_equals_independent_integration() -> None:
    network = fog_network(replace(FOG_MID, layers=8))
    n = len(network.names)
    step = tick_matrix(network, np.eye(n), np.eye(n), dt_s=1.0)
    state = np.linspace(20.0, 30.0, n)
    after = step @ np.concatenate((state, [-40.0, 1.0]))
    drive = network.drive @ [-40.0, 1.0]
    solved = solve_ivp(lambda _, x: network.dynamics @ x + drive, (0.0, 1.0), state, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(after[:n], solved.y[:, -1], atol=1e-8)
    rate_plus_state = solved.y[:, -1] + network.dynamics @ solved.y[:, -1] + drive
    np.testing.assert_allclose(after[n:], rate_plus_state, atol=1e-7)


def test_one_node_cools_exponentially_and_its_lag_follows() -> None:
    network = build_network({"a": 50.0}, [Link(AIR, "a", 0.5)], {}, [Lag("sensor", ("a",), 10.0)])
    step = tick_matrix(network, np.eye(2), np.zeros((2, 2)))
    state = np.array([100.0, 100.0, 0.0, 1.0])
    for _ in range(100):
        state[:2] = (step @ state)[:2]
    decay, lag = np.exp(-100 / 100.0), np.exp(-100 / 10.0)
    assert state[0] == pytest.approx(100.0 * decay, rel=1e-9)
    expected = 100.0 * (100.0 * decay - 10.0 * lag) / 90.0
    assert state[1] == pytest.approx(expected, rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(5.0, 40.0), min_size=4, max_size=60),
    st.sampled_from(WINDINGS),
    st.floats(-0.1, 0.1),
)
def test_uniform_warming_of_any_winding_is_not_rotation(
    lengths: list[float], winding: str, offset: float
) -> None:
    weights = layer_weights_m2(np.array(lengths), winding, offset)  # type: ignore[arg-type]
    assert weights.sum() + pigtail_weight_m2(weights) == pytest.approx(0.0, abs=1e-6)


def test_cylinder_with_linear_gradient_has_the_integral_of_the_continuum() -> None:
    # Tdot = 1e-3 K/s x z/L: Int z/L (2z - L) dz = L^2/6
    layers, length = 2000, 1000.0
    weights = layer_weights_m2(np.full(layers, length / layers), "cylinder")
    rate = 1e-3 * (np.arange(layers) + 0.5) / layers
    integral = float(weights @ rate)
    assert integral == pytest.approx(length**2 / 6.0 * 1e-3, rel=1e-3)
    assert integral == pytest.approx(166.667, rel=1e-3)
    assert integral * rotation_per_integral_dph(Fibre(1000.0, 0.08)) == pytest.approx(7.265, rel=1e-3)


def test_weights_equal_numerical_integration_along_the_fibre() -> None:
    lengths, layers = np.full(8, 2.0), "ABBAABBA"
    weights = layer_weights_m2(lengths, "quadrupole")
    z = np.linspace(0.0, 16.0, 1_600_001)
    density = 2.0 * z - 16.0
    order_a = [index for index, half in enumerate(layers) if half == "A"]
    order_b = [index for index, half in enumerate(layers) if half == "B"]
    along = order_a[::-1] + order_b
    for place, layer in enumerate(along):
        part = (z >= 2.0 * place) & (z <= 2.0 * (place + 1))
        assert weights[layer] == pytest.approx(np.trapezoid(density[part], z[part]), abs=1e-3)


@pytest.fixture(scope="module")
def node_rates() -> np.ndarray:
    """Node rates in K/s over the nominal shock, from the air at the unit and the network alone, (n, nodes)."""
    network = fog_network(FOG_MID)
    n = len(network.names)
    step = tick_matrix(network, np.eye(n), np.zeros((n, n)))[:n]
    air = ChamberAir(ChamberParameters(), 25.0, NoiseSource(0, "chamber"))
    state = np.full(n + 2, 25.0)
    state[-1] = 1.0
    rates, start = [], 0.0
    for phase in [*_start(25.0, 90.0), *_shock(-45.0, 25.0, 12.0, 75.0, 90.0)]:
        ramp = phase.ramp_k_per_min
        air.apply(ChamberDemand(start, phase.set_point_c, ramp, ramp, True))
        for tick in range(int(start), int(start + phase.duration_s)):
            air.tick()
            state[n] = air.unit_air_c(tick + 1)
            state[:n] = step @ state
            rates.append(network.dynamics @ state[:n] + network.drive @ state[n:])
        start += phase.duration_s
    return np.array(rates)


@pytest.mark.parametrize(
    ("winding", "offset_m", "expected_dph"),
    [
        ("cylinder", 0.0, 56.14),
        ("dipole", 0.0, 3.475),
        ("quadrupole", 0.0, 0.2902),
        ("quadrupole", 0.02, 0.1761),
    ],
)
def test_shupe_peak_of_each_winding(
    node_rates: np.ndarray, winding: Winding, offset_m: float, expected_dph: float
) -> None:
    coil = replace(FOG_MID, winding=winding, mid_point_offset_m=offset_m, turn_error_m=0.0)
    row = shupe_row(coil, fog_network(coil), unit_seed=0)
    assert np.abs(node_rates @ row).max() == pytest.approx(expected_dph, rel=0.02)


def test_units_differ_and_unit_zero_is_nominal() -> None:
    assert spread(FOG_MID, 0) == FOG_MID
    slopes = [spread(FOG_MID, seed).coefficients.board_linear_ppm_per_k / 4.5 for seed in range(1, 400)]
    assert np.std(slopes) == pytest.approx(0.20 * 0.954, rel=0.1)  # normal, cut at two sigma
    assert min(slopes) >= 0.6 - 1e-12
    assert max(slopes) <= 1.4 + 1e-12


@pytest.mark.parametrize(("grade", "bias_dph", "sf_ppm"), [("mid", 0.469, 388.0), ("nav", 0.0325, 172.0)])
def test_nominal_shock_has_the_design_figures(grade: str, bias_dph: float, sf_ppm: float) -> None:
    profile = [*_start(25.0, 90.0), *_shock(-45.0, 25.0, 12.0, 75.0, 90.0)]
    data = simulate_thermal_run(profile, RunSetup(model=f"fog_{grade}"))  # type: ignore[arg-type]
    assert len(data.time_s) == 16_000
    assert np.ptp(data.true_bias_dph) == pytest.approx(bias_dph, rel=0.02)
    assert np.ptp(data.true_sf_error_ppm) == pytest.approx(sf_ppm, rel=0.01)
    if grade == "mid":
        assert np.abs(data.coil_rate_k_per_min).max() == pytest.approx(2.13, rel=0.01)


@pytest.mark.parametrize(
    ("alone", "expected_dph"),
    [
        (("coil_static", "board_static"), 0.199),
        (("shupe",), 0.324),
        (("winding_stress",), 0.170),
        (("bias_relaxation",), 0.125),
    ],
)
def test_each_effect_alone_has_the_design_figure(alone: tuple[str, ...], expected_dph: float) -> None:
    names = {
        "bias_offset",
        "coil_static",
        "board_static",
        "shupe",
        "winding_stress",
        "bias_relaxation",
        "turn_on",
    }
    profile = [*_start(25.0, 90.0), *_shock(-45.0, 25.0, 12.0, 75.0, 90.0)]
    data = simulate_thermal_run(profile, RunSetup(change=without(*(names - set(alone)))))
    assert np.ptp(data.true_bias_dph) == pytest.approx(expected_dph, rel=0.02)
