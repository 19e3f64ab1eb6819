"""The words of Service Mode (TS1524 rev. 31, section 9), shared by driver and emulator."""

from __future__ import annotations

ENTER = b"SERVICEMODE\r"
LEAVE = b"x N\r"
"""Back to Normal Mode at once, with the settings as they are, saved or not (table 9-54)."""
BANNER = "SERIAL NUMBER = "
"""How the listing begins that the unit sends when it enters Service Mode (figure 8-1)."""
LEFT = "SYSTEM RETURNING TO NORMAL MODE"
RATES: dict[int, str] = {125: "0", 250: "1", 500: "2", 1000: "3", 2000: "4"}
"""Sample rate in Hz -> parameter of `m` (table 9-38)."""
DATAGRAMS: dict[str, str] = {
    "rate": "0",
    "rate_acc": "1",
    "rate_incl": "2",
    "rate_acc_incl": "3",
    "rate_temp": "4",
    "rate_acc_temp": "5",
    "rate_incl_temp": "6",
    "all": "7",
    "rate_pps": "l",
    "rate_acc_pps": "m",
    "rate_incl_pps": "n",
    "rate_acc_incl_pps": "p",
    "rate_temp_pps": "q",
    "rate_acc_temp_pps": "r",
    "rate_incl_temp_pps": "s",
    "all_pps": "t",
}
"""Message of the frame description -> parameter of `d` (table 9-13)."""
_ACCELERATIONS = {
    "acceleration": ("0", "ACCELERATION"),
    "incremental_velocity": ("1", "INCREMENTAL VELOCITY"),
    "average_acceleration": ("2", "AVERAGE ACCELERATION"),
    "integrated_velocity": ("4", "INTEGRATED VELOCITY"),
}
OUTPUTS: dict[str, tuple[str, str, dict[str, tuple[str, str]]]] = {
    "gyro_output": (
        "g",
        "GYRO",
        {
            "rate": ("0", "ANGULAR RATE"),
            "incremental_angle": ("1", "INCREMENTAL ANGLE"),
            "average_rate": ("2", "AVERAGE ANGULAR RATE"),
            "integrated_angle": ("3", "INTEGRATED ANGLE"),
        },
    ),
    "accelerometer_output": ("a", "ACCELEROMETER", _ACCELERATIONS),
    "inclinometer_output": ("i", "INCLINOMETER", _ACCELERATIONS),
}
"""Setting of the description -> sensor of `u`, its name in replies, choice -> (parameter, words) (table 9-51)."""
SETTINGS = {"s": "SERIAL NUMBER", "n": "PRODUCT", "x": "PART NUMBER", "p": "FW CONFIG"}
"""Parameter of `i` -> what its reply begins with (table 9-35, figures 9-21 to 9-37)."""
_WORDS = {"rate": "RATE", "acc": "ACCELERATION", "incl": "INCLINATION", "temp": "TEMPERATURE", "pps": "PPS"}
_MARGIN = 1.1


def datagram_words(message: str) -> str:
    """Return a datagram in words, e.g. RATE, ACCELERATION; no reply with temperature or PPS is printed."""
    parts = message.replace("all", "rate_acc_incl_temp").split("_")
    return ", ".join(_WORDS[part] for part in parts)


def bits_per_s(length: int, rate_hz: float) -> float:
    """Return the lowest bit rate that carries datagrams of `length` bytes, 8N1 (equation 12)."""
    return _MARGIN * 10 * length * rate_hz
