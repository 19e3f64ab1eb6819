"""What an SBG Ellipse sends on CAN of interest to a gyro bench.

Source: SBG Systems, sbgECom, CAN protocol description and `sbgCan.dbc`. Every message is off as delivered and is
configured over the unit's serial port or Ethernet. In each cycle IMU_INFO (time, status, temperature) comes
before IMU_GYRO (rates); nothing in IMU_GYRO says to which cycle it belongs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from drivers.sbg._layout import MessageLayout, load_message

ELLIPSE_DBC = Path(__file__).with_name("ellipse.dbc")
"""The messages below with their default identifiers."""

AXES = "xyz"
COUNTER_MODULO = 1 << 32
"""IMU_INFO's time in us is 32 bits wide."""
ALL_GOOD = 0x03FF
"""Status with every bit of a healthy IMU."""

_LINK, _SELF_TEST, _GYRO_X, _GYROS_IN_RANGE = 0, 1, 5, 9


@dataclass(frozen=True)
class Ellipse:
    """Layouts of the unit's messages."""

    status: MessageLayout
    info: MessageLayout
    accel: MessageLayout
    gyro: MessageLayout


@lru_cache
def load_ellipse(dbc: Path = ELLIPSE_DBC) -> Ellipse:
    """Return the layouts from a DBC file with the maker's message names; ConfigurationError without them."""
    return Ellipse(
        status=load_message(dbc, "SBG_ECAN_MSG_STATUS_01"),
        info=load_message(dbc, "SBG_ECAN_MSG_IMU_INFO"),
        accel=load_message(dbc, "SBG_ECAN_MSG_IMU_ACCEL"),
        gyro=load_message(dbc, "SBG_ECAN_MSG_IMU_GYRO"),
    )


def valid_mask(axes: str) -> int:
    """Return the status bits that must be 1 for the rates of `axes` to be good: link, self-test, gyros, range."""
    gyros = sum(1 << _GYRO_X + AXES.index(axis) for axis in axes)
    return 1 << _LINK | 1 << _SELF_TEST | gyros | 1 << _GYROS_IN_RANGE
