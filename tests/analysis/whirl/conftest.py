"""The tests of the whirl share their emulated runs with the benchmark: its folder is put on the path."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[3]))
