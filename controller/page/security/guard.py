"""Guard before all of the page: refuses requests that no browser of a person at this site sends.

It reads the whole request before the page sees it, within a size and a time, and adds the security
headers to every answer. The bytes of an upload are left to its handler, once their number is known
and allowed.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from .addresses import PageAddress

if TYPE_CHECKING:  # accounts are kept without the packages of the server
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

BODY_MAX_BYTES: Final = 65_536
BODY_WALL_S: Final = 10.0
# Time without progress after which an answer to a reader is given up.
SEND_WALL_S: Final = 20.0
PATH_MAX: Final = 1024
HEADER_MAX_BYTES: Final = 16_384

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "font-src 'self'; manifest-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'; require-trusted-types-for 'script'"
)
HEADERS: Final = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    # without any, browsers send `Origin: null` with the form of the log-in
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-embedder-policy", b"require-corp"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=(), usb=(), serial=()"),
    (b"x-robots-tag", b"noindex"),
)
STRICT_TRANSPORT: Final = (b"strict-transport-security", b"max-age=31536000")


class Guard:
    """The outermost layer of the server.

    Parameters
    ----------
    app : application behind it
    site : addresses by which browsers find it
    uploads : addresses that take a file, with its largest size [bytes]
    """

    def __init__(self, app: ASGIApp, site: PageAddress, uploads: Mapping[str, int]) -> None:
        self._app = app
        self._uploads = uploads
        self._hosts = frozenset(host.encode() for host in site.hosts)
        self._origins = frozenset(origin.encode() for origin in site.origins)
        self._headers = (*HEADERS, *((STRICT_TRANSPORT,) if site.is_secure else ()))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # the page has no websocket
            await send({"type": "websocket.close", "code": 1008})
            return
        guarded = self._guarded(send)
        refusal = self._refusal(scope)
        if refusal is None and self._upload_bytes(scope) is not None:
            await self._app(scope, receive, guarded)
            return
        if refusal is None:
            try:
                async with asyncio.timeout(BODY_WALL_S):
                    body = await _read(receive)
            except TimeoutError:
                refusal = (408, "the request did not arrive in time")
            else:
                if body is None:
                    refusal = (413, f"a request has {BODY_MAX_BYTES} bytes at most")
                else:
                    await self._app(scope, _again(body, receive), guarded)
                    return
        await _refuse(guarded, *refusal)

    def _upload_bytes(self, scope: Scope) -> int | None:
        """Return the largest size of the file that a request brings, None if it brings none."""
        return self._uploads.get(scope["path"]) if scope["method"] == "POST" else None

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return the status and the reason of a refused request, None for a valid one."""
        headers: list[tuple[bytes, bytes]] = scope["headers"]

        def every(name: bytes) -> list[bytes]:
            return [value for key, value in headers if key == name]

        host = every(b"host")
        if len(host) != 1 or host[0].lower() not in self._hosts:
            # another name for this address is how a foreign page gets round the same-origin rule
            return 421, "this server is not known by that name"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "there is no such method here"
        if len(scope["path"]) > PATH_MAX:
            return 414, "the address is too long"
        if sum(len(key) + len(value) for key, value in headers) > HEADER_MAX_BYTES:
            return 431, f"a header has {HEADER_MAX_BYTES} bytes at most"
        length = every(b"content-length")
        upload_bytes = self._upload_bytes(scope)
        max_bytes = BODY_MAX_BYTES if upload_bytes is None else upload_bytes
        if upload_bytes is not None and not length:
            return 411, "a file is sent with its length"
        if length and (not length[0].isdigit() or int(length[0]) > max_bytes):
            return 413, f"a request has {max_bytes} bytes at most"
        origin, fetched = every(b"origin"), every(b"sec-fetch-site")
        if scope["method"] == "POST":
            if len(origin) != 1 or origin[0].lower() not in self._origins:
                return 403, "the request comes from another page"
            if fetched and fetched[0] != b"same-origin":
                return 403, "the request comes from another page"
        elif origin and origin[0].lower() not in self._origins:
            return 403, "the request comes from another page"
        return None

    def _guarded(self, send: Send) -> Send:
        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in self._headers}
                kept = [pair for pair in message.get("headers", ()) if pair[0].lower() not in own]
                names = {name.lower() for name, _ in kept}
                if b"cache-control" not in names:
                    kept.append((b"cache-control", b"no-store"))
                message = {**message, "headers": [*kept, *self._headers]}
            async with asyncio.timeout(SEND_WALL_S):
                await send(message)

        return guarded


async def _read(receive: Receive) -> bytes | None:
    """Return the body of a request, None where it is too large."""
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return bytes(body)
        body += message.get("body", b"")
        if len(body) > BODY_MAX_BYTES:
            return None
        if not message.get("more_body", False):
            return bytes(body)


def _again(body: bytes, receive: Receive) -> Receive:
    """Return a receiver that replays a body already read, then continues."""
    is_read = False

    async def again() -> Message:
        nonlocal is_read
        if is_read:
            return await receive()
        is_read = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


async def _refuse(send: Send, status: int, reason: str) -> None:
    body = json.dumps({"error": reason}).encode()
    headers = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"),
    ]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
