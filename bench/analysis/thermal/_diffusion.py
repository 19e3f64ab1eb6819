"""Heat in a fibre coil between two measured temperatures: a chain of layers and one slow relaxation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from drivers.base.arrays import Array

NODES = 10
"""Layers of the chain, inside to outside."""


@dataclass(frozen=True)
class Diffusion:
    """dx/dt = a x + b u: x = layer temperatures and a relaxation state, u = (T_in, T_out), in degC and s.

    `step_matrix` (11, 11) and `input_matrix` (11, 2) advance x over one step with u held at its new value;
    `rest` (11, 2) is the steady state for constant u.
    """

    a: Array
    b: Array
    step_matrix: Array
    input_matrix: Array
    rest: Array

    def rates(self, states: Array, inputs: Array) -> Array:
        """Return dx/dt in degC/min for states (..., 11) and inputs (..., 2)."""
        return np.asarray((states @ self.a.T + inputs @ self.b.T) * 60.0)

    def advance(self, state: Array, inputs: Array) -> Array:
        """Return the state one step later, (..., 11) and (..., 2) -> (..., 11)."""
        return np.asarray(state @ self.step_matrix.T + inputs @ self.input_matrix.T)

    def simulate(self, inputs: Array) -> Array:
        """Return the states after each step, (n, runs, 2) -> (n, runs, 11), from rest at the first input."""
        driven = inputs @ self.input_matrix.T
        carry = self.step_matrix.T
        states = np.empty((*inputs.shape[:2], NODES + 1))
        state = inputs[0] @ self.rest.T
        for k in range(len(inputs)):
            state = state @ carry + driven[k]
            states[k] = state
        return states


def diffusion(k_in: float, k_out: float, k_layer: float, k_relax: float, step_s: float) -> Diffusion:
    """Return the chain for exchange rates in 1/s: T_in to layer 1, T_out to the last layer, layer to layer.

    The relaxation state follows the mean of the layers at `k_relax`. All rates must be positive.
    """
    a, b = np.zeros((NODES + 1, NODES + 1)), np.zeros((NODES + 1, 2))
    for j in range(NODES - 1):
        a[j, j + 1] = a[j + 1, j] = k_layer
        a[j, j] -= k_layer
        a[j + 1, j + 1] -= k_layer
    a[0, 0] -= k_in
    b[0, 0] = k_in
    a[NODES - 1, NODES - 1] -= k_out
    b[NODES - 1, 1] = k_out
    a[NODES, :NODES] = k_relax / NODES
    a[NODES, NODES] = -k_relax
    whole = np.zeros((NODES + 3, NODES + 3))
    whole[: NODES + 1, : NODES + 1], whole[: NODES + 1, NODES + 1 :] = a, b
    step = expm(whole * step_s)
    rest = np.asarray(-np.linalg.solve(a, b), dtype=np.float64)
    return Diffusion(a, b, step[: NODES + 1, : NODES + 1], step[: NODES + 1, NODES + 1 :], rest)
