"""The page's own files: scripts, style and icon of the frame and of each screen."""

import gzip
import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Final

TYPES: Final = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


@dataclass(frozen=True, slots=True)
class StaticFile:
    """A file of the page.

    Attributes
    ----------
    content, packed : its bytes, and the same compressed by gzip
    kind : its type, as browsers name it
    tag : changes with the content
    """

    content: bytes
    packed: bytes
    kind: str
    tag: str


def static_files(screens: Iterable[str]) -> dict[str, StaticFile]:
    """Return all files of the page by name; no other file can be fetched.

    Parameters
    ----------
    screens : names of the screens; files of a screen stand below its name, others at the top
    """
    found = {}
    folders = [("", "frame"), *((f"{name}/", name) for name in screens)]
    for prefix, package in folders:
        for name, file in _within(files(f"controller.page.{package}") / "static", ""):
            content = file.read_bytes()
            tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
            kind = TYPES[f".{name.rpartition('.')[2]}"]
            packed = gzip.compress(content, 6, mtime=0)
            found[prefix + name] = StaticFile(content, packed, kind, tag)
    return found


def _within(folder: Traversable, prefix: str) -> Iterator[tuple[str, Traversable]]:
    if not folder.is_dir():
        return
    for one in folder.iterdir():
        if one.is_dir():
            yield from _within(one, f"{prefix}{one.name}/")
        elif f".{one.name.rpartition('.')[2]}" in TYPES:
            yield prefix + one.name, one
