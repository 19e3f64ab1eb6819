"""An SBG Ellipse on a CAN bus behind an slcan adapter."""

from __future__ import annotations

from drivers.sbg import ellipse_layout
from simulators.emulators.can_dbc import CanEmulator
from simulators.interfaces import GyroPlant


class SbgEmulator(CanEmulator):
    """A `CanEmulator` with the layout of an Ellipse: IMU_INFO and IMU_GYRO every sample."""

    def __init__(
        self,
        plant: GyroPlant,
        *,
        rate_hz: float,
        bitrate: int = 500_000,
        clock_error_ppm: float = 0.0,
        serial_number: str = "GB01",
    ) -> None:
        super().__init__(
            plant,
            ellipse_layout(),
            rate_hz=rate_hz,
            bitrate=bitrate,
            clock_error_ppm=clock_error_ppm,
            serial_number=serial_number,
        )
