"""Pictures of the part from four sides, with each face coloured by its class in the ledger.

Patterns repeat the information of the colours. A face that was compared in part has white specks in
proportion to the share not compared; they show its amount, not its place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, Int32Array
from controller.cad import Solid
from controller.cell.journal.rows import FaceJudged
from controller.imaging import RayCaster

from ...ray_drawing import FINER, cast, jumps, smaller
from ..pictures import data_uri

ASPECT: Final = 1.25
ELEVATION_RAD: Final = float(np.radians(28.0))
SIDES: Final = (
    (-60.0, 1, "from above, front"),
    (120.0, 1, "from above, back"),
    (-60.0, -1, "from below, front"),
    (120.0, -1, "from below, back"),
)
LIGHT: Final = np.array([-0.35, -0.55, 0.76])
PAPER, INK, SPECK = 255.0, 40.0, 250.0
# Colours (BGR) of the classes, the same as in signed.html.j2.
COLOURS: Final[dict[str, tuple[float, float, float]]] = {
    "pass": (118.0, 154.0, 26.0),
    "fail": (0.0, 94.0, 213.0),
    "compared": (41.0, 180.0, 240.0),
    "not-compared": (SPECK, SPECK, SPECK),
}
STRIPE_PX: Final = 5
# Thresholds of an ordered dither, 4 by 4 cells.
DITHER: Final = (
    np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) + 0.5
) / 16  # fmt: skip
CELL_PX: Final = 2 * FINER


@dataclass(frozen=True, slots=True)
class CoverageSide:
    """Picture of the part from one side, as a data URI."""

    words: str
    uri: str


def face_class(face: FaceJudged) -> str:
    """Return the class of a face, by the ledger's names."""
    if face.verdict in ("pass", "fail"):
        return face.verdict
    return "compared" if face.compared_fraction > 0 else "not-compared"


def coverage_sides(
    solid: Solid, faces: Sequence[FaceJudged], width_px: int, jpeg: int
) -> tuple[CoverageSide, ...]:
    """Return pictures of the part from four sides.

    Parameters
    ----------
    solid : the part
    faces : report of each face
    width_px : width of a picture
    jpeg : JPEG quality, 0..100
    """
    caster = RayCaster(solid.mesh)
    by_face = {face.face: face for face in faces}
    sides = []
    for azimuth_deg, above, words in SIDES:
        axes = _axes(np.radians(azimuth_deg), above * ELEVATION_RAD)
        image = _picture(solid, caster, by_face, axes, (width_px, round(width_px / ASPECT)))
        sides.append(CoverageSide(words, data_uri(image, jpeg)))
    return tuple(sides)


def _picture(
    solid: Solid,
    caster: RayCaster,
    faces: dict[int, FaceJudged],
    axes: tuple[FloatArray, FloatArray, FloatArray],
    size_px: tuple[int, int],
) -> NDArray[np.uint8]:
    right, up, back = axes
    corners = np.asarray(solid.mesh.vertices) - solid.centroid_mm
    u, v = corners @ right, corners @ up
    width, height = (FINER * px for px in size_px)
    mm_per_px = 1.06 * max(np.ptp(u) / width, np.ptp(v) / height)
    x = (np.arange(width) - width / 2) * mm_per_px + (u.min() + u.max()) / 2
    y = (height / 2 - np.arange(height)) * mm_per_px + (v.min() + v.max()) / 2
    eye = solid.centroid_mm + 2 * float(np.linalg.norm(np.ptp(corners, axis=0))) * back
    origins = (eye + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)
    triangle, _ = cast(caster, origins, -back[None], (width, height))
    image = _paint(solid, faces, triangle, np.stack([right, up, back]))
    small = np.dstack([smaller(image[..., i].astype(np.float32)) for i in range(3)])
    return np.clip(small, 0, 255).astype(np.uint8)


def _paint(
    solid: Solid, faces: dict[int, FaceJudged], triangle: Int32Array, axes: FloatArray
) -> FloatArray:
    """Return the painted picture (height, width, 3), BGR."""
    names = list(COLOURS)
    ids = np.asarray(solid.face_of_triangle)
    known = int(ids.max()) + 1
    kind = np.full(known, names.index("not-compared"))
    share = np.zeros(known)
    for i, known_of_it in faces.items():
        if i < known:
            kind[i] = names.index(face_class(known_of_it))
            share[i] = known_of_it.compared_fraction
    on = triangle >= 0
    face = np.where(on, ids[triangle], 0)
    rows, columns = np.indices(triangle.shape)
    dither = DITHER[(rows // CELL_PX) % 4, (columns // CELL_PX) % 4]
    light = np.clip(np.asarray(solid.mesh.face_normals) @ (LIGHT @ axes), 0, 1)
    level = (0.72 + 0.28 * light)[triangle]
    colour = np.array([COLOURS[name] for name in names])[kind[face]]
    flat_rows = (rows // (STRIPE_PX * FINER)) % 2 == 0
    upright = (columns // (STRIPE_PX * FINER)) % 2 == 0
    white = dither > share[face]
    white |= (kind[face] == names.index("fail")) & flat_rows
    white |= (kind[face] == names.index("compared")) & upright
    image = np.where(white[..., None], SPECK, colour) * level[..., None]
    image = np.where(on[..., None], image, PAPER)
    for here, there in jumps(np.where(on, face, -1).astype(np.int32)):
        image[here] = INK
        image[there] = np.where(on[there][:, None], image[there], INK)
    return image


def _axes(azimuth: float, elevation: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    c, s = np.cos(elevation), np.sin(elevation)
    back = np.array([c * np.cos(azimuth), c * np.sin(azimuth), s])
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back
