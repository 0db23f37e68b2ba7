"""The payloads and the REST wire, described in OpenAPI 3.1, made from the models.

``python -m controller.plant.schema > docs/plant-api.json`` stores it; a test fails when that file
is out of date.
"""

import json
import sys
from functools import cache
from typing import Any, Final

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from .model import (
    AlarmNotice,
    CellState,
    OrderMessage,
    OrderRefusal,
    OrderRequest,
    OrderState,
    PartResult,
)

_AT: Final = "#/components/schemas/{model}"
_SEND: Final[tuple[type[BaseModel], ...]] = (
    AlarmNotice,
    CellState,
    OrderRefusal,
    OrderState,
    PartResult,
)
_TAKE: Final[tuple[type[BaseModel], ...]] = (OrderMessage, OrderRequest)
_ERROR: Final = {
    "type": "object", "required": ["error"], "additionalProperties": False,
    "properties": {"error": {"type": "string", "description": "why, as a sentence"}},
}  # fmt: skip
_OFFER: Final = {
    "type": "object", "additionalProperties": False,
    "required": ["recipe", "name", "sha256", "quantity", "problem"],
    "properties": {
        "recipe": {"type": "string"}, "name": {"type": "string"},
        "sha256": {"type": ["string", "null"]}, "quantity": {"type": "integer"},
        "problem": {"type": ["string", "null"]},
    },
}  # fmt: skip
_REASONS: Final = {
    "401": "name or password is wrong",
    "404": "there is no such thing",
    "405": "another method",
    "408": "the body did not arrive in time",
    "409": "refused, with the reason",
    "413": "the body is too large",
    "422": "a value is wrong",
    "429": "too many attempts to log in",
    "503": "the cell cannot be asked",
}
_ALWAYS: Final = ("401", "429", "503")


def document() -> dict[str, Any]:
    """Return the description."""
    _, sent = models_json_schema([(one, "serialization") for one in _SEND], ref_template=_AT)
    _, taken = models_json_schema([(one, "validation") for one in _TAKE], ref_template=_AT)
    schemas = {**taken["$defs"], **sent["$defs"], "Error": _ERROR, "Offer": _OFFER}
    schemas["OrderRequest"] = taken["$defs"]["OrderRequest"]
    run, part = _parameter("run", "path", {"type": "string"}), _whole("part", "path", 1, 2**20)
    number = _parameter("number", "path", {"type": "string", "minLength": 1, "maxLength": 80})
    listed = [_whole("after", "query", 0, 2**53), _whole("limit", "query", 1, 500)]
    revision = _whole("revision", "query", 0, 2**31)
    of_part = "/api/v1/parts/{run}/{part}"
    paths = {
        "/api/v1/state": {"get": _reads("state", "The state of the cell now.", "CellState")},
        "/api/v1/recipes": {"get": _reads("recipes", "Recipes an order may name.", ["Offer"])},
        "/api/v1/parts": {
            "get": _reads(
                "parts",
                "Results of the journal in use, oldest first: ask again after the last `seq`.",
                ["PartResult"],
                listed,
                ("422",),
            )
        },
        of_part: {
            "get": _reads(
                "part", "The result of a part.", "PartResult", [run, part, revision], ("404", "422")
            )
        },
        f"{of_part}/report": {
            "get": _reads(
                "report", "All of a part's result: schema cellctl.result.", None, [run, part],
                ("404",),
            )
        },
        "/api/v1/orders": {"get": _reads("orders", "All orders, oldest first.", ["OrderState"])},
        "/api/v1/orders/{number}": {
            "get": _reads("order", "An order.", "OrderState", [number], ("404",)),
            "put": {
                **_reads(
                    "put_order",
                    "Give an order; the same again changes nothing. A refusal is its state.",
                    "OrderState",
                    [number],
                    ("408", "409", "413", "422"),
                ),
                "requestBody": {"required": True, "content": _content("OrderRequest")},
            },
            "delete": _reads(
                "withdraw", "Take back an order that has not begun.", "OrderState", [number],
                ("404", "409"),
            ),
        },
        "/api/v1/stop": {
            "post": {
                **_reads(
                    "stop", "Stop the cell on a ramp.", None, [], ("408", "409", "413", "422")
                ),
                "requestBody": {
                    "required": False,
                    "content": {
                        "application/json": {
                            "schema": {
                                "type": "object", "additionalProperties": False,
                                "properties": {"why": {"type": "string"}},
                            }
                        }
                    },
                },
            }
        },
    }  # fmt: skip
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "cellctl: a cell in a plant",
            "version": "1",
            "description": "What `cellctl connect` serves where the cell file has `connect.rest`, "
            "and the payloads of all its wires. Accounts: `cellctl account NAME --role plant`.",
        },
        "paths": paths,
        "security": [{"account": []}],
        "components": {
            "schemas": dict(sorted(schemas.items())),
            "securitySchemes": {"account": {"type": "http", "scheme": "basic"}},
        },
    }


@cache
def document_bytes() -> bytes:
    """Return the description as served and stored."""
    return (json.dumps(document(), indent=1, ensure_ascii=False) + "\n").encode()


def _reads(
    name: str,
    summary: str,
    returns: str | list[str] | None,
    parameters: list[dict[str, Any]] | None = None,
    refusals: tuple[str, ...] = (),
) -> dict[str, Any]:
    codes = sorted({*_ALWAYS, *refusals})
    errors = {code: {"description": _REASONS[code], "content": _content("Error")} for code in codes}
    return {
        "operationId": name,
        "summary": summary,
        "parameters": parameters or [],
        "responses": {"200": {"description": "done", "content": _content(returns)}, **errors},
    }


def _content(model: str | list[str] | None) -> dict[str, Any]:
    if model is None:
        schema: dict[str, Any] = {"type": "object"}
    elif isinstance(model, list):
        schema = {"type": "array", "items": {"$ref": _AT.format(model=model[0])}}
    else:
        schema = {"$ref": _AT.format(model=model)}
    return {"application/json": {"schema": schema}}


def _parameter(name: str, place: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, "in": place, "required": place == "path", "schema": schema}


def _whole(name: str, place: str, least: int, most: int) -> dict[str, Any]:
    return _parameter(name, place, {"type": "integer", "minimum": least, "maximum": most})


if __name__ == "__main__":
    sys.stdout.buffer.write(document_bytes())
