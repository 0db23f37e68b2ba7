"""What can be seen: directions worth showing, what each shows, what a hand hides, how to hold it.

Directions are unit vectors in the part frame from its centre of mass to the camera. Sight lines
are those of the real, perspective camera at the station's distance, so a view of the plan shows
what its list of samples says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.cad import RayCaster, Solid, SurfaceSamples, inverse_pose

from ..boxes import BoolArray, segments_hit
from ..layout import Box, CellLayout, FloatArray, IntArray
from ..motion import Scene, inverse_rows

ROLLS_N = 12
SPHERE_N = 90
SQUARE_SHARE = 0.02  # of all area: a planar face at least this large deserves a square view
PICTURE_MARGIN_PX = 12.0
KEPT_Q = 5  # configurations kept per view and grip
TRIED_Q = 14
# Inspection compares nothing within nine pixels of the hand (inspection/_view.py), 1.7 mm at the
# station; a plan that counts what lies there as shown leaves it unseen
FINGER_SHADOW_MM = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Candidate directions (v, 3) and, for square views, the face each is square to (else -1)."""

    vectors: FloatArray
    square_to: IntArray


def candidate_directions(solid: Solid) -> Directions:
    """Return square directions first (large planes, axes of bores), then an even sphere."""
    total = sum(f.area_mm2 for f in solid.faces)
    vectors: list[FloatArray] = []
    square: list[int] = []

    def add(d: FloatArray, face_id: int) -> None:
        if not vectors or (np.stack(vectors) @ d).max() < np.cos(np.radians(3.0)):
            vectors.append(d)
            square.append(face_id)

    for face in solid.faces:
        if face.kind == "plane" and face.area_mm2 >= SQUARE_SHARE * total:
            add(face.normal, face.id)
    for face in solid.faces:
        if face.kind == "cylinder" and face.concave:
            add(face.axis, face.id)
            add(-face.axis, face.id)
    k = np.arange(SPHERE_N) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / SPHERE_N), np.pi * (1 + 5**0.5) * k
    sphere = np.column_stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )
    for d in sphere:
        add(d, -1)
    return Directions(np.stack(vectors), np.array(square))


def visible_from(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    vectors: FloatArray,
    distance_mm: float,
    max_incidence_rad: float,
) -> BoolArray:
    """Return which samples the bare part shows in each direction: (v, n) bool."""
    visible = np.zeros((len(vectors), len(samples.points_mm)), dtype=bool)
    start = samples.points_mm + 0.02 * samples.normals
    for k, d in enumerate(vectors):
        sight = solid.centroid_mm + distance_mm * d - start
        slant = np.einsum("ij,ij->i", sight, samples.normals) / np.linalg.norm(sight, axis=1)
        (facing,) = np.nonzero(slant >= np.cos(max_incidence_rad))
        visible[k, facing] = ~caster.blocked(start[facing], sight[facing], 1.0)
    return visible


def hidden_by_hand(
    solid: Solid,
    samples: SurfaceSamples,
    visible: BoolArray,
    vectors: FloatArray,
    distance_mm: float,
    T_part_hand: FloatArray,
    boxes: list[Box],
) -> BoolArray:
    """Return which visible samples (v, n) a hand (boxes in its tip frame) hides."""
    hidden = np.zeros_like(visible)
    view, sample = np.nonzero(visible)
    T_hand_part = inverse_pose(T_part_hand)
    eyes = solid.centroid_mm + distance_mm * vectors
    points = samples.points_mm @ T_hand_part[:3, :3].T + T_hand_part[:3, 3]
    eyes = eyes @ T_hand_part[:3, :3].T + T_hand_part[:3, 3]
    hidden[view, sample] = segments_hit(points[sample], eyes[view], boxes, FINGER_SHADOW_MM)
    return hidden


def view_poses(
    solid: Solid, layout: CellLayout, vectors: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return how to hold the part for each direction and camera roll.

    Returns
    -------
    T_world_part : (v, r, 4, 4)
    inside : (v, r) bool, the whole part is inside the picture
    """
    camera = layout.inspection
    towards = camera.position_mm - layout.station_mm
    towards = towards / np.linalg.norm(towards)
    right = camera.T_world_cam[:3, 0]
    right = right - towards * (right @ towards)
    right = right / np.linalg.norm(right)
    at_station = np.column_stack([right, np.cross(towards, right), towards])
    T = np.zeros((len(vectors), ROLLS_N, 4, 4))
    T[..., 3, 3] = 1.0
    for v, d in enumerate(vectors):
        helper = np.eye(3)[int(np.argmin(np.abs(d)))]
        u = helper - d * (helper @ d)
        u = u / np.linalg.norm(u)
        on_part = np.column_stack([u, np.cross(d, u), d])
        for r in range(ROLLS_N):
            c, s = np.cos(2 * np.pi * r / ROLLS_N), np.sin(2 * np.pi * r / ROLLS_N)
            T[v, r, :3, :3] = at_station @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ on_part.T
            T[v, r, :3, 3] = layout.station_mm - T[v, r, :3, :3] @ solid.centroid_mm
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    points = np.einsum("vrij,kj->vrki", T[..., :3, :3], hull) + T[..., None, :3, 3]
    pixels = camera.project(points.reshape(-1, 3)).reshape(*points.shape[:3], 2)
    limit = np.array(camera.size_px) - 1 - PICTURE_MARGIN_PX
    inside = np.all((pixels >= PICTURE_MARGIN_PX) & (pixels <= limit), axis=(2, 3))
    return T, inside


def reachable_views(
    layout: CellLayout,
    scene: Scene,
    T_world_part: FloatArray,
    inside: BoolArray,
    wanted: BoolArray,
    T_part_hand: FloatArray,
    q_liked: FloatArray,
) -> dict[int, FloatArray]:
    """Return collision-free configurations (k, 6) per direction that one grip can show.

    Parameters
    ----------
    T_world_part, inside : of `view_poses`; wanted : (v,) directions worth trying
    q_liked : (6,) configurations near it come first
    """
    view, roll = np.nonzero(inside & wanted[:, None])
    if len(view) == 0:
        return {}
    index, _, q = inverse_rows(layout, T_world_part[view, roll] @ T_part_hand)
    if len(index) == 0:
        return {}
    speed = np.array(layout.pace.joint_per_s)
    away_s = (np.abs(q - q_liked) / speed).max(axis=1)
    # cheapest first within each direction, and no more of them than are worth a collision check
    order = np.lexsort((away_s, view[index]))
    of_view = view[index][order]
    start = np.searchsorted(of_view, of_view)
    order = order[np.arange(len(order)) - start < TRIED_Q]
    free = scene.free(q[order])
    found: dict[int, list[FloatArray]] = {}
    for row in order[free]:
        kept = found.setdefault(int(view[index[row]]), [])
        if len(kept) < KEPT_Q:
            kept.append(q[row])
    return {v: np.stack(rows) for v, rows in found.items()}
