"""Code shared by all screens: routes, access, languages, files, pictures, style.

Its `templates/` and `static/` are there for every screen: `screen.html.j2` is extended by the
page of a screen, `/static/shared.js` has its texts, numbers and orders.
"""

from .screens import Act, Body, Look, NoBody, RefusedError, Screen, Setting, Upload
from .uploads import Uploaded
from .visit import Frame, Visit, refused
from .words import word

__all__ = [
    "Act",
    "Body",
    "Frame",
    "Look",
    "NoBody",
    "RefusedError",
    "Screen",
    "Setting",
    "Upload",
    "Uploaded",
    "Visit",
    "refused",
    "word",
]
