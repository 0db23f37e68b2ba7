"""Data that screens hand out to be drawn: pictures of a run, the mesh of its part."""

import asyncio
import gzip
import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from starlette.responses import Response

from controller.arrays import Grey
from controller.cad import Solid
from controller.config.files import file_within
from controller.results.judged.cad import solid_of
from drivers.pictures import BrokenPictureError, decode
from messages import say

PICTURE_WIDTH_PX: Final = 640
PICTURE_QUALITY: Final = 82
PICTURE_MAX_BYTES: Final = 64_000_000
TRIANGLE_MAX_COUNT: Final = 150_000


def grey_picture(path: Path) -> Grey | None:
    """Return a picture's grey levels (height, width); None where there is none of sound size."""
    try:
        if path.stat().st_size > PICTURE_MAX_BYTES:
            return None
        return np.asarray(decode(path.read_bytes(), "grey"), dtype=np.uint8)
    except (OSError, BrokenPictureError):
        return None


@lru_cache(maxsize=64)
def picture_bytes(path: Path) -> bytes | None:
    """Return a picture of the run as JPEG, narrower; None where there is none."""
    image = grey_picture(path)
    return None if image is None else _shown_bytes(image)


def _shown_bytes(image: Grey) -> bytes:
    height, width = image.shape[:2]
    if width > PICTURE_WIDTH_PX:
        size = (PICTURE_WIDTH_PX, round(height * PICTURE_WIDTH_PX / width))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, PICTURE_QUALITY])
    return jpeg.tobytes()


async def run_picture(folder: Path, name: str) -> Response | None:
    """Return a picture of a run as an answer that browsers may cache; None without one.

    Parameters
    ----------
    folder : folder of the run
    name : as the journal has it
    """
    path = file_within(folder, name)
    found = None if path is None else await asyncio.to_thread(picture_bytes, path)
    if found is None:
        return None
    return _kept_answer(found)


async def picture_of(data: bytes) -> Response | None:
    """Return a picture as an answer that browsers may cache; None if it cannot be read.

    Parameters
    ----------
    data : content of its file
    """

    def drawn() -> bytes | None:
        try:
            return _shown_bytes(np.asarray(decode(data, "grey"), dtype=np.uint8))
        except BrokenPictureError:
            return None

    found = await asyncio.to_thread(drawn) if len(data) <= PICTURE_MAX_BYTES else None
    return None if found is None else _kept_answer(found)


def _kept_answer(jpeg: bytes) -> Response:
    headers = {"Cache-Control": "private, max-age=86400, immutable"}
    return Response(jpeg, media_type="image/jpeg", headers=headers)


def why_not_drawn(count: int) -> str:
    """Return the reason why a mesh of so many triangles is not drawn; empty where it is."""
    if count <= TRIANGLE_MAX_COUNT:
        return ""
    return say(
        "the part has {count} triangles, {triangle_max_count} at most are drawn",
        count=count,
        triangle_max_count=TRIANGLE_MAX_COUNT,
    )


def mesh_of(recipe: Mapping[str, Any], stored: Mapping[str, str], folder: Path) -> dict[str, Any]:
    """Return the part's mesh in its CAD frame [mm] as JSON, or why there is none to draw.

    With the face of each triangle, and name and area of each face.

    Parameters
    ----------
    recipe : recipe of the run
    stored : files that the run was started with, as its first row has them
    folder : folder of the run
    """
    solid = solid_of(recipe, stored, folder)
    if not isinstance(solid, Solid):
        return {"why": solid}
    if why := why_not_drawn(len(solid.mesh.faces)):
        return {"why": why}
    return {
        "vertices": np.round(np.asarray(solid.mesh.vertices), 3).ravel().tolist(),
        "triangles": np.asarray(solid.mesh.faces).ravel().tolist(),
        "face_of_triangle": np.asarray(solid.face_of_triangle).tolist(),
        "faces": [
            {"face": number, "label": face.label, "area_mm2": round(float(face.area_mm2), 1)}
            for number, face in enumerate(solid.faces)
        ],
    }


def packed_json(content: object) -> bytes:
    """Return JSON, compressed by gzip."""
    return gzip.compress(json.dumps(content, separators=(",", ":")).encode(), 5, mtime=0)


def packed(content: bytes) -> Response:
    """Return compressed JSON as an answer."""
    return Response(content, media_type="application/json", headers={"Content-Encoding": "gzip"})
