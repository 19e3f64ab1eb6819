"""ESPEC chambers with a P-300 or SCP-220 controller, ASCII over RS-232, RS-485 or TCP port 10001."""

from drivers.espec._codec import (
    END,
    REFUSALS,
    Temperatures,
    decode_alarms,
    decode_temperatures,
    encode_line,
    ramp_minutes,
    ramp_text,
    refusal_words,
    set_temperature_text,
)
from drivers.espec._driver import EspecChamber
from drivers.espec._kind import EspecConfig, EspecP300, EspecScp220
from drivers.espec._transcript import decode_transcript

__all__ = [
    "END",
    "REFUSALS",
    "EspecChamber",
    "EspecConfig",
    "EspecP300",
    "EspecScp220",
    "Temperatures",
    "decode_alarms",
    "decode_temperatures",
    "decode_transcript",
    "encode_line",
    "ramp_minutes",
    "ramp_text",
    "refusal_words",
    "set_temperature_text",
]
