"""From a request's bytes to an endpoint and back: paths, methods, JSON bodies."""

from typing import Any

from pydantic import BaseModel, ValidationError

from drivers.errors import DeviceError

from ..peer import Peer
from ..words import reply_bytes
from .api import BY_PATH, Control, Endpoint
from .openapi import DOCUMENT_PATH, document_bytes
from .server import Answer, Handle, error_body


class _Empty(BaseModel):
    """The body of a request that has none."""


def handle_for(control: Control) -> Handle:
    """Return the handler of requests to a running cell."""

    async def handle(peer: Peer, method: str, path: str, body: bytes) -> Answer:
        if path == DOCUMENT_PATH:
            if method != "GET":
                return 405, error_body(f"{path} takes GET")
            return 200, document_bytes()
        endpoint = BY_PATH.get(path)
        if endpoint is None:
            known = ", ".join([*BY_PATH, DOCUMENT_PATH])
            return 404, error_body(f"no such endpoint; the endpoints are {known}")
        if method != endpoint.method:
            return 405, error_body(f"{path} takes {endpoint.method}")
        try:
            taken = _body(endpoint, body)
        except ValidationError as error:
            return 422, error_body("; ".join(_sentence(one) for one in error.errors()))
        try:
            reply = await endpoint.call(control, peer, taken)
        except DeviceError as error:
            return 503, error_body(str(error))
        return reply.status, reply_bytes(reply.body)

    return handle


def _body(endpoint: Endpoint, body: bytes) -> BaseModel:
    if endpoint.takes is None:
        return _Empty()
    return endpoint.takes.model_validate_json(body or b"{}")


def _sentence(error: Any) -> str:  # noqa: ANN401  (pydantic's own dictionary)
    where = ".".join(str(part) for part in error["loc"]) or "body"
    return f"{where}: {error['msg']}"
