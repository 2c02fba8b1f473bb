"""The state of a run on disk: written in one move, read back exactly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from labr_autonomy.errors import BadInput

CHECKPOINT, BEST = "checkpoint.pt", "best.pt"
Tensors = dict[str, Tensor]


@dataclass(slots=True)
class State:
    """Everything that the next step depends on besides data and settings."""

    net: nn.Module
    mean: Tensors  # running mean of the weights
    optimiser: torch.optim.Optimizer
    step: int = 0  # steps done
    best: float = -1.0  # share reached by the best checkpoint so far
    best_step: int = 0

    def save(self, folder: Path, settings: dict[str, Any]) -> None:
        """Write the checkpoint; a stopped run leaves a whole one."""
        state = {
            "net": self.net.state_dict(),
            "mean": self.mean,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "best": self.best,
            "best_step": self.best_step,
            "settings": settings,
        }
        _write(state, folder / CHECKPOINT)

    def load(self, folder: Path, settings: dict[str, Any]) -> bool:
        """Go on from the checkpoint, if there is one; one of other settings is refused."""
        path = folder / CHECKPOINT
        if not path.exists():
            return False
        saved = torch.load(path, weights_only=True, map_location="cpu")
        changed = sorted(k for k in settings if saved["settings"].get(k) != settings[k])
        if changed:
            raise BadInput(
                f"the run in {folder} was begun with another {changed[0]}",
                "Go on with its settings, or name another folder.",
            )
        self.net.load_state_dict(saved["net"])
        self.mean = {name: value.clone() for name, value in saved["mean"].items()}
        self.optimiser.load_state_dict(saved["optimiser"])
        self.step, self.best, self.best_step = (
            int(saved["step"]),
            float(saved["best"]),
            int(saved["best_step"]),
        )
        return True

    def average(self, keep: float) -> None:
        """Move the running mean towards the weights; it follows quickly at first."""
        keep = min(keep, (1.0 + self.step) / (10.0 + self.step))
        with torch.no_grad():
            for name, value in self.net.state_dict().items():
                if value.is_floating_point():
                    self.mean[name].lerp_(value, 1.0 - keep)
                else:
                    self.mean[name].copy_(value)


def save_best(folder: Path, mean: Tensors) -> None:
    """Keep these weights as the best so far."""
    _write(mean, folder / BEST)


def load_best(folder: Path) -> Tensors | None:
    """The best weights so far, where any were chosen."""
    path = folder / BEST
    if not path.exists():
        return None
    found: Tensors = torch.load(path, weights_only=True, map_location="cpu")
    return found


def _write(value: Any, path: Path) -> None:
    fresh = path.with_suffix(".new")
    torch.save(value, fresh)
    fresh.replace(path)
