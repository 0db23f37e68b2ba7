"""Code shared by all screens: routes, access, languages, files, pictures, style.

Its `templates/` and `static/` are there for every screen: `screen.html.j2` is extended by the
page of a screen, `/static/shared.js` has its texts, numbers and orders.
"""

from .screens import (
    GetRoute,
    NoBody,
    PostBody,
    PostRoute,
    RequestRefusedError,
    Screen,
    Setting,
    Upload,
)
from .uploads import Uploaded
from .visit import JsonAnswer, PageFrame, Visit, refused, worded
from .words import word

__all__ = [
    "GetRoute",
    "JsonAnswer",
    "NoBody",
    "PageFrame",
    "PostBody",
    "PostRoute",
    "RequestRefusedError",
    "Screen",
    "Setting",
    "Upload",
    "Uploaded",
    "Visit",
    "refused",
    "word",
    "worded",
]
