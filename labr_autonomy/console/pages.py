"""The pages that are open: who each is, what it has got, and what it asks.

Each page gets one message at a time and the newest state next, once it has said that it saw the last; what a
page did not see is not kept for it. So a stalled page costs nothing, here or in the executive.
"""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nicegui import Client, ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from labr_autonomy.clock import Clock
from labr_autonomy.console.access import Access
from labr_autonomy.console.admission import LEASE_S
from labr_autonomy.console.feed import Feed, Seen
from labr_autonomy.console.requests import Kind, Request, finite, parse
from labr_autonomy.errors import BadInput

PAGE = Path(__file__).parent / "page"
PUSH_S = 0.05
KEEP_S = 1.0  # how often the executive hears when the page with control was last heard
REQUESTS_PER_S = 8.0  # of one page; an abort is never refused
BURST = 12.0
TRIES_MAX = 10  # wrong tokens of one page

log = logging.getLogger("labr.console")


class Cockpit(Element, component="page/cockpit.js", esm={"labr-page": "page/lib"}):
    """The page's content: everything else is in `page/`."""


@dataclass
class Session:
    """One open page."""

    name: str
    cockpit: Cockpit
    client: Client
    role: str = ""
    tries: int = 0
    seen: Seen = field(default_factory=Seen)
    number: int = 0  # of the last message
    waiting: bool = False  # for the page to have seen it
    heard_s: float = -math.inf
    budget: float = BURST
    budget_s: float = -math.inf
    last_asked: int = 0

    def may_ask(self, kind: str, now_s: float) -> bool:
        """Spend one request; an abort is free."""
        if kind == Kind.ABORT.value:
            return True
        self.budget = min(BURST, self.budget + (now_s - self.budget_s) * REQUESTS_PER_S)
        self.budget_s = now_s
        if self.budget < 1.0:
            return False
        self.budget -= 1.0
        return True


class Pages:
    """All open pages of one console.

    Args:
        feed: What they show.
        access: Who may.
        clock: Time.
    """

    def __init__(self, feed: Feed, access: Access, clock: Clock) -> None:
        self._feed, self._access, self._clock = feed, access, clock
        self._sessions: dict[str, Session] = {}
        self._keep_due_s = 0.0

    def build(self, client: Client) -> None:
        """Fill a new page."""
        ui.query(".nicegui-content").classes(remove="q-pa-md")
        cockpit = Cockpit()
        session = Session(self._new_name(), cockpit, client)
        self._sessions[client.id] = session
        cockpit.on("hello", lambda event: self._hello(session, event))
        cockpit.on("seen", lambda event: self._saw(session, event))
        cockpit.on("ask", lambda event: self._ask(session, event))
        cockpit.on("replay", lambda event: self._replay(session, event))
        client.on_connect(lambda: self._connected(session))
        client.on_delete(lambda: self._sessions.pop(client.id, None))

    def _new_name(self) -> str:
        """Four digits that no open page has: control goes by them."""
        taken = {session.name for session in self._sessions.values()}
        return next(n for n in iter(lambda: secrets.token_hex(2).upper(), "") if n not in taken)

    # ------------------------------------------------------------------ what pages say
    def _connected(self, session: Session) -> None:
        """After a break the page has lost what was on its way: begin anew."""
        session.waiting = False
        session.seen = Seen()

    def _hello(self, session: Session, event: GenericEventArguments) -> None:
        token = str(_fields(event).get("token", ""))[:200]
        session.tries += 1
        session.role = self._access.role(token) if session.tries <= TRIES_MAX else ""
        session.heard_s = self._clock.now_s()
        log.info("page %s: %s", session.name, session.role or "refused")
        session.cockpit.run_method("welcome", {"role": session.role, "page": session.name})

    def _saw(self, session: Session, event: GenericEventArguments) -> None:
        if _fields(event).get("number") == session.number:
            session.waiting = False
            session.heard_s = self._clock.now_s()

    def _ask(self, session: Session, event: GenericEventArguments) -> None:
        if session.role != "operator":
            return  # the buttons are not offered to viewers
        fields = _fields(event)
        if not session.may_ask(str(fields.get("kind")), self._clock.now_s()):
            log.warning("page %s asks too often", session.name)
            return
        try:
            request = parse({**fields, "page": session.name})
        except BadInput as error:
            log.warning("page %s: %s", session.name, error)
            return
        session.last_asked = max(session.last_asked, request.sequence)
        self._feed.ask(request)

    def _replay(self, session: Session, event: GenericEventArguments) -> None:
        fields = _fields(event)
        value = fields.get("value")
        figure = float(value) if finite(value) else None
        if session.role == "operator":
            self._feed.replay(str(fields.get("command")), figure)

    # ------------------------------------------------------------------ what pages get
    async def push(self) -> None:
        """Send each page what is new, for ever."""
        while True:
            await self._clock.sleep_until(self._clock.now_s() + PUSH_S)
            self._feed.poll()
            for session in list(self._sessions.values()):
                self._serve(session)
            self._keep_control()

    def _serve(self, session: Session) -> None:
        if not session.role or session.waiting or not session.client.has_socket_connection:
            return
        message = self._feed.news(session.seen)
        if message is None:
            return
        session.number += 1
        session.waiting = True
        session.cockpit.run_method("show", {**message, "number": session.number})

    def _keep_control(self) -> None:
        now_s = self._clock.now_s()
        if now_s < self._keep_due_s:
            return
        self._keep_due_s = now_s + KEEP_S
        for session in self._sessions.values():
            if session.role == "operator" and now_s - session.heard_s < LEASE_S:
                number = max(1, session.last_asked)
                self._feed.ask(Request(session.name, number, Kind.KEEP, session.heard_s))


def _fields(event: GenericEventArguments) -> dict[str, Any]:
    """What the page sent along; nothing of it is trusted."""
    return event.args if isinstance(event.args, dict) else {}


async def run_push(pages: Pages) -> None:
    """The push loop, which ends with the server."""
    try:
        await pages.push()
    except asyncio.CancelledError:
        log.info("no more pages are served")
        raise
