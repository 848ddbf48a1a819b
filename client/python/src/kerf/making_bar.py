"""How far a scene is that is being made, on a terminal."""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING

from kerf.model import Making

if TYPE_CHECKING:
    from typing import Self, TextIO

#: Characters of the bar.
_BAR = 24

#: What the server does to the tissue, in the words of `kerf-server session create`.
_WORK = {
    "voxels": "fills its voxels",
    "elements": "joins voxels to elements",
    "solver": "sets up the solver",
    "equilibrium": "lets it settle under its tension",
}


class MakingBar:
    """A line that is drawn over, and cleared at the end."""

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal
        self._drawn = 0

    @classmethod
    def on_terminal(cls) -> Self | None:
        """On `sys.stderr`, where that is a terminal; else there is none."""
        # It is `None` in a program without a console.
        return cls(sys.stderr) if sys.stderr is not None and sys.stderr.isatty() else None

    def __call__(self, making: Making) -> None:
        """Draws how far it is."""
        done = int(_BAR * making.share)
        self._draw(f"[{'#' * done:-<{_BAR}}] {int(100 * making.share)} % {in_plain_words(making)}")

    def clear(self) -> None:
        """Leaves the line as it was."""
        self._draw("")
        self._terminal.write("\r")
        self._terminal.flush()

    def _draw(self, line: str) -> None:
        # One that is broken could not be drawn over.
        line = line[: shutil.get_terminal_size().columns - 1]
        self._terminal.write(f"\r{line.ljust(self._drawn)}")
        self._terminal.flush()
        self._drawn = len(line)


def in_plain_words(making: Making) -> str:
    """What the server does."""
    if making.stage not in _WORK:
        return "reads the scene"
    which = "the tissue" if making.objects < 2 else f"tissue {making.object + 1} of {making.objects}"
    voxels = f", {making.voxels} voxels" if making.voxels else ""
    return f"makes {which}{voxels}: {_WORK[making.stage]}"
