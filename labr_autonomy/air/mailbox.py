"""Hands MAVLink messages from MAVSDK's callback thread to the event loop, latest value first.

Each kind of message has one slot; a slow loop finds the newest message and no queue behind it. Kinds that
the loop must act upon wake it, once, however many arrive meanwhile. Acknowledgements are few and each
counts, as does each word that the autopilot says: they wait in short queues of their own.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from mavsdk.plugins.mavlink_direct import MavlinkDirect

from labr_autonomy.air.px4 import AUTOPILOT_COMPONENT
from labr_autonomy.air.telemetry import Message
from labr_autonomy.clock import Clock

QUEUE_MAX = 64  # PX4 tells of eight events at once


class Mailbox:
    """Subscriptions to one autopilot.

    Args:
        direct: The plugin that delivers JSON.
        clock: Stamps arrivals, in the callback thread.
        slots: Kinds that are only kept.
        wakes: Kinds that also wake `on_wake`.
        queues: Kinds of which each message counts; they wake as well.
        on_wake: Called on the loop with the kinds that arrived since the last call.
    """

    def __init__(
        self,
        direct: MavlinkDirect,
        clock: Clock,
        slots: Iterable[str],
        wakes: Iterable[str],
        queues: Iterable[str],
        on_wake: Callable[[set[str]], None],
    ) -> None:
        self.latest: dict[str, Message] = {}
        self.queues: dict[str, deque[Message]] = {name: deque(maxlen=QUEUE_MAX) for name in queues}
        self.heard_s = clock.now_s()
        self.refused = 0  # messages that could not be read
        self._clock = clock
        self._wakes = frozenset(wakes) | self.queues.keys()
        self._on_wake = on_wake
        self._arrived: set[str] = set()
        self._woken = False
        self._lock = threading.Lock()  # guards the two fields above; never held while calling out
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._direct = direct
        self._handles = [direct.subscribe_message(name, self._take) for name in {*slots, *self._wakes}]

    def close(self) -> None:
        """End the subscriptions; returns when no callback runs any more."""
        self._open = False
        for handle in self._handles:
            self._direct.unsubscribe_message(handle)
        self._handles.clear()

    def _take(self, message: Any, _user_data: object) -> None:
        """In MAVSDK's thread: keep the message and return; nothing here may call MAVSDK."""
        if message.component_id != AUTOPILOT_COMPONENT or not self._open:
            return
        now_s = self._clock.now_s()
        try:
            kept = Message(now_s, json.loads(message.fields_json))
        except ValueError:
            self.refused += 1
            return
        self.heard_s = now_s
        name = message.message_name
        self.latest[name] = kept
        if name not in self._wakes:
            return
        if name in self.queues:
            self.queues[name].append(kept)
        with self._lock:
            self._arrived.add(name)
            wake, self._woken = not self._woken, True
        if wake:
            try:
                self._loop.call_soon_threadsafe(self._wake)
            except RuntimeError:  # the loop ended without closing the channel
                self._open = False

    def _wake(self) -> None:
        with self._lock:
            self._woken = False
            arrived, self._arrived = self._arrived, set()
        if self._open:
            self._on_wake(arrived)
