"""What the page hands out beside HTML: its own files, pictures of the run, the part's mesh."""

import gzip
import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from controller.cad import Solid
from controller.results.judged import solid_of

from .fold import RunFold

TYPES: Final = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
STATIC: Final = (
    "now.js",
    "scene.js",
    "page.css",
    "icon.svg",
    "three/three.module.min.js",
    "three/three.core.min.js",
)
PICTURE_WIDTH_PX: Final = 640
PICTURE_QUALITY: Final = 82
PICTURE_MAX_BYTES: Final = 64_000_000
TRIANGLE_MAX_COUNT: Final = 150_000


@dataclass(frozen=True, slots=True)
class StaticFile:
    """A file of the page.

    Attributes
    ----------
    content, packed : its bytes, and the same compressed by gzip
    tag : changes with the content
    """

    content: bytes
    packed: bytes
    kind: str
    tag: str


def static_files() -> dict[str, StaticFile]:
    """Return all files of the page by name; no other file can be fetched."""
    found = {}
    for name in STATIC:
        content = (files(__package__) / "static").joinpath(*name.split("/")).read_bytes()
        tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
        kind = TYPES[Path(name).suffix]
        found[name] = StaticFile(content, gzip.compress(content, 6, mtime=0), kind, tag)
    return found


@lru_cache(maxsize=64)
def picture_bytes(path: Path) -> bytes | None:
    """Return a picture of the run as JPEG, narrower; None where there is none."""
    try:
        if path.stat().st_size > PICTURE_MAX_BYTES:
            return None
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError:
        return None
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        return None
    height, width = image.shape[:2]
    if width > PICTURE_WIDTH_PX:
        size = (PICTURE_WIDTH_PX, round(height * PICTURE_WIDTH_PX / width))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, PICTURE_QUALITY])
    return jpeg.tobytes()


def mesh_of(fold: RunFold, folder: Path) -> dict[str, Any]:
    """Return the part's mesh in its CAD frame [mm] as JSON, or why there is none to draw.

    Parameters
    ----------
    fold : of the run
    folder : of the run
    """
    if fold.began is None:
        return {"why": "the run has only begun"}
    solid = solid_of(fold.began.recipe, fold.began.files, folder)
    if not isinstance(solid, Solid):
        return {"why": solid}
    count = len(solid.mesh.faces)
    if count > TRIANGLE_MAX_COUNT:
        return {"why": f"the part has {count} triangles, {TRIANGLE_MAX_COUNT} at most are drawn"}
    return {
        "vertices": np.round(np.asarray(solid.mesh.vertices), 3).ravel().tolist(),
        "triangles": np.asarray(solid.mesh.faces).ravel().tolist(),
    }


def packed_json(content: object) -> bytes:
    """Return JSON, compressed by gzip."""
    return gzip.compress(json.dumps(content, separators=(",", ":")).encode(), 5, mtime=0)
