"""A first look at anybody's log: what is in it, how each axis behaves at full rate, what cannot be known."""

from bench.analysis.look._files import write_files
from bench.analysis.look._look import AxisLook, Look, LookOptions, look
from bench.analysis.look._pair import HalfDifference, half_differences

__all__ = ["AxisLook", "HalfDifference", "Look", "LookOptions", "half_differences", "look", "write_files"]
