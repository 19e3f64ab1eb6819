"""Presets: parameters of a procedure under a name, for everybody who uses the runs folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from bench.campaign.queue._file import FOLDER, alone, read_model, write_model
from drivers.base.errors import ConfigurationError


class Preset(BaseModel):
    """Parameters of a procedure that are not its defaults; `by` saved them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(min_length=1, max_length=60)
    procedure: str
    parameters: dict[str, Any] = Field(default_factory=dict)
    by: str


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    presets: tuple[Preset, ...] = ()


class Presets:
    """The presets of a runs folder; a name is unique within its procedure."""

    def __init__(self, runs: Path) -> None:
        self._path = runs / FOLDER / "presets.json"

    def all(self) -> tuple[Preset, ...]:
        """Return them, by name."""
        found = read_model(self._path, _File, "the list of presets") or _File()
        return tuple(sorted(found.presets, key=lambda preset: preset.name.casefold()))

    def save(self, preset: Preset) -> None:
        """Keep a preset in place of one of the same name and procedure."""
        with alone(self._path):
            write_model(self._path, _File(presets=(*self._but(preset.procedure, preset.name), preset)))

    def remove(self, procedure: str, name: str) -> None:
        """Remove a preset; ConfigurationError if there is none."""
        with alone(self._path):
            left = self._but(procedure, name)
            if len(left) == len(self.all()):
                raise ConfigurationError("there is no such preset", where=procedure, found=name)
            write_model(self._path, _File(presets=left))

    def _but(self, procedure: str, name: str) -> tuple[Preset, ...]:
        return tuple(one for one in self.all() if (one.procedure, one.name) != (procedure, name))
