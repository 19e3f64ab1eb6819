"""Where batched arithmetic runs: on a CUDA device where torch sees one, else on this machine's processors.

The rule: GYROBENCH_DEVICE says it (`cpu`, `cuda`, `cuda:1`); unset, it is `cuda` if there is an NVIDIA driver and
torch sees a device, else `cpu`. Without a driver torch is not even imported: that alone can take seconds.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import from_extra

VARIABLE = "GYROBENCH_DEVICE"
CPU = "cpu"
_DRIVER = Path("/proc/driver/nvidia/version")


def _torch() -> Any:
    """Return torch; None where it is not installed: a driver alone does not ask for it."""
    try:
        return import_module("torch")
    except ImportError:
        return None


def compute_device() -> str:
    """Return torch's name of the device to compute on; ConfigurationError for one that torch does not see."""
    asked = os.environ.get(VARIABLE, "").strip()
    if asked == CPU or (not asked and not _DRIVER.exists()):
        return CPU
    torch = from_extra("torch", "torch", f"{VARIABLE}={asked}") if asked else _torch()
    if torch is None:
        return CPU
    if not asked:
        return "cuda" if torch.cuda.is_available() else CPU
    kind, _, number = asked.partition(":")
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if kind == "cuda" and (number or "0").isdigit() and int(number or 0) < count:
        return asked
    raise ConfigurationError(
        "there is no such device to compute on",
        where=VARIABLE,
        found=asked,
        expected=f"cpu, or one of {count} CUDA devices that torch sees",
        remedy=f"unset {VARIABLE}, or install a torch built for the driver of this machine",
    )
