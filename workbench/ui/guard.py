"""Who may speak to the server: pages that it gave out itself, to a person who has the address with its token."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse

__all__ = ["Guard"]

_Scope = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
_Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
_App = Callable[[_Scope, _Receive, _Send], Awaitable[None]]

_READS = {"GET", "HEAD"}
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
        "frame-src 'self'; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Let a request pass that is to this address, from this address, and has the token; refuse all others with 403.

    The Host is checked because a name that resolves to the loopback address could reach the server (DNS rebinding),
    the Origin because any page can send to it, the token because any user of the machine can.

    Args:
        app: behind it.
        token: in the address once, then in a cookie.
        port: of the server.
    """

    def __init__(self, app: _App, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._cookie = f"workbench-{port}"  # cookies are shared between ports
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: _Scope, receive: _Receive, send: _Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # no other protocol is spoken
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        why = self._refused(scope["method"], headers, given)
        app: Any = self._app if why is None else PlainTextResponse(f"forbidden: {why}\n", 403)

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                own = {name.lower() for name, _ in message["headers"]}
                for name, value in _HEADERS.items():
                    if name.lower().encode() not in own:
                        message["headers"].append((name.lower().encode(), value.encode()))
                if why is None and given:
                    cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                    message["headers"].append((b"set-cookie", cookie.encode()))
            await send(message)

        await app(scope, receive, with_headers)

    def _refused(self, method: str, headers: MutableMapping[str, str], given: str) -> str | None:
        """Return why a request is refused; None: it is not."""
        if headers.get("host", "") not in self._hosts:
            return "this server answers to 127.0.0.1 and localhost only"
        origin = headers.get("origin")
        same = origin is not None and origin.removeprefix("http://") == headers["host"]
        if (origin is not None or method not in _READS) and not same:
            return "the request comes from another page"
        pairs = (pair.strip().partition("=") for pair in headers.get("cookie", "").split(";"))
        known = given or next((value for name, _, value in pairs if name == self._cookie), "")
        if not secrets.compare_digest(known.encode(), self._token.encode()):
            return "the address lacks its token; take the one that `workbench ui` printed"
        return None
