"""A recorded flight on the same page: what the operator saw then, with a playhead that all pages share."""

from __future__ import annotations

import bisect
import json
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.clock import Clock
from labr_autonomy.console.depth_view import project
from labr_autonomy.console.feed import Body, Seen, depth_body, map_body
from labr_autonomy.console.map_slot import MapView
from labr_autonomy.console.requests import Request
from labr_autonomy.errors import BadInput
from labr_autonomy.record import foxglove
from labr_autonomy.record.depth_png import decode_depth
from labr_autonomy.record.mcap_reader import read_raw

SPEED_MAX = 20.0
DEPTH_NEAR_S = 1.0


class RecordedFeed:
    """Plays `flight.mcap`.

    Args:
        run: Folder of the run.
        clock: Drives the playhead.

    Raises:
        BadInput: when the run holds nothing to show.
    """

    def __init__(self, run: Path, clock: Clock) -> None:
        self._clock = clock
        self._states: list[Body] = []
        self._maps: list[tuple[float, np.ndarray]] = []
        self._depths: list[Body] = []
        facts: Body = {}
        map_stamp_s = 0.0
        for topic, _, data in read_raw(run / "flight.mcap"):
            if topic == "/console":
                self._states.append(json.loads(data))
                map_stamp_s = self._states[-1]["stamp_s"]
            elif topic == "/facts":
                facts = json.loads(data)
            elif topic == "/map":
                self._maps.append((map_stamp_s, foxglove.cells_of(data)))
            elif topic == "/depth":
                self._depths.append(json.loads(data))
        if not self._states or not facts:
            raise BadInput(f"{run} holds no states of a console", "Record a new run with this version")
        self._facts = {**facts, "replay": True, "run": run.name}
        self._stamps = [state["stamp_s"] for state in self._states]
        self._trail = _trail(self._states)
        self._playing, self._speed = True, 1.0
        self._at_s = 0.0
        self._polled_s = clock.now_s()
        self._moved = 1

    @property
    def length_s(self) -> float:
        """From the first state to the last."""
        return float(self._stamps[-1] - self._stamps[0])

    def poll(self) -> None:
        """Move the playhead."""
        now_s = self._clock.now_s()
        if self._playing:
            self._at_s = min(self.length_s, self._at_s + (now_s - self._polled_s) * self._speed)
            self._moved += 1
            if self._at_s >= self.length_s:
                self._playing = False
        self._polled_s = now_s

    def news(self, seen: Seen) -> Body | None:
        """The state at the playhead."""
        if seen.state == self._moved:
            return None
        stamp_s = self._stamps[0] + self._at_s
        index = max(0, bisect.bisect_right(self._stamps, stamp_s) - 1)
        state = self._states[index]
        replay = {
            "at_s": round(self._at_s, 2),
            "length_s": round(self.length_s, 2),
            "playing": self._playing,
            "speed": self._speed,
        }
        message: Body = {"state": state, "replay": replay, "over": False}
        if not seen.facts:
            message["facts"] = self._facts
        view = self._map_at(stamp_s, index)
        if view.number != seen.map:
            message["map"] = map_body(view)
            seen.map = view.number
        number, depth = self._depth_at(stamp_s)
        if number != seen.depth:
            message["depth"] = None if depth is None else self._picture(depth, state)
            seen.depth = number
        seen.facts, seen.state = 1, self._moved
        return message

    def ask(self, request: Request) -> None:
        """Nothing is asked of a flight that is over."""

    def replay(self, command: str, value: float | None) -> None:
        """Play, pause, seek [s], step (+1 or -1), speed."""
        match command:
            case "play":
                self._at_s = 0.0 if self._at_s >= self.length_s else self._at_s
                self._playing = True
            case "pause":
                self._playing = False
            case "seek" if value is not None:
                self._at_s = min(max(value, 0.0), self.length_s)
            case "step" if value is not None:
                self._playing = False
                index = bisect.bisect_right(self._stamps, self._stamps[0] + self._at_s + 1e-6) - 1
                index = min(max(index + (1 if value > 0 else -1), 0), len(self._stamps) - 1)
                self._at_s = self._stamps[index] - self._stamps[0]
            case "speed" if value is not None:
                self._speed = min(max(value, 0.1), SPEED_MAX)
        self._moved += 1

    def close(self) -> None:
        """Nothing is open."""

    def _map_at(self, stamp_s: float, index: int) -> MapView:
        number = bisect.bisect_right([s for s, _ in self._maps], stamp_s)
        cells = self._maps[number - 1][1] if number else np.zeros((0, 2))
        trail = self._trail[: index + 1]
        shown = np.asarray(cells, np.float32), np.asarray(trail, np.float32).reshape(-1, 4)
        return MapView(1 + number * 1_000_000 + index // 5, *shown)

    def _depth_at(self, stamp_s: float) -> tuple[int, Body | None]:
        number = bisect.bisect_right([d["stamp_s"] for d in self._depths], stamp_s)
        near = number and stamp_s - self._depths[number - 1]["stamp_s"] < DEPTH_NEAR_S
        return (number, self._depths[number - 1]) if near else (-1, None)

    def _picture(self, depth: Body, state: Body) -> Body:
        plan = state.get("plan") or {}
        camera: dict[str, Any] = self._facts["camera"]
        width, height = depth["width"], depth["height"]
        points = project(plan.get("network"), depth, camera, width, height)
        return depth_body(width, height, decode_depth(depth), points, "as recorded")


def _trail(states: list[Body]) -> list[tuple[float, float, float, float]]:
    """One row x, y, z, flown for each state; where there is no pose, the one before."""
    rows: list[tuple[float, float, float, float]] = []
    for state in states:
        pose = state.get("pose")
        if pose is not None:
            x, y, z = pose["position_m"]
            rows.append((x, y, z, float(state["phase"] not in ("driving", "stopping"))))
        elif rows:
            rows.append(rows[-1])
    return rows or [(0.0, 0.0, 0.0, 0.0)]
