"""Who may see the page and who may ask: tokens, and exact lists of hosts and origins.

A page on another site must not reach the console through the operator's browser, not even by making its own
name point here (DNS rebinding). So what `Host` and `Origin` may say is written down beforehand, never derived
from the request; and the token travels in the part of the address that browsers send to nobody.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from labr_autonomy.errors import BadInput

TOKEN_BYTES = 16  # 128 bits
TOKEN_CHARACTERS = 22  # of URL-safe base64
SOCKET_PATH = "/_nicegui_ws/"
POLICY = (
    # the page's framework compiles templates in the browser; nothing may be loaded from, or sent, elsewhere
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


@dataclass(frozen=True, slots=True)
class Access:
    """Tokens and names of one console."""

    operator: str
    viewer: str
    host: str
    port: int

    def role(self, token: str) -> str:
        """What a token opens: "operator", "viewer", or ""."""
        given = token.encode("utf-8", "replace")
        operator = secrets.compare_digest(given, self.operator.encode())
        viewer = secrets.compare_digest(given, self.viewer.encode())
        return "operator" if operator else "viewer" if viewer else ""

    @property
    def hosts(self) -> frozenset[str]:
        """What `Host` may say."""
        own = f"[{self.host}]" if ":" in self.host else self.host
        names = {own, "localhost"} if is_local(self.host) else {own}
        return frozenset(f"{name}:{self.port}" for name in names)

    @property
    def origins(self) -> frozenset[str]:
        """What `Origin` may say."""
        return frozenset(f"http://{host}" for host in self.hosts)

    def url(self, token: str) -> str:
        """The address to open."""
        own = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{own}:{self.port}/#t={token}"


def make_access(host: str, port: int, token_file: Path | None) -> Access:
    """Tokens for a console: new ones, or those of a file.

    Args:
        host: Address to bind.
        port: Port of the page.
        token_file: Holds the operator's token; needed for any address but this machine's own.

    Raises:
        BadInput: when the address needs a token file, or the file is not fit.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise BadInput(f"'{host}' is no IP address", "Name one of this machine, such as 127.0.0.1") from None
    if address.is_unspecified:
        raise BadInput(
            f"{host} would listen on every network of this machine",
            "Name the one address that the tablet uses",
        )
    if token_file is None:
        if not address.is_loopback:
            raise BadInput(
                f"a console on {host} can be reached by others and needs a token that you keep",
                "Make a file with: umask 077; python3 -c 'import secrets; print(secrets.token_urlsafe(16))' "
                "> token, and name it with --token-file",
            )
        return Access(secrets.token_urlsafe(TOKEN_BYTES), secrets.token_urlsafe(TOKEN_BYTES), host, port)
    operator = read_token(token_file)
    viewer = hmac.new(operator.encode(), b"labr console viewer", hashlib.sha256).hexdigest()[:32]
    return Access(operator, viewer, host, port)


def read_token(path: Path) -> str:
    """The token in a file.

    Raises:
        BadInput: when others can read it, or it is not long enough.
    """
    try:
        mode = path.stat().st_mode
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"the token file {path} cannot be read: {error}", "Check --token-file") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise BadInput(f"the token file {path} can be read by others", f"Say chmod 600 {path}")
    if not re.fullmatch(rf"[A-Za-z0-9_-]{{{TOKEN_CHARACTERS},200}}", token):
        raise BadInput(
            f"the token in {path} is not one of at least {TOKEN_CHARACTERS} letters, digits, '-' or '_'",
            "Make one with: python3 -c 'import secrets; print(secrets.token_urlsafe(16))'",
        )
    return token


def is_local(host: str) -> bool:
    """Whether only this machine can reach an address."""
    return ipaddress.ip_address(host).is_loopback


class Gate:
    """ASGI middleware in front of everything: hosts, origins, and headers that keep the page to itself.

    Args:
        app: What is guarded.
        access: The lists.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._hosts, self._origins = app, access.hosts, access.origins

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a connection through, or say why not."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self.refusal(scope)
        if not refusal:
            await self._app(scope, receive, _with_headers(send) if scope["type"] == "http" else send)
        elif scope["type"] == "websocket":
            await WebSocketClose(code=1008, reason=refusal)(scope, receive, send)
        else:
            await PlainTextResponse(f"{refusal}\n", status_code=400)(scope, receive, send)

    def refusal(self, scope: Scope) -> str:
        """Why this connection is not for us; "" when it is."""
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "this console does not answer to that name"
        if any(origin not in self._origins for origin in origins):
            return "this console does not answer to pages of other sites"
        if scope["type"] == "websocket":
            return "" if len(origins) == 1 else "a page says where it comes from"
        if scope["path"].startswith(SOCKET_PATH):
            return "live data travel by WebSocket only"
        return "" if scope["method"] in ("GET", "HEAD") else "there is nothing to be sent here"


def _with_headers(send: Send) -> Send:
    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = POLICY
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
        await send(message)

    return guarded
