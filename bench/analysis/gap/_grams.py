"""Gram matrices of whitened runs: numpy on the processor, one batched product on a CUDA device."""

from __future__ import annotations

import numpy as np

from bench.analysis.common.device import CPU, compute_device
from drivers.base.arrays import Array


def gram_blocks(rows: Array, device: str | None = None) -> list[Array]:
    """Return each run's products of its rows, (p, p), of rows (runs, p, n); `device`: see `compute_device`."""
    device = compute_device() if device is None else device
    return [own @ own.T for own in rows] if device == CPU else with_torch(rows, device)


def with_torch(rows: Array, device: str) -> list[Array]:
    """Do the same in torch on `device`, in double precision."""
    import torch

    moved = torch.from_numpy(np.ascontiguousarray(rows, dtype=np.float64)).to(device)
    return list((moved @ moved.transpose(1, 2)).cpu().numpy())
