"""A first look at anybody's log: what is in it, how each axis behaves at full rate, what cannot be known."""

from bench.analysis.look._files import write_files
from bench.analysis.look._look import AxisLook, Look, LookOptions, look

__all__ = ["AxisLook", "Look", "LookOptions", "look", "write_files"]
