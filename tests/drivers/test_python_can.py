"""python-can is loaded without what it loads only because it is there."""

import subprocess
import sys

CODE = """
import sys
import drivers.sbg, drivers.slcan
from drivers.kit.python_can import can
assert can.Message(arbitration_id=1).arbitration_id == 1
assert not {"asammdf", "pandas", "sympy"} & set(sys.modules), "loaded for nothing"
import importlib.util
importlib.util.find_spec("asammdf")  # ValueError if the name were still blocked
"""


def test_can_drivers_load_neither_asammdf_nor_pandas_and_leave_them_usable():
    said = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
