"""What shows a run while it goes on. Nothing that happens to a display stops the bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.control.progress import Progress

Display = Callable[[Progress], None]


class Displays:
    """Shows a run on several displays; one that fails is left out from then on, and `say` is told."""

    def __init__(self, displays: Sequence[Display], say: Callable[[str], None]) -> None:
        self._displays, self._say = list(displays), say

    def __bool__(self) -> bool:
        return bool(self._displays)

    def show(self, progress: Progress) -> None:
        """Show where the run is; a pipe that nobody reads or a full disk under a log end that display only."""
        for display in list(self._displays):
            try:
                display(progress)
            except (OSError, ValueError, SystemExit) as error:
                # a terminal whose pipe is closed ends the process: it would end the run
                self._displays.remove(display)
                what = "its output is closed" if isinstance(error, SystemExit) else str(error)
                self._say(f"a display of the run failed and is left out, the run goes on: {what}")
