"""Frames that no camera on this robot delivers: mu must go up on them, not down."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

SATURATED_M = (0.3, 10.0)
NOISE_M = 10.0
TILES = 4  # along each side of a torn image


def _noise(image_m: Tensor, rng: np.random.Generator) -> Tensor:
    return torch.from_numpy(rng.uniform(0.0, NOISE_M, tuple(image_m.shape)).astype(np.float32))


def _on_its_side(image_m: Tensor, rng: np.random.Generator) -> Tensor:
    turned = torch.rot90(image_m, int(rng.choice([1, 3])), (-2, -1))
    return functional.interpolate(turned[None], size=image_m.shape[-2:], mode="nearest")[0]


def _torn(image_m: Tensor, rng: np.random.Generator) -> Tensor:
    """Its tiles in another order."""
    h, w = (side // TILES for side in image_m.shape[-2:])
    out = image_m.clone()
    order = rng.permutation(TILES * TILES)
    for to, of in enumerate(order):
        (i, j), (k, m) = divmod(to, TILES), divmod(int(of), TILES)
        out[:, i * h : i * h + h, j * w : j * w + w] = image_m[:, k * h : k * h + h, m * w : m * w + w]
    return out


KINDS: Mapping[str, Callable[[Tensor, np.random.Generator], Tensor]] = {
    "empty": lambda image_m, _: torch.zeros_like(image_m),
    "saturated": lambda image_m, rng: torch.full_like(image_m, float(rng.uniform(*SATURATED_M))),
    "upside_down": lambda image_m, _: image_m.flip(-2),
    "on_its_side": _on_its_side,
    "torn": _torn,
    "noise": _noise,
}


def spoiled(image_m: Tensor, rng: np.random.Generator) -> Tensor:
    """An image (1, h, w) spoiled in one of the ways."""
    kinds = list(KINDS.values())
    return kinds[int(rng.integers(len(kinds)))](image_m, rng)
