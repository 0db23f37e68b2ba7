"""Views of each stable pose from the camera's place: silhouettes as shadows on the table.

A shadow cast from the camera's centre onto z = 0 equals the picture's outline after its pixels are
taken to the table plane. It depends only on the camera's position, not on its lens, and on the
part's position: the taller the part, the more. A flat pose needs one view; a taller one gets a ring
of them, the part to this side and that of the point below the camera; one that stands on its end
gets two rings.
"""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, Int32Array
from controller.cad import Solid, StablePose
from controller.imaging import Camera, RayCaster, meet_part, signed_area, trace_loops, transform

from ..fitting import OutlineMeasure
from .polar import HALF, from_raster, shape_of

EMPTY_PX = 5
MAX_HEIGHT = 0.9  # largest height of a part, as a share of the camera's
RASTER_PX = 128  # pixels on a shadow's longer side
# Shift by perspective, as a share of the outline's size, from which there are more views.
FLAT_SHARE = 0.05
RING_SHARE = 0.65  # radius of the ring of views, between the middle and the farthest corner
RING_VIEWS = 8
BORDER_PX = 1.2  # blur of a shadow's raster, to find its border between the cells
OUTER_SAMPLES = 192  # samples of the outer outline: one each 2 mm at 400 mm
HOLE_SAMPLES = 64  # samples of all holes together
TALL_SHARE = 0.35  # shift by perspective from which there are twice as many views


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """The camera's place above the table.

    Attributes
    ----------
    eye_mm : height of the camera's centre over the table
    reach_mm : largest distance of parts from the point below it
    """

    eye_mm: float
    reach_mm: float


@dataclass(frozen=True, eq=False, slots=True)
class PartViews:
    """The views of one part, for the index.

    Attributes
    ----------
    pose : (n,) index of the stable pose
    place_mm : (n, 2) place from the point below the camera to the centre of mass, the part at turn
        0
    area_mm2 : (n,) area of the shadow
    perimeter_mm : (n,) perimeter of the shadow, its holes' included
    centroid_mm : (n, 2) centroid of the shadow, from the centre of mass, the part at turn 0
    bits : (n, RINGS, ANGLES / 8) uint8 polar grids, a bit a cell: thousands stay in memory
    shapes : (n, f) float16 what of them does not change with the turn
    ring_mm : (n,) distance within which a view speaks for a place; inf where one is enough
    lean : (n,) rate at which the shadow of the part's top moves against that of its foot as the
        part moves
    outer_mm : (n, OUTER_SAMPLES, 2) float16 the shadow's outer border at equal steps, the part to
        the left, from the centre of mass
    holes_mm : (n, HOLE_SAMPLES, 4) float16 borders of its holes, likewise, and unit normals away
        from the part; nan where it has none
    """

    pose: Int32Array
    place_mm: FloatArray
    area_mm2: FloatArray
    perimeter_mm: FloatArray
    centroid_mm: FloatArray
    bits: NDArray[np.uint8]
    shapes: NDArray[np.float16]
    ring_mm: FloatArray
    lean: FloatArray
    outer_mm: NDArray[np.float16]
    holes_mm: NDArray[np.float16]


class Weighted(Protocol):
    """Anything with a centre of mass: a solid, or a shape made from one."""

    @property
    def centroid_mm(self) -> FloatArray:
        """Centre of mass, CAD frame, (3,)."""
        ...


def pose_on_table(
    part: Weighted, pose: StablePose, x_mm: float, y_mm: float, theta_rad: float
) -> FloatArray:
    """Return T_world_part of a part at rest: turned upright, then by theta, then moved.

    The centre of mass stands over (x, y) and the lowest point at z = 0 (conventions.md 4).

    Parameters
    ----------
    part : knows its centre of mass, CAD frame
    pose : the stable pose
    x_mm, y_mm : position of the centre of mass in the world
    theta_rad : anticlockwise about +z
    """
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose.R
    T[:3, 3] = np.array([x_mm, y_mm, pose.com_height_mm]) - T[:3, :3] @ part.centroid_mm
    return T


def shadow_camera(eye_mm: FloatArray) -> Camera:
    """Return a camera at a place (3,), straight above the table, whose pixels are mm on it.

    Its picture of a part is the part's shadow on the table, from the point below the eye, v down.
    """
    height = float(eye_mm[2])
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = eye_mm
    return Camera((1, 1), np.diag([height, height, 1.0]), np.zeros(5), T)


def view_part(
    solid: Solid, poses: tuple[StablePose, ...], caster: RayCaster, station: CameraPlace
) -> PartViews:
    """Return the views of a part in all its stable poses.

    Parameters
    ----------
    solid : the part
    poses : its stable poses
    caster : rays against its mesh
    station : position of the camera

    Raises
    ------
    ValueError : the part reaches up to the camera
    """
    rows = []
    eye = np.array([0.0, 0.0, station.eye_mm])
    for pose in poses:
        extents = np.ptp(solid.mesh.vertices @ pose.R.T, axis=0)
        height = float(extents[2])
        if height > MAX_HEIGHT * station.eye_mm:
            raise ValueError(f"{solid.name}: {height:.0f} mm tall, up to the camera")
        lean = height / (station.eye_mm - height)
        for place, ring in _places(extents, station):
            T = pose_on_table(solid, pose, place[0], place[1], 0.0)
            area, perimeter, centroid, grid, loops = _shadow(solid, caster, T, eye)
            outer, holes = _samples([loop - place for loop in loops])
            about = (pose.index, place, area, perimeter, centroid - place, grid, ring, lean)
            rows.append((*about, outer, holes))
    pose_of, places, areas, perimeters, centroids, grids, rings, leans, outers, holes_of = zip(
        *rows, strict=True
    )
    packed = np.packbits(np.stack(grids) > HALF, axis=-1)
    return PartViews(
        pose=np.array(pose_of, dtype=np.int32),
        place_mm=np.array(places),
        area_mm2=np.array(areas),
        perimeter_mm=np.array(perimeters),
        centroid_mm=np.array(centroids),
        bits=packed,
        shapes=shape_of(np.unpackbits(packed, axis=-1) * np.uint8(255)).astype(np.float16),
        ring_mm=np.array(rings),
        lean=np.array(leans),
        outer_mm=np.array(outers, dtype=np.float16),
        holes_mm=np.array(holes_of, dtype=np.float16),
    )


