"""The run's end of the control socket.

`api.py` has the endpoints, `routes.py` leads a request to its endpoint, `server.py` serves,
`openapi.py` describes it all (docs/control-api.json).
"""

from .api import ENDPOINTS, STOPS, Control, Endpoint
from .openapi import DOCUMENT_PATH, document, document_bytes
from .routes import handle_for
from .server import MAX_BODY_BYTES, MAX_CONNECTION_COUNT, MAX_HEADER_BYTES, Door, serving

__all__ = [
    "DOCUMENT_PATH",
    "ENDPOINTS",
    "MAX_BODY_BYTES",
    "MAX_CONNECTION_COUNT",
    "MAX_HEADER_BYTES",
    "STOPS",
    "Control",
    "Door",
    "Endpoint",
    "document",
    "document_bytes",
    "handle_for",
    "serving",
]
