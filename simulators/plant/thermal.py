"""Linear heat-flow networks driven by one air temperature, and their exact one-tick step.

State x: node temperatures, then first-order lags (sensors, stress relaxation). dx/dt = A x + B u with
u = (air temperature, 1). Over a tick u is held, so the step is exact: expm([[A, B], [0, 0]] dt).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.arrays import Array

AIR = "air"
_TERMS = 14
"""Of the exponential's series: at a norm of 1/4, the first one left out is 1e-21."""


@dataclass(frozen=True)
class Link:
    """Heat conductance between two nodes (or a node and `AIR`), W/K."""

    first: str
    second: str
    conductance_w_per_k: float


@dataclass(frozen=True)
class Lag:
    """A first-order follower of the mean of some nodes."""

    name: str
    follows: tuple[str, ...]
    time_constant_s: float


@dataclass(frozen=True)
class Network:
    """dx/dt = dynamics @ x + drive @ (air temperature, 1); shapes (n, n) and (n, 2); `names` (n,)."""

    names: tuple[str, ...]
    dynamics: Array
    drive: Array

    def row(self, *nodes: str) -> Array:
        """Return the row vector, float64 (n,), that averages the named states."""
        weights = np.zeros(len(self.names))
        for node in nodes:
            weights[self.names.index(node)] += 1.0 / len(nodes)
        return weights


def build_network(
    capacity_j_per_k: Mapping[str, float],
    links: Sequence[Link],
    power_w: Mapping[str, float],
    lags: Sequence[Lag] = (),
) -> Network:
    """Assemble a network from heat capacities, conductances, constant heat sources and lags."""
    names = (*capacity_j_per_k, *(lag.name for lag in lags))
    at = {name: index for index, name in enumerate(names)}
    dynamics = np.zeros((len(names), len(names)))
    drive = np.zeros((len(names), 2))
    for link in links:
        for here, there in ((link.first, link.second), (link.second, link.first)):
            if here == AIR:
                continue
            rate = link.conductance_w_per_k / capacity_j_per_k[here]
            dynamics[at[here], at[here]] -= rate
            if there == AIR:
                drive[at[here], 0] += rate
            else:
                dynamics[at[here], at[there]] += rate
    for node, watts in power_w.items():
        drive[at[node], 1] += watts / capacity_j_per_k[node]
    for lag in lags:
        dynamics[at[lag.name], at[lag.name]] -= 1.0 / lag.time_constant_s
        for node in lag.follows:
            dynamics[at[lag.name], at[node]] += 1.0 / (len(lag.follows) * lag.time_constant_s)
    return Network(names, dynamics, drive)


def case_and_inside(
    inside: str,
    capacity_j_per_k: tuple[float, float],
    conductance_w_per_k: tuple[float, float],
    power_w: float,
    sensor_lag_s: float,
    case_sensor_lag_s: float = 5.0,
) -> Network:
    """Return a case in the air and one body in it that makes heat, each with a sensor that lags.

    Capacities of case and body; conductances from air to case and from case to body. The states are `case`, the
    body's name, and these with `_sensor`.
    """
    capacity = dict(zip(("case", inside), capacity_j_per_k, strict=True))
    to_air, between = conductance_w_per_k
    links = (Link(AIR, "case", to_air), Link("case", inside, between))
    lags = (
        Lag(f"{inside}_sensor", (inside,), sensor_lag_s),
        Lag("case_sensor", ("case",), case_sensor_lag_s),
    )
    return build_network(capacity, links, {inside: power_w}, lags)


def tick_matrix(network: Network, of_state: Array, of_rate: Array, dt_s: float = 1.0) -> Array:
    """Return the matrix, float64 (n + m, n + 2), that takes (x, u) to (x after `dt_s`, m outputs there).

    Outputs are y = of_state @ x + of_rate @ dx/dt, both (m, n), at the end of the tick; dx/dt in K/s.
    """
    n = len(network.names)
    generator = np.zeros((n + 2, n + 2))
    generator[:n, :n] = network.dynamics
    generator[:n, n:] = network.drive
    step = _exponential(generator * dt_s)[:n]
    rate = network.dynamics @ step
    rate[:, n:] += network.drive
    return np.ascontiguousarray(np.vstack((step, of_state @ step + of_rate @ rate)))


def step_of(network: Network, outputs: Mapping[str, Array], rates: Collection[str] = ()) -> Array:
    """Return the `tick_matrix` of named outputs: a row (n,) each of states; of those in `rates`, of K/s."""
    of_rate = np.array([[name in rates] for name in outputs])
    rows = np.array(list(outputs.values()))
    return tick_matrix(network, np.where(of_rate, 0.0, rows), np.where(of_rate, rows, 0.0))


def _exponential(matrix: Array) -> Array:
    """Return the matrix exponential: Taylor series of a scaled matrix, squared back (Moler and Van Loan 2003, 3).

    scipy's own would be the better one for matrices that are not a heat network's; a lab starts without scipy.
    """
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 0.25)))) + 2)
    scaled = matrix / 2.0**squarings
    total = term = np.eye(len(matrix))
    for power in range(1, _TERMS + 1):
        term = term @ scaled / power
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return np.asarray(total)
