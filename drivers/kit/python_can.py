"""python-can, loaded without its MF4 log format: `from drivers.kit.python_can import can`.

python-can imports asammdf when it is installed, and with it pandas and sympy: some twenty times what it takes
itself, before every run and in every emulated lab. Who writes MF4 here does so with asammdf itself.
"""

from __future__ import annotations

import sys

_absent = "can" not in sys.modules and "asammdf" not in sys.modules
if _absent:
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # an import of it fails, which python-can expects
try:
    import can
finally:
    if _absent:
        del sys.modules["asammdf"]

__all__ = ["can"]
