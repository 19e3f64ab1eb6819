"""The watchdog's process: the order on the first line of standard input, then beats until it closes."""

from __future__ import annotations

import os
import sys

from bench.control.watchdog._process import main
from drivers.base.system import SELECTS_FILES

if __name__ == "__main__":
    if SELECTS_FILES:
        os.set_blocking(1, False)  # a runner that does not read must not stop its watchdog
    sys.exit(main())
