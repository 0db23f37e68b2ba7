"""Results and state for those who ask, and orders, over HTTP with JSON.

Each request has an account of role `plant`: HTTP Basic with its name and password. A password that
was right once is known by its hash until its account changes, which is looked at once a minute:
to check one is slow on purpose, and takes 128 MB.
"""

import asyncio
import base64
import hashlib
import hmac
import json
import socket
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from controller.config.cell.connect import RestSection
from controller.config.cell.values import host_and_port
from controller.config.files import reason_of
from controller.page.frame.visit import address_of
from controller.page.http import Serving, config_of
from controller.page.security.addresses import is_loopback
from controller.page.security.sessions import Attempts
from messages import say

from ..model import OrderRequest, Payload, first_wrong
from ..plant import Plant, PlantError, RefusedError, UnknownError
from ..schema import document_bytes

BODY_MAX_BYTES: Final = 300_000  # 2,000 serial numbers of 80 signs
BODY_WALL_S: Final = 10.0
KNOWN_WALL_S: Final = 60.0  # an account that was taken back is out after this time
PARTS_MAX: Final = 500
# Names of what may follow `?`, of the list of parts and of anything else.
PARAMETERS: Final[dict[str, frozenset[str]]] = {"/api/v1/parts": frozenset({"after", "limit"})}
OTHER: Final = frozenset({"revision"})
REALM: Final = {"WWW-Authenticate": 'Basic realm="cellctl", charset="UTF-8"'}
Answer = Callable[[Request, str], Awaitable[Response]]


class _RefusalError(Exception):
    """A request is not answered as it hoped."""

    def __init__(self, status: int, why: str, headers: dict[str, str] | None = None) -> None:
        super().__init__(why)
        self.status = status
        self.headers = headers


class RestWire:
    """The server of this wire.

    Parameters
    ----------
    section : where it listens
    folder : folder of the cell file, from which its files are named

    Raises
    ------
    PlantError : the address is another than this machine's own, and there is no certificate
    """

    name = "rest"

    def __init__(self, section: RestSection, folder: Path) -> None:
        host, port = host_and_port(section.listen)
        if section.tls_cert is None and not is_loopback(host):
            raise PlantError(
                f"`connect.rest.listen`: {host}: passwords could be read on the way; give "
                "`tls_cert` and `tls_key`"
            )
        cert, key = section.tls_cert, section.tls_key
        self._serving = Serving(
            host,
            port,
            None if cert is None else folder / cert,
            None if key is None else folder / key,
        )
        self._known: dict[str, tuple[bytes, float, str]] = {}
        self._attempts = Attempts()
        self._one_at_a_time = asyncio.Semaphore(1)

    async def serve(self, plant: Plant) -> None:
        """Serve until cancelled.

        Raises
        ------
        PlantError : the address cannot be listened at, or the certificate cannot be read
        """
        host, port = self._serving.host, self._serving.port
        try:
            config = config_of(self.app(plant), self._serving)
            config.lifespan = "off"
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            with socket.create_server((host, port), family=family) as listening:
                await _Server(config).serve(sockets=[listening])
        except OSError as error:
            raise PlantError(f"{host}:{port}: {reason_of(error)}") from error

    def app(self, plant: Plant) -> Starlette:
        """Return the application; what it answers is described by docs/plant-api.json."""
        at = "/api/v1"
        answers: tuple[tuple[str, str, Answer], ...] = (
            ("GET", f"{at}/state", lambda r, w: _state(plant)),
            ("GET", f"{at}/recipes", lambda r, w: _recipes(plant)),
            ("GET", f"{at}/parts", lambda r, w: _parts(plant, r)),
            ("GET", f"{at}/parts/{{run}}/{{part}}", lambda r, w: _part(plant, r)),
            ("GET", f"{at}/parts/{{run}}/{{part}}/report", lambda r, w: _report(plant, r)),
            ("GET", f"{at}/orders", lambda r, w: _orders(plant)),
            ("GET", f"{at}/orders/{{number}}", lambda r, w: _order(plant, r)),
            ("PUT", f"{at}/orders/{{number}}", lambda r, w: _put_order(plant, r, w)),
            ("DELETE", f"{at}/orders/{{number}}", lambda r, w: _withdraw(plant, r, w)),
            ("POST", f"{at}/stop", lambda r, w: _stop(plant, r, w)),
        )
        by_path: dict[str, dict[str, Answer]] = {}
        for method, path, answer in answers:
            by_path.setdefault(path, {})[method] = answer
        routes = [
            Route(path, self._endpoint(plant, of_path), methods=[*of_path])
            for path, of_path in by_path.items()
        ]
        describe = Route("/openapi.json", _describe, methods=["GET"])
        return Starlette(
            routes=[describe, *routes], exception_handlers={404: _no_path, 405: _no_path}
        )

    def _endpoint(
        self, plant: Plant, answers: dict[str, Answer]
    ) -> Callable[[Request], Awaitable[Response]]:
        async def endpoint(request: Request) -> Response:
            try:
                who = await self._who(plant, request)
                method = "GET" if request.method == "HEAD" else request.method
                strange = sorted(
                    set(request.query_params) - PARAMETERS.get(request.url.path, OTHER)
                )
                if strange:  # a name mistyped must not count as not given
                    raise _RefusalError(422, f"there is no parameter {strange[0]!r:.50} here")
                return await answers[method](request, f"{who} by REST")
            except _RefusalError as refusal:
                return _said(refusal.status, str(refusal), refusal.headers)
            except UnknownError as error:
                return _said(404, str(error))
            except RefusedError as error:
                return _said(409, str(error))
            except PlantError as error:
                return _said(503, str(error))

        return endpoint

    async def _who(self, plant: Plant, request: Request) -> str:
        """Return the account of a request."""
        wrong = _RefusalError(401, "name or password is wrong; accounts: role plant", REALM)
        kind, _, text = request.headers.get("authorization", "").partition(" ")
        if kind.lower() != "basic":
            raise wrong
        try:
            name, _, password = base64.b64decode(text, validate=True).decode().partition(":")
        except ValueError:
            raise wrong from None
        mark = hashlib.sha256(f"{name}:{password}".encode()).digest()
        known, until_s, account = self._known.get(name, (b"", 0.0, ""))
        if hmac.compare_digest(known, mark):
            if time.monotonic() < until_s:
                return name
            if account == await asyncio.to_thread(plant.account_mark, name):
                self._known[name] = (mark, time.monotonic() + KNOWN_WALL_S, account)
                return name
        address = address_of(request)
        if self._attempts.seconds_to_wait(address) > 0:
            raise _RefusalError(429, "too many attempts; try again in some minutes")
        self._attempts.note(address)
        async with self._one_at_a_time:
            # asked before the check, so that no change is missed
            account = await asyncio.to_thread(plant.account_mark, name)
            if not await asyncio.to_thread(plant.may_enter, name, password):
                raise wrong
        self._attempts.forgive(address)
        self._known[name] = (mark, time.monotonic() + KNOWN_WALL_S, account)
        return name


