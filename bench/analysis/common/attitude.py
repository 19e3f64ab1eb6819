"""Rotations of many samples: cross products, quaternions with their running product, matrices.

A product of turns is associative: it is found by a prefix product over blocks, no loop over samples.
"""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array

_BLOCK = 32


def cross_matrix(vector: Array) -> Array:
    """Return [v x], shape (..., 3, 3), of v (..., 3)."""
    v = np.asarray(vector, dtype=np.float64)
    skew = np.zeros((*v.shape, 3))
    for row, column, at in ((1, 2, 0), (2, 0, 1), (0, 1, 2)):
        skew[..., column, row] = v[..., at]
        skew[..., row, column] = -v[..., at]
    return skew


def rotations(vectors: Array) -> Array:
    """Return exp([v x]), shape (n, 3, 3), of rotation vectors (n, 3) in rad."""
    return matrices(quaternions(vectors))


def running_rotation(vectors: Array) -> Array:
    """Return I, R_0, R_0 R_1, ..., shape (n + 1, 3, 3), of rotation vectors (n, 3) in rad."""
    return np.concatenate([np.eye(3)[None], matrices(_prefix_products(quaternions(vectors)))])


def whole_rotation(vectors: Array) -> Array:
    """Return R_0 R_1 ... R_(n - 1), (..., 3, 3), of rotation vectors (..., n, 3) in rad, n at least 1."""
    q = quaternions(vectors)
    while q.shape[-2] > 1:
        even = q.shape[-2] // 2 * 2
        # of an odd number the last waits for its turn
        q = np.concatenate((_product(q[..., 0:even:2, :], q[..., 1:even:2, :]), q[..., even:, :]), axis=-2)
    last = q[..., 0, :]
    return matrices(last / np.linalg.norm(last, axis=-1, keepdims=True))


def quaternions(vectors: Array) -> Array:
    """Return unit quaternions (..., 4), scalar first, of rotation vectors (..., 3)."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    half_sinc = np.sinc(angle / (2.0 * np.pi)) / 2.0
    return np.concatenate([np.cos(angle / 2.0), half_sinc * vectors], axis=-1)


def _product(p: Array, q: Array) -> Array:
    """Return quaternion products p q, (..., 4)."""
    a, b, c, d = (p[..., part] for part in range(4))
    e, f, g, h = (q[..., part] for part in range(4))
    made = np.empty(np.broadcast_shapes(p.shape, q.shape))
    made[..., 0] = a * e - b * f - c * g - d * h
    made[..., 1] = a * f + b * e + c * h - d * g
    made[..., 2] = a * g - b * h + c * e + d * f
    made[..., 3] = a * h + b * g - c * f + d * e
    return made


def _prefix_products(q: Array) -> Array:
    """Return q_0, q_0 q_1, q_0 q_1 q_2, ..., shape (n, 4): within blocks all at once, then over blocks."""
    count = len(q)
    if count == 1:
        return q
    blocks = -(-count // _BLOCK)
    padded = np.zeros((blocks * _BLOCK, 4))
    padded[:, 0] = 1.0
    padded[:count] = q
    inside = padded.reshape(blocks, _BLOCK, 4)
    for at in range(1, _BLOCK):
        inside[:, at] = _product(inside[:, at - 1], inside[:, at])
    if blocks > 1:
        before = _prefix_products(inside[:-1, -1].copy())
        inside[1:] = _product(before[:, None], inside[1:])
    whole = inside.reshape(-1, 4)[:count]
    return np.asarray(whole / np.linalg.norm(whole, axis=1, keepdims=True))


def matrices(q: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    skew = cross_matrix(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * q[..., :1, None] * skew + 2.0 * skew @ skew)
