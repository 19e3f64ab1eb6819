"""A first look at anybody's log: what is in it, how each axis behaves at full rate, what cannot be known."""

from bench.analysis.look._axis import level_steps
from bench.analysis.look._files import write_files
from bench.analysis.look._look import AxisLook, Look, LookOptions, look
from bench.analysis.look._pair import HalfDifference, half_differences
from bench.analysis.look._rest import Motion, motion_of

__all__ = [
    "AxisLook",
    "HalfDifference",
    "Look",
    "LookOptions",
    "Motion",
    "half_differences",
    "level_steps",
    "look",
    "motion_of",
    "write_files",
]