class _Server(uvicorn.Server):
    """uvicorn's server without signal handlers of its own: the bridge has them."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the bridge."""
        yield


async def _state(plant: Plant) -> Response:
    return _json(await plant.state())


async def _recipes(plant: Plant) -> Response:
    found = await plant.recipes()
    return JSONResponse(
        [
            {"recipe": one.key, "name": one.name, "sha256": one.sha256 or None,
             "quantity": one.count, "problem": one.problem or None}
            for one in found
        ]
    )  # fmt: skip


async def _parts(plant: Plant, request: Request) -> Response:
    after = _count(request, "after", 0, 2**53)
    limit = _count(request, "limit", 100, PARTS_MAX, least=1)
    found = await plant.parts(after, limit)
    return JSONResponse([one.model_dump(mode="json", by_alias=True) for one in found])


async def _part(plant: Plant, request: Request) -> Response:
    revision = _count(request, "revision", 0, 2**31)
    return _json(await plant.part(*_of_part(request), revision or None))


async def _report(plant: Plant, request: Request) -> Response:
    return JSONResponse(dict(await plant.report(*_of_part(request))))


async def _orders(plant: Plant) -> Response:
    found = await plant.orders()
    return JSONResponse([one.model_dump(mode="json", by_alias=True) for one in found])


async def _order(plant: Plant, request: Request) -> Response:
    return _json(await plant.order_of(request.path_params["number"]))


async def _put_order(plant: Plant, request: Request, who: str) -> Response:
    body = await _body(request)
    try:
        order = OrderRequest.model_validate_json(body)
    except ValidationError as error:
        raise _RefusalError(422, first_wrong(error)) from None
    return _json(await plant.order(request.path_params["number"], order, who))


async def _withdraw(plant: Plant, request: Request, who: str) -> Response:
    return _json(await plant.withdraw(request.path_params["number"], who))


async def _stop(plant: Plant, request: Request, who: str) -> Response:
    body = await _body(request)
    try:
        asked = json.loads(body or b"{}")
        why = asked.pop("why", "") if isinstance(asked, dict) else None
    except ValueError:
        raise _RefusalError(422, "the body is no JSON") from None
    if not isinstance(why, str) or asked:
        raise _RefusalError(422, 'the body is {"why": TEXT}, or empty')
    return JSONResponse({"state": await plant.stop(who, why)})


async def _describe(_: Request) -> Response:
    return Response(document_bytes(), media_type="application/json")


async def _no_path(_: Request, error: Exception) -> Response:
    status = int(getattr(error, "status_code", 404))
    headers = getattr(error, "headers", None)
    return _said(status, "no such path" if status == 404 else "another method", headers)


def _of_part(request: Request) -> tuple[str, int]:
    run, part = request.path_params["run"], request.path_params["part"]
    if not part.isascii() or not part.isdigit() or len(part) > 9:
        raise UnknownError(f"run {run} has no part {part}")
    return run, int(part)


def _count(request: Request, name: str, default: int, most: int, least: int = 0) -> int:
    every = request.query_params.getlist(name)
    if not every:
        return default
    text = every[0]
    if len(every) > 1 or not (text.isascii() and text.isdigit() and least <= int(text) <= most):
        raise _RefusalError(422, f"{name} is a whole number, {least} to {most}")
    return int(text)


async def _body(request: Request) -> bytes:
    """Return the body of a request, within a size and a time."""
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_WALL_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > BODY_MAX_BYTES:
                    raise _RefusalError(
                        413,
                        say(
                            "a body has {body_max_bytes} bytes at most",
                            body_max_bytes=BODY_MAX_BYTES,
                        ),
                    )
    except TimeoutError:
        raise _RefusalError(408, "the request did not arrive in time") from None
    return bytes(body)


def _json(found: Payload) -> Response:
    return Response(found.model_dump_json(by_alias=True), media_type="application/json")


def _said(status: int, why: str, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"error": why}, status, headers)
