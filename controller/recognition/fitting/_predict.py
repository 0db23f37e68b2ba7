"""Which edges of a posed part a camera sees, under full perspective.

An edge shows where the surface turns away from the eye (a rim), and where two surfaces meet at an
angle (a crease). Both are sampled along their length; one sight line to each sample tells whether
something stands before it, two beside it tell what lies on either side: table or part, and how the
part is turned there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cad import Camera, inverse_pose, transform

from ._model import EdgeModel

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

OFF_SURFACE_MM = 0.06  # a sample is looked at from a hair outside, or its own facets would hide it
HIDDEN_MM = 0.25  # something this much nearer than the sample hides it
STEP_MM = 0.5  # a step this high shows, though its two sides may be turned the same way
LEAST_STEP_MM = 0.25
CLOSE_MM = 0.015  # beside an edge of the outline there is nothing, however close one looks
CREASE_BEND = 0.2  # |n1 - n2| of what shows as a crease: 11 degrees


@dataclass(frozen=True, eq=False, slots=True)
class EdgePoints:
    """Samples of the visible edges of a posed part.

    Attributes
    ----------
    points_mm : (n, 3) world
    pixels : (n, 2) where they are seen, lens included
    normals : (n, 2) unit, square to the edge in the picture; away from the part on the outline
    on_outline : (n,) beside it the table is seen
    bend : (n,) how differently the two sides are turned, |n1 - n2|, 0..2; 2 on the outline
    lift : (n,) by how much the far side along ``normals`` should be brighter than the near one
        under light from the camera's side: difference of cosines, the table's left out
    jump_mm : (n,) how much farther from the eye one side is than the other; 0 on the outline
    step_mm : between samples along the edges
    """

    points_mm: Array
    pixels: Array
    normals: Array
    on_outline: Bools
    bend: Array
    lift: Array
    jump_mm: Array
    step_mm: float


def predict_edges(
    model: EdgeModel,
    T_world_part: Array,
    camera: Camera,
    most: int = 900,
    beside_mm: float = 0.45,
    rims_only: bool = False,
) -> EdgePoints:
    """Return the visible edges of a posed part.

    Parameters
    ----------
    most : about so many samples are looked at
    beside_mm : how far beside an edge its two sides are probed; about 1.5 px
    rims_only : leave out creases whose two sides both face the eye
    """
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    faces_eye = model.normals @ eye > model.offsets_mm
    first, second = faces_eye[model.sides[:, 0]], faces_eye[model.sides[:, 1]]
    shows = first != second
    if not rims_only:
        shows |= model.is_crease & (first | second)
    chosen = np.flatnonzero(shows)
    edge, share, step = _spread(model.length_mm[chosen], most)
    edge = chosen[edge]
    points = model.start_mm[edge] + share[:, None] * model.along_mm[edge]
    along = model.along_mm[edge] / np.maximum(model.length_mm[edge], 1e-12)[:, None]
    ahead = points + OFF_SURFACE_MM * model.out[edge] - eye
    distance = np.linalg.norm(ahead, axis=1)
    across = np.cross(ahead, along)
    size = np.linalg.norm(across, axis=1)
    keep = size > 0.05 * distance  # an edge seen end-on is a point
    edge, points, along, ahead, distance = (a[keep] for a in (edge, points, along, ahead, distance))
    across = across[keep] / size[keep][:, None]
    count = len(points)
    exact, aside = points - eye, beside_mm * across
    close = CLOSE_MM * across
    looks = np.concatenate([ahead, exact + close, exact - close, exact + aside, exact - aside])
    triangle, depth = model.caster.first_hit(np.broadcast_to(eye, looks.shape), looks)
    seen = depth[:count] > 1.0 - HIDDEN_MM / distance
    free_a, free_b = triangle[count : 2 * count] < 0, triangle[2 * count : 3 * count] < 0
    on_outline = free_a | free_b
    side_a, side_b = triangle[3 * count : 4 * count], triangle[4 * count :]
    normal_a = np.where((side_a < 0)[:, None], 0.0, model.normals[side_a])
    normal_b = np.where((side_b < 0)[:, None], 0.0, model.normals[side_b])
    bend = np.where(on_outline, 2.0, np.linalg.norm(normal_a - normal_b, axis=1))
    both = np.isfinite(depth[3 * count :]).reshape(2, -1).all(axis=0) & ~on_outline
    aside_depth = np.where(np.isfinite(depth), depth, 0.0)[3 * count :].reshape(2, -1)
    jump = np.where(both, np.abs(aside_depth[0] - aside_depth[1]) * distance, 0.0)
    is_rim = faces_eye[model.sides[edge, 0]] != faces_eye[model.sides[edge, 1]]
    seen &= on_outline | is_rim | (bend > CREASE_BEND) | (jump > STEP_MM)
    outward = np.where((free_b & ~free_a)[:, None], -across, across)
    toward_eye = -ahead / distance[:, None]
    lift = np.einsum("ij,ij->i", normal_a - normal_b, toward_eye)
    lift[free_b & ~free_a] *= -1.0  # there ``outward`` runs to side b
    points_mm = transform(T_world_part, points[seen])
    shifted_mm = points_mm + 0.2 * (outward[seen] @ T_world_part[:3, :3].T)
    along_mm = points_mm + 0.2 * (along[seen] @ T_world_part[:3, :3].T)
    both = camera.project(np.concatenate([points_mm, shifted_mm, along_mm]))
    pixels, shifted, ahead_px = np.split(both, 3)
    tangent = ahead_px - pixels
    normals = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    turned = ((shifted - pixels) * normals).sum(axis=1) < 0
    normals[turned] *= -1
    return EdgePoints(
        points_mm=points_mm,
        pixels=pixels,
        normals=normals,
        on_outline=on_outline[seen],
        bend=bend[seen],
        lift=lift[seen],
        jump_mm=jump[seen],
        step_mm=step,
    )


def _spread(length_mm: Array, most: int) -> tuple[NDArray[np.int64], Array, float]:
    """Return samples at even steps along edges laid end to end: edge, share of it, step."""
    total = float(length_mm.sum())
    step = max(total / most, LEAST_STEP_MM)
    end = np.cumsum(length_mm)
    at = np.arange(step / 2, total, step)
    edge = np.searchsorted(end, at, side="right")
    edge = np.minimum(edge, len(length_mm) - 1)
    share = 1.0 - (end[edge] - at) / np.maximum(length_mm[edge], 1e-12)
    return edge, np.clip(share, 0.0, 1.0), step
