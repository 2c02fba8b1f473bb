"""The judge who sees the truth: contacts, clearance, metres by mode, joules by consumer, the track.

A mover that runs into a robot which has stood still for a second is no contact of the robot's: it is recorded
apart, as struck while standing (`sim.movers`).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sim.movers.crowd import Crowd
from sim.plant import Plant

TRACK_EVERY = 5  # steps between points of the track (50 Hz)
RELEASE_M = 0.02  # a contact ends when the robot is this far away again
AIRBORNE_M = 0.05


@dataclass
class Referee:
    """Running account of the truth."""

    crowd: Crowd | None = None  # the movers, if any
    contacts: int = 0  # the robot's own: with the world, with movers, and falls off an edge
    mover_contacts: int = 0  # those of them with movers
    unseen_contacts: int = 0  # and of these with movers that were out of the camera's view
    struck: int = 0  # times that a mover ran into the robot while it stood
    falls: int = 0
    contact_places_m: list[list[float]] = field(default_factory=list)
    min_clearance_m: float = math.inf
    min_mover_clearance_m: float = math.inf
    land_m: float = 0.0
    air_m: float = 0.0
    touchdown_mps: float = 0.0
    _touching: bool = False
    _touching_mover: bool = False
    _airborne: bool = False
    _steps: int = 0
    _last: np.ndarray | None = None
    _track: list[list[float]] = field(default_factory=list)
    _crowd_track: list[list[float]] = field(default_factory=list)

    def watch(self, now_s: float, plant: Plant) -> None:
        """Look at the plant after each of its steps."""
        state = plant.state
        self.min_clearance_m = min(self.min_clearance_m, plant.clearance_m)
        if plant.falls > self.falls or (plant.clearance_m <= 0.0 and not self._touching):
            self.falls = plant.falls
            self._touching = True
            self.contacts += 1
            self.contact_places_m.append([round(float(v), 3) for v in state.position_m])
        elif plant.clearance_m > RELEASE_M:
            self._touching = False
        if self.crowd is not None:
            self._watch_movers(self.crowd, state.position_m)
        airborne = plant.height_m > AIRBORNE_M
        if self._airborne and not airborne:
            self.touchdown_mps = max(self.touchdown_mps, -float(state.velocity_mps[2]))
        self._airborne = airborne
        if self._steps % TRACK_EVERY == 0:
            self._account(now_s, plant, airborne)
        self._steps += 1

    def _watch_movers(self, crowd: Crowd, position_m: np.ndarray) -> None:
        gap_m = crowd.clearance_m
        self.min_clearance_m = min(self.min_clearance_m, gap_m)
        self.min_mover_clearance_m = min(self.min_mover_clearance_m, gap_m)
        if gap_m > RELEASE_M:
            self._touching_mover = False
        elif gap_m <= 0.0 and not self._touching_mover:
            self._touching_mover = True
            if crowd.robot_stands:
                self.struck += 1
            else:
                self.contacts += 1
                self.mover_contacts += 1
                self.unseen_contacts += crowd.nearest_unseen
                self.contact_places_m.append([round(float(v), 3) for v in position_m])

    def _account(self, now_s: float, plant: Plant, airborne: bool) -> None:
        p = plant.state.position_m
        if self._last is not None:
            way = float(np.linalg.norm(p - self._last))
            if airborne:
                self.air_m += way
            else:
                self.land_m += way
        self._last = p.copy()
        if self.crowd is not None:
            self._crowd_track.append([v for m in self.crowd.placed for v in (m.x_m, m.y_m, m.floor_z_m)])
        self._track.append([now_s, *p, *plant.state.quaternion, float(airborne), plant.battery.used_j])

    def save(self, folder: Path, plant: Plant) -> None:
        """Write `truth.npz` (the track) and `referee.json` (the account)."""
        track = np.array(self._track).reshape(-1, 10)
        walked: dict[str, Any] = {}
        if self.crowd is not None:
            walked["movers_m"] = np.array(self._crowd_track, np.float32).reshape(len(track), -1, 3)
        np.savez_compressed(
            folder / "truth.npz",
            **walked,
            stamp_s=track[:, 0],
            position_m=track[:, 1:4],
            quaternion=track[:, 4:8],
            mode=track[:, 8].astype(np.int8),
            used_j=track[:, 9],
        )
        account = {
            "contacts": self.contacts,
            "mover_contacts": self.mover_contacts,
            "unseen_contacts": self.unseen_contacts,
            "struck_while_standing": self.struck,
            "movers": 0 if self.crowd is None else len(self.crowd.movers),
            "falls": self.falls,
            "contact_places_m": self.contact_places_m,
            "min_clearance_m": _known(self.min_clearance_m),
            "min_mover_clearance_m": _known(self.min_mover_clearance_m),
            "land_m": self.land_m,
            "air_m": self.air_m,
            "touchdown_mps": self.touchdown_mps,
            "used_j": plant.battery.used_by_j,
        }
        (folder / "referee.json").write_text(json.dumps(account, indent=1))


def _known(clearance_m: float) -> float | None:
    """None where nothing has been near."""
    return None if math.isinf(clearance_m) else clearance_m
