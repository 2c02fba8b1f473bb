"""What a training run is made of: a YAML file, checked before anything starts."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.learning.cost import Cost
from labr_autonomy.gkpn.learning.iplanner_cost import IPlannerCost
from labr_autonomy.gkpn.networks.presets import find_network

RECIPES_DIR = Path(__file__).parents[1] / "recipes"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Scenes(_Part):
    """A data set that is made, or completed, before training begins (`labr-mission dataset`)."""

    families: tuple[str, ...] = ("indoor", "rooms", "garage", "forest")
    worlds: tuple[str, ...] = ()  # world files of meshes, besides
    scenes: int = Field(default=120, ge=1)
    views: int = Field(default=96, ge=1)
    goals: int = Field(default=8, ge=2)
    seed: int = Field(default=1_000_000, ge=0)


class Teacher(_Part):
    """Imitation of paths that were optimised on the true fields."""

    weight: float = Field(default=0.0, ge=0.0)  # of the mean distance between key points [1/m]; 0: no teacher
    until: float = Field(
        default=0.6, ge=0.0, le=1.0
    )  # share of the steps over which the weight falls to nothing


class ClosedLoop(_Part):
    """Flights that choose the best checkpoint."""

    every: int = Field(default=0, ge=0)  # steps; 0: the last checkpoint is the best
    trials: int = Field(default=10, ge=1)  # of each family
    families: tuple[str, ...] = ("indoor", "rooms", "garage", "forest")


class Settings(_Part):
    """One run."""

    name: str = Field(min_length=1)
    network: str
    loss: Literal["labr", "iplanner"] = "labr"
    weights: dict[str, float] = {}  # of the loss, and its lengths, where they differ from its own
    training: Scenes = Scenes()
    validation: Scenes = Scenes(scenes=12, views=48, seed=2_000_000)
    seed: int = Field(default=0, ge=0)
    steps: int = Field(default=20_000, ge=1)
    images: int = Field(default=64, ge=1)  # of a step, on all machines together
    goals: int = Field(
        default=8, ge=1
    )  # goals of an image in a step; they share its features, the costly part
    rate: float = Field(default=1.2e-3, gt=0.0)  # peak of the one-cycle schedule
    warm: float = Field(default=0.05, ge=0.0, le=1.0)  # share of the steps before the peak
    decay: float = Field(default=1e-2, ge=0.0)  # weight decay of AdamW
    clip: float = Field(default=10.0, gt=0.0)  # gradient norm
    average: float = Field(default=0.998, ge=0.0, lt=1.0)  # of the running mean of the weights
    fear: float = Field(default=1.0, ge=0.0)
    others: float = Field(default=0.05, ge=0.0)  # weight of hypotheses that did not win
    early: float = Field(default=0.3, ge=0.0)  # weight of a path before its last revision
    spoiled: float = Field(
        default=0.05, ge=0.0, le=1.0
    )  # share of frames unlike any camera's, which it must fear
    unmapped: float = Field(
        default=0.15, ge=0.0, le=1.0
    )  # share of views without a map, as when a mission begins
    teacher: Teacher = Teacher()
    closed_loop: ClosedLoop = ClosedLoop()
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    threads: int = Field(default=0, ge=0)  # 0: all
    save_every: int = Field(default=500, ge=1)
    check_every: int = Field(default=2000, ge=1)

    def cost(self) -> Cost | IPlannerCost:
        """The loss with its weights."""
        return (Cost if self.loss == "labr" else IPlannerCost)(**self.weights)

    @property
    def land_only(self) -> bool:
        """Whether the network learns to drive alone."""
        return self.loss == "iplanner"


def read_settings(path: Path, changed: dict[str, Any] | None = None) -> Settings:
    """The settings of a file, or of a recipe of that name that comes with the package.

    Args:
        path: The file; `shipped` and the like are looked for among the recipes.
        changed: Fields that win over the file's.

    Raises:
        BadInput: with the place and what is wrong there.
    """
    if not path.is_file() and (RECIPES_DIR / f"{path}.yaml").is_file():
        path = RECIPES_DIR / f"{path}.yaml"
    known = ", ".join(sorted(recipe.stem for recipe in RECIPES_DIR.glob("*.yaml")))
    try:
        values = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(
            f"the training settings {path} cannot be read ({error.strerror})",
            f"Name a file, or one of {known}.",
        ) from None
    except YAMLError as error:
        raise BadInput(f"{path} is not YAML: {error}", "Mend it.") from None
    if not isinstance(values, dict):
        raise BadInput(f"{path} holds no settings", f"Copy one of the recipes: {known}.")
    try:
        settings = Settings(**{**values, **(changed or {})})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadInput(f"{path}: {where}: {first['msg']}", "Mend it.") from None
    find_network(settings.network)
    try:
        settings.cost()
    except TypeError:
        fields = (Cost if settings.loss == "labr" else IPlannerCost).__dataclass_fields__
        odd = next(name for name in settings.weights if name not in fields)
        raise BadInput(
            f"{path}: weights.{odd}: the loss '{settings.loss}' has no such weight",
            f"It has {', '.join(fields)}.",
        ) from None
    return settings
