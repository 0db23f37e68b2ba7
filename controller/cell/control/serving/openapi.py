"""The OpenAPI description of the control socket, made from its endpoints and models.

``python -m controller.cell.control.serving > docs/control-api.json`` stores it; a test fails when
that file is out of date.
"""

import json
from functools import cache
from typing import Any, Final

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from controller.cell.lock import LOCK_NAME

from ..words import ErrorReply
from .api import ENDPOINTS, Endpoint

DOCUMENT_PATH: Final = "/openapi.json"
_AT: Final = "#/components/schemas/{model}"
_ERRORS: Final = {
    "400": "no HTTP request",
    "403": "another user's cell",
    "404": "no such endpoint",
    "405": "another method",
    "408": "the request did not arrive in time",
    "413": "the body is too large",
    "417": "the body waits for a go-ahead",
    "422": "a field is wrong",
    "431": "the header is too large",
    "500": "internal error",
    "501": "another transfer coding than chunked",
    "503": "a device does not answer, or too many requests wait for their answers",
}


def document() -> dict[str, Any]:
    """Return the description, OpenAPI 3.1."""
    models: set[type[BaseModel]] = {ErrorReply}
    for endpoint in ENDPOINTS:
        models |= {endpoint.returns, *([endpoint.takes] if endpoint.takes else [])}
    ordered = sorted(models, key=lambda model: model.__name__)
    _, schemas = models_json_schema([(model, "validation") for model in ordered], ref_template=_AT)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "cellctl: a running cell",
            "version": "1",
            "description": "HTTP over a unix socket of the user who runs the cell. Its path is "
            f"`control` in the JSON of `{LOCK_NAME}` in the folder of runs, and `holder.control` "
            "in `cellctl status --json`. Durations are cell seconds. Orders are journaled with who "
            "gave them and why.",
        },
        "paths": {one.path: {one.method.lower(): _operation(one)} for one in ENDPOINTS},
        "components": {"schemas": schemas["$defs"]},
    }


@cache
def document_bytes() -> bytes:
    """Return the description as served and stored."""
    return (json.dumps(document(), indent=1, ensure_ascii=False) + "\n").encode()


def _operation(endpoint: Endpoint) -> dict[str, Any]:
    replies = {
        code: {"description": why, "content": _content(ErrorReply)} for code, why in _ERRORS.items()
    }
    replies["200"] = {"description": "taken", "content": _content(endpoint.returns)}
    found: dict[str, Any] = {
        "operationId": endpoint.path.strip("/"),
        "summary": endpoint.summary,
    }
    if endpoint.is_stop:
        found["description"] = (
            "While the run is late by 0.2 s of the cell's time or more, its supervisor takes this "
            "order and stops the cell, if the request line has no query; the answer follows when "
            "the run can give it."
        )
    if endpoint.takes is not None:
        found["requestBody"] = {"required": False, "content": _content(endpoint.takes)}
        replies["409"] = {
            "description": "refused, with the reason",
            "content": _content(endpoint.returns),
        }
    found["responses"] = dict(sorted(replies.items()))
    return found


def _content(model: type[BaseModel]) -> dict[str, Any]:
    return {"application/json": {"schema": {"$ref": _AT.format(model=model.__name__)}}}
