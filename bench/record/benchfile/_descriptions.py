"""Frame descriptions that a bench file names: read in, so that a run keeps what it was decoded with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.frames import FrameDecoder, family_from, family_of, is_path, load_toml

_DRIVER = "frames"


def with_descriptions(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a bench file's data with description files (relative to `folder`) in place of their paths.

    A gyro without `baudrate` or `rate_hz` gets its description's. ConfigurationError for a description that
    cannot be used; what is wrong with the rest is for others to say.
    """
    gyros = data.get("gyro")
    if not isinstance(gyros, list):
        return dict(data)
    return {**data, "gyro": [_completed(gyro, folder) for gyro in gyros]}


def _completed(gyro: Any, folder: Path) -> Any:
    description = gyro.get("description") if isinstance(gyro, dict) else None
    settings = gyro.get("settings", {}) if isinstance(gyro, dict) else {}
    if not isinstance(settings, dict) or not all(isinstance(words, str) for words in settings.values()):
        return gyro  # the bench file's own checks say what is wrong with it
    if isinstance(gyro, dict) and gyro.get("driver") == "stim300" and settings:
        family_of("stim300", settings)
    if not isinstance(description, (str, dict)) or gyro.get("driver") != _DRIVER:
        return gyro
    if isinstance(description, str) and is_path(description):
        path = folder / description
        description = load_toml(path)
        family = family_from(description, str(path), settings)
    else:
        family = family_of(description, settings)
    link, axes = family.description.link, gyro.get("axes", "x")
    if isinstance(axes, str) and axes and set(axes) <= set("xyz"):  # else others say what is wrong with it
        message = gyro.get("frame_format")
        FrameDecoder(family, rate_hz=link.nominal_rate_hz, axes=axes, message=message)
    return {"baudrate": link.baud, "rate_hz": link.nominal_rate_hz, **gyro, "description": description}
