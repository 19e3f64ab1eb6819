"""Colours of a report: one name, a light and a dark value; figures and page use the same CSS variables.

Series colours follow Okabe and Ito (2008), told apart with any common colour vision, darkened for white paper
so that text in them keeps a contrast of 4.5 : 1 (WCAG 2 AA), lightened for the dark theme.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Paint:
    """A colour as CSS variable `--name`; `light` is what matplotlib draws with, so no two may share it."""

    name: str
    light: str
    dark: str

    @property
    def css(self) -> str:
        """The colour as a CSS value that follows the theme."""
        return f"var(--{self.name}, {self.light})"


INK = Paint("ink", "#1c2530", "#e4e9ef")
MUTED = Paint("muted", "#566373", "#9fabb9")
GRID = Paint("grid", "#dfe4ea", "#323c48")
BAND = Paint("band", "#eff3f7", "#232e3a")
FLOOR = Paint("floor", "#dbe7f0", "#233a4c")
BLUE = Paint("blue", "#0068a6", "#6cb6ea")
ORANGE = Paint("orange", "#b54d00", "#f0944d")
GREEN = Paint("green", "#00765a", "#45c39d")
PURPLE = Paint("purple", "#9c4479", "#de9cc3")
SAND = Paint("sand", "#8a6a00", "#e0c04c")

PAINTS = (INK, MUTED, GRID, BAND, FLOOR, BLUE, ORANGE, GREEN, PURPLE, SAND)
BEFORE, AFTER = ORANGE, BLUE
