"""TensorBoard's log of a run: losses, rate, figures on unseen views, flights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

EVERY = 20  # steps


class BoardLog:
    """A `Listener` that writes event files; view them with `tensorboard --logdir FOLDER`.

    Args:
        folder: For the files.
    """

    def __init__(self, folder: Path) -> None:
        self._writer = SummaryWriter(str(folder))

    def step(self, done: int, parts: dict[str, float], rate: float) -> None:
        """Losses and rate, every `EVERY` steps."""
        if done % EVERY:
            return
        for name, value in parts.items():
            self._writer.add_scalar(f"loss/{name}", value, done)
        self._writer.add_scalar("rate", rate, done)

    def check(self, done: int, figures: dict[str, Any]) -> None:
        """Figures on unseen views."""
        for name, value in figures.items():
            if isinstance(value, int | float):
                self._writer.add_scalar(f"validation/{name}", value, done)
        self._writer.flush()

    def flown(self, done: int, share: float) -> None:
        """Share of flights that reached their goal."""
        self._writer.add_scalar("closed_loop/reached", share, done)
        self._writer.flush()

    def close(self) -> None:
        """Write what is left."""
        self._writer.close()
