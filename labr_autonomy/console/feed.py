"""What the pages are shown: the newest state of a flight, wherever it comes from.

A feed is asked for what is newer than a page has seen. It never keeps a history for anybody.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from labr_autonomy.clock import Clock, utc_s
from labr_autonomy.console import names
from labr_autonomy.console.depth_view import project
from labr_autonomy.console.map_slot import MapReader, MapView
from labr_autonomy.console.requests import Request
from labr_autonomy.console.slot import JsonReader, JsonWriter
from labr_autonomy.errors import BadInput, LinkError, Refused
from labr_autonomy.perception.frame_slot import FrameReader
from labr_autonomy.record.depth_jpeg import depth_jpeg
from labr_autonomy.types import Image

ATTACH_S = 0.2
DEPTH_PERIOD_S = 0.25
GONE_S = 0.5  # the executive's process is looked for this often

Body = dict[str, Any]


@dataclass(slots=True)
class Seen:
    """What one page has got, by number."""

    facts: int = 0
    state: int = 0
    map: int = 0
    depth: int = 0
    over: bool = False


class Feed(Protocol):
    """Where the state comes from."""

    def poll(self) -> None:
        """Look for news; never waits."""
        ...

    def news(self, seen: Seen) -> Body | None:
        """What a page has not got yet, or None; `seen` is brought up to date."""
        ...

    def ask(self, request: Request) -> None:
        """Pass a request on."""
        ...

    def replay(self, command: str, value: float | None) -> None:
        """Move through a recording."""
        ...

    def close(self) -> None:
        """Let go of everything."""
        ...


class LiveFeed:
    """The state of a running executive.

    Args:
        pid: Its process id.
        clock: Time.

    Raises:
        Refused: when the flight has a console already.
    """

    def __init__(self, pid: int, clock: Clock) -> None:
        self._pid, self._clock = pid, clock
        try:
            self._requests = JsonWriter(names.request_slot(pid), {}, names.REQUEST_MAX, names.REQUEST_SLOTS)
        except LinkError as error:
            raise Refused(
                f"the flight of process {pid} has a console already ({error.what})",
                "Open the address which that one printed, or end it first",
            ) from None
        self._reader: JsonReader | None = None
        self._maps: MapReader | None = None
        self._frames: FrameReader | None = None
        self._state: tuple[int, Body] | None = None
        self._map: MapView | None = None
        self._facts: Body = {}
        self._depth: tuple[int, Body] | None = None
        self._attach_due_s = self._depth_due_s = self._gone_due_s = 0.0
        self.over = False

    def poll(self) -> None:
        """Look for news; never waits."""
        now_s = self._clock.now_s()
        if self._reader is None:
            self._attach(now_s)
            return
        if self.over:
            return
        number = self._reader.number()
        if number is not None and (self._state is None or number != self._state[0]):
            try:
                self._state = self._reader.newest() or self._state
            except BadInput:
                return
        if self._maps is not None:
            self._map = self._maps.newer(0 if self._map is None else self._map.number) or self._map
        if now_s >= self._depth_due_s:
            self._depth_due_s = now_s + DEPTH_PERIOD_S
            self._look_at_depth(now_s)
        self._watch(now_s)  # last: what it showed in the end can still be read

    def _attach(self, now_s: float) -> None:
        if now_s < self._attach_due_s:
            return
        self._attach_due_s = now_s + ATTACH_S
        try:
            self._reader = JsonReader(names.state_slot(self._pid))
            self._maps = MapReader(names.map_slot(self._pid))
            self._facts = self._reader.meta
            self._frames = FrameReader(self._facts["depth_slot"], 0.0)
        except LinkError:
            return  # the flight is still opening its links, or its camera has no slot

    def _watch(self, now_s: float) -> None:
        """Notice that the executive has ended: its slot is removed, or its process is gone."""
        if now_s < self._gone_due_s:
            return
        self._gone_due_s = now_s + GONE_S
        alive = (
            Path(f"/proc/{self._pid}").exists() and Path(f"/dev/shm/{names.state_slot(self._pid)}").exists()
        )
        self.over = self.over or not alive

    def _look_at_depth(self, now_s: float) -> None:
        if self._frames is None or self._state is None:
            return
        frame = self._frames.latest()
        if frame is None or (self._depth is not None and self._depth[0] == frame.sequence):
            return
        state, k = self._state[1], frame.intrinsics
        plan = state.get("plan") or {}
        points = project(plan.get("network"), state.get("pose"), self._facts["camera"], k.width, k.height)
        words = f"{(now_s - frame.stamp_s) * 1e3:.0f} ms old"
        self._depth = frame.sequence, depth_body(k.width, k.height, frame.depth_m, points, words)

    def news(self, seen: Seen) -> Body | None:
        """What a page has not got yet."""
        if self._state is None:
            return None
        number, state = self._state
        if number == seen.state and seen.over == self.over:
            return None
        message: Body = {"state": state, "over": self.over}
        late_s = self._clock.now_s() - state["stamp_s"]
        message["late_s"] = round(late_s, 4)
        message["true_utc_s"] = utc_s() - late_s
        if not seen.facts:
            message["facts"] = self._facts
        if self._map is not None and self._map.number != seen.map:
            message["map"] = map_body(self._map)
            seen.map = self._map.number
        if self._depth is not None and self._depth[0] != seen.depth:
            seen.depth, message["depth"] = self._depth
        seen.facts, seen.state, seen.over = 1, number, self.over
        return message

    def ask(self, request: Request) -> None:
        """Pass a request on."""
        self._requests.write(request.as_dict())

    def replay(self, command: str, value: float | None) -> None:
        """A running flight cannot be moved through."""

    def close(self) -> None:
        """Let go of everything."""
        for slot in (self._requests, self._reader, self._maps, self._frames):
            if slot is not None:
                slot.close()


def depth_body(width: int, height: int, depth_m: Image, points: list[list[float]], words: str) -> Body:
    """A depth image as the page takes it."""
    jpeg = base64.b64encode(depth_jpeg(depth_m)).decode("ascii")
    return {"width": width, "height": height, "jpeg": jpeg, "points": points, "age_words": words}


def map_body(view: MapView) -> Body:
    """A map as the page takes it."""
    return {
        "cells": base64.b64encode(view.cells_m.tobytes()).decode(),
        "trail": base64.b64encode(view.trail_m.tobytes()).decode(),
    }
