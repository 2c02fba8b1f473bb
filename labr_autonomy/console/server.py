"""The console's own process: serves the page and feeds it. The executive imports nothing of this.

Started by `labr_autonomy.console.process`, which hands over what to show on standard input, as JSON:
`{"host", "port", "token_file", "pid" or "run", "parent"}`. It answers with one line of JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import logging
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from types import FrameType
from typing import Any

import nicegui
import uvicorn
from fastapi import FastAPI
from nicegui import Client, app, core, ui

from labr_autonomy.clock import SystemClock
from labr_autonomy.console.access import Access, Gate, make_access
from labr_autonomy.console.feed import Feed, LiveFeed
from labr_autonomy.console.pages import PAGE, Pages, run_push
from labr_autonomy.errors import BadInput, LabrError
from labr_autonomy.processes import die_with_parent

NICE = 6  # the page yields to planning, and planning to the set-points
LARGEST_MESSAGE = 64 * 1024  # that a page may send
TITLE = "LABR console"


def serve(spec: dict[str, Any]) -> None:
    """Serve until told to end."""
    token_file = spec.get("token_file")
    # before anything listens, or is looked up
    allowed = make_access(spec["host"], spec["port"], Path(token_file) if token_file else None)
    listener = _listen(spec["host"], spec["port"])
    access = dataclasses.replace(allowed, port=listener.getsockname()[1])
    feed = _feed(spec)
    try:
        server = Server(
            uvicorn.Config(
                build(feed, access),
                log_level="warning",
                ws_max_size=LARGEST_MESSAGE,
                ws_max_queue=8,
                timeout_graceful_shutdown=1,
                server_header=False,
            )
        )
        _say({"event": "ready", "urls": [access.url(access.operator), access.url(access.viewer)]})
        server.run(sockets=[listener])
    finally:
        feed.close()
        listener.close()


class Server(uvicorn.Server):
    """Ends when it is told to, but not by Ctrl-C: that is for the executive, and means hold at first."""

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Called by the handlers that uvicorn sets while it serves."""
        if sig != signal.SIGINT:
            super().handle_exit(sig, frame)


def build(feed: Feed, access: Access) -> Gate:
    """The web application.

    Args:
        feed: What is shown.
        access: Who may see it.
    """
    pages = Pages(feed, access, SystemClock())

    @ui.page("/", title=TITLE, response_timeout=10)
    def page(client: Client) -> None:
        ui.add_head_html('<link rel="stylesheet" href="/page/cockpit.css">')
        ui.add_body_html('<div id="boot">LABR console<br><small>connecting ...</small></div>')
        pages.build(client)

    @contextlib.asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        async with asyncio.TaskGroup() as tasks:
            pushing = tasks.create_task(run_push(pages), name="push to pages")
            yield
            pushing.cancel()

    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=life)
    app.add_static_files("/page", str(PAGE), max_cache_age=0)
    import nicegui.elements.scene  # noqa: F401 - makes its three.js known to the page

    ui.run_with(
        outer,
        title=TITLE,
        favicon=PAGE / "icon.svg",
        dark=None,
        tailwind=False,
        reconnect_timeout=5.0,
        message_history_length=0,  # what a page has missed is of no interest to it
        binding_refresh_interval=None,
        show_welcome_message=False,
    )
    core.app.config.socket_io_js_transports = ["websocket"]
    return Gate(outer, access)


def _feed(spec: dict[str, Any]) -> Feed:
    if "run" in spec:
        from labr_autonomy.console.recording import RecordedFeed

        return RecordedFeed(Path(spec["run"]), SystemClock())
    return LiveFeed(int(spec["pid"]), SystemClock())


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(64)  # now, so that whoever is told the address can reach it at once
    except OSError as error:
        listener.close()
        raise BadInput(
            f"the console cannot listen on {host}:{port}: {error.strerror}", "Choose another --port or --host"
        ) from None
    return listener


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main() -> int:
    """Read what to serve, and serve it."""
    spec = json.loads(sys.stdin.readline())
    die_with_parent(signal.SIGTERM, parent_pid=spec["parent"])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # until it serves; see Server
    os.nice(NICE)
    logging.basicConfig(
        level=logging.INFO, format="%(relativeCreated)9d ms %(levelname)-7s %(name)s: %(message)s"
    )
    for talkative in ("httpx", "socketio", "engineio"):
        logging.getLogger(talkative).setLevel(logging.WARNING)
    try:
        serve(spec)
    except LabrError as error:
        _say({"event": "refused", "what": error.what, "do": error.do, "exit_code": int(error.exit_code)})
        return int(error.exit_code)
    return 0


assert nicegui.__version__ >= "3", "run_with and esm components are of NiceGUI 3"

if __name__ == "__main__":
    sys.exit(main())