def _places(extents_mm: FloatArray, station: CameraPlace) -> list[tuple[FloatArray, float]]:
    """Return the positions at which to view a pose, each with the radius that it covers.

    Parameters
    ----------
    extents_mm : (3,) extents of the part at rest, along the world's axes at turn 0
    station : position of the camera
    """
    size = float(np.sqrt(np.prod(extents_mm[:2])))
    shift = float(extents_mm[2]) * station.reach_mm / station.eye_mm
    middle = np.zeros(2)
    if shift < FLAT_SHARE * size:
        return [(middle, np.inf)]
    ring = RING_SHARE * station.reach_mm
    if shift < TALL_SHARE * size:
        around = _around(ring, RING_VIEWS)
    else:
        around = np.vstack([_around(0.5 * ring, RING_VIEWS), _around(ring, 2 * RING_VIEWS)])
    return [(place, 0.75 * ring) for place in (middle, *around)]


def _around(ring_mm: float, count: int) -> FloatArray:
    """Return places (count, 2) on a ring about the middle."""
    turn = np.arange(count) * 2 * np.pi / count
    return ring_mm * np.column_stack([np.cos(turn), np.sin(turn)])


def _shadow(
    solid: Solid, caster: RayCaster, T_world_part: FloatArray, eye: FloatArray
) -> tuple[float, float, FloatArray, NDArray[np.uint8], list[FloatArray]]:
    """Return area, perimeter, centroid (2,), polar grid and loops of a posed part's shadow."""
    p = transform(T_world_part, solid.mesh.vertices)
    cast = eye[:2] + (p[:, :2] - eye[:2]) * (eye[2] / (eye[2] - p[:, 2]))[:, None]
    low, high = cast.min(axis=0), cast.max(axis=0)
    step = float((high - low).max()) / RASTER_PX
    # room all round, or blurring would cut the outline off; half a step, or it would grow by one
    count = np.ceil((high - low) / step).astype(int) + 2 * EMPTY_PX
    low = low - (EMPTY_PX - 0.5) * step
    x, y = np.meshgrid(low[0] + step * np.arange(count[0]), low[1] + step * np.arange(count[1]))
    ground = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    triangle, _ = meet_part(caster, T_world_part, eye, ground - eye)
    raster = np.where(triangle >= 0, np.uint8(255), np.uint8(0)).reshape(x.shape)
    moments = cv2.moments(raster, binaryImage=True)
    pixels = max(moments["m00"], 1.0)
    centre = np.array([moments["m10"], moments["m01"]]) / pixels
    grid = from_raster(raster, centre, float(np.sqrt(pixels / np.pi)))
    loops = [low + step * loop for loop in _border_px(raster)]
    return pixels * step**2, _perimeter_px(raster) * step, low + step * centre, grid, loops


def _border_px(raster: NDArray[np.uint8]) -> list[FloatArray]:
    """Return the loops (n, 2) round a raster's largest piece, then its holes, between cells."""
    field = cv2.GaussianBlur(raster, (0, 0), BORDER_PX).astype(np.float32) - 127.5
    mask = (field > 0).astype(np.uint8)
    chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not chains:
        return []
    parent = tree[0][:, 3]
    areas = np.where(parent < 0, [cv2.contourArea(chain) for chain in chains], -1.0)
    outer = int(areas.argmax())
    own = [chains[outer], *(chains[i] for i in np.flatnonzero(parent == outer).tolist())]
    kept: list[Int32Array] = [np.asarray(chain, np.int32) for chain in own if len(chain) > 2]
    return trace_loops(kept, raster.shape, field, (0, 0)) if kept else []


def _samples(loops: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return points on the first of some loops, and points and normals on the others."""
    outer = np.full((OUTER_SAMPLES, 2), np.nan)
    holes = np.full((HOLE_SAMPLES, 4), np.nan)
    if loops:
        outer = at_equal_steps(loops[0], OUTER_SAMPLES)
        outer = outer if signed_area(outer) > 0 else outer[::-1]
    if len(loops) > 1:
        border = OutlineMeasure.of_loops(tuple(loops))
        inner = np.column_stack([border.points, border.normals])[len(loops[0]) :]
        holes = inner[np.linspace(0, len(inner) - 1, HOLE_SAMPLES).astype(int)]
    return outer, holes


def at_equal_steps(loop: FloatArray, count: int) -> FloatArray:
    """Return a number of points (count, 2) at equal steps along a closed loop (n, 2)."""
    closed = np.concatenate([loop, loop[:1]])
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(count) * (along[-1] / count)
    return np.column_stack([np.interp(at, along, closed[:, k]) for k in (0, 1)])


def _perimeter_px(raster: NDArray[np.uint8]) -> float:
    """Return the length of a raster's outline, along the half level smoothed over the pixels."""
    smooth = cv2.GaussianBlur(raster, (0, 0), 1.2).astype(np.float32) / 255.0
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32)
    # the gradient's length integrates to the length of the edge, whichever way that runs
    return float(cv2.magnitude(gx, gy).sum())
