"""Contacts of two pads that close on a part: a height field of rays from each pad.

One evaluator for flat, curved, stepped, holed and slanted walls, and for pads that spread inside a
bore (planning-facts.md 2.2, step 3). A pad is rigid but for its compliance, so only surface within
that distance of its first touch carries, and only where the wall is inside the friction cone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, IntArray
from controller.imaging import RayCaster

from ...model import GraspRules, Jaw

SIDES = (1.0, -1.0)
EDGE_COUNT = 16  # directions in which the edge of a contact is sought
MIN_FACING = 0.5  # a wall turned farther from its pad bears no load
_TURN = np.arange(EDGE_COUNT) * 2 * np.pi / EDGE_COUNT
EDGE_DIRECTIONS = np.column_stack([np.cos(_TURN), np.sin(_TURN)])


@dataclass(frozen=True, slots=True, eq=False)
class PadGrid:
    """Rays of a pad, in its own plane: along the approach and across.

    Attributes
    ----------
    points : (m, 2) x and z in the TCP frame
    area : (m,) mm2 each stands for; they add up to the pad
    step_x : mm between them along the approach
    order : per edge direction (EDGE_COUNT, m), the points that reach farthest in it first
    """

    points: FloatArray
    area: FloatArray
    step_x: float
    order: IntArray

    @classmethod
    def of(cls, jaw: Jaw, step_mm: float) -> PadGrid:
        """Return a jaw's pad with rays about every `step_mm`."""
        nx = max(2, round(jaw.pad_length_mm / step_mm))
        nz = max(2, round(jaw.finger_width_mm / step_mm))
        step_x = jaw.pad_length_mm / nx
        x = -(np.arange(nx) + 0.5) * step_x
        # out to the pads' edges, which are what touches the wall of a bore
        z = np.linspace(-0.5, 0.5, nz + 1) * jaw.finger_width_mm
        points = np.array(np.meshgrid(x, z, indexing="ij")).reshape(2, -1).T
        across = np.full(nz + 1, jaw.finger_width_mm / nz)
        across[[0, -1]] /= 2
        order = np.argsort(-(EDGE_DIRECTIONS @ points.T), axis=1, kind="stable")
        return cls(points, np.tile(across, nx) * step_x, step_x, order)


@dataclass(slots=True)
class Contacts:
    """Contacts of n closed jaws; TCP frames, mm.

    Attributes
    ----------
    T : (n, 4, 4) TCP poses, moved along the jaws' axis to midway between both first touches
    touched : (n,) both pads meet the part and neither starts inside it
    opening : (n,) distance between the two surfaces that touch
    area : (n,) mm2 of the smaller contact
    middle : (2, n, 2) centre of each contact in its pad's plane
    radius : (n,) mean distance of the contacts' cells from their centres
    slope : (n,) larger of the two tangents between pad and mean wall normal
    height : (2, n, m) height of the surface towards its pad at each cell, -inf where there is none;
        the first touch is at the largest
    gradient : (2, n, m, 2) gradient of the height along the pad's two axes; (2, n, 0, 2) if not
        asked for
    touch : (2, n, m) mask of the cells of the grid that carry; first is the pad on +y
    """

    T: FloatArray
    touched: BoolArray
    opening: FloatArray
    area: FloatArray
    middle: FloatArray
    radius: FloatArray
    slope: FloatArray
    height: FloatArray
    gradient: FloatArray
    touch: BoolArray

    @property
    def offset(self) -> FloatArray:
        """Distance between the contacts' centres along the pads (n,) [mm]."""
        return np.asarray(np.linalg.norm(self.middle[0] - self.middle[1], axis=1))

    def take(self, rows: IntArray) -> Contacts:
        """Return the contacts with the given numbers."""
        return Contacts(
            self.T[rows],
            self.touched[rows],
            self.opening[rows],
            self.area[rows],
            self.middle[:, rows],
            self.radius[rows],
            self.slope[rows],
            self.height[:, rows],
            self.gradient[:, rows],
            self.touch[:, rows],
        )

    def bare(self) -> Contacts:
        """Return the contacts without their cells."""
        n = len(self.T)
        none = np.zeros((2, n, 0))
        return replace(self, height=none, gradient=none[..., None], touch=none.astype(bool))

    def joined(self, other: Contacts) -> Contacts:
        """Return these contacts and others, both on the same grid or bare."""
        return Contacts(
            np.concatenate([self.T, other.T]),
            np.concatenate([self.touched, other.touched]),
            np.concatenate([self.opening, other.opening]),
            np.concatenate([self.area, other.area]),
            np.concatenate([self.middle, other.middle], axis=1),
            np.concatenate([self.radius, other.radius]),
            np.concatenate([self.slope, other.slope]),
            np.concatenate([self.height, other.height], axis=1),
            np.concatenate([self.gradient, other.gradient], axis=1),
            np.concatenate([self.touch, other.touch], axis=1),
        )


def close_pads(
    caster: RayCaster,
    face_normals: Float32Array,
    T: FloatArray,
    gap: FloatArray,
    inner: BoolArray,
    grid: PadGrid,
    rules: GraspRules,
    slopes: bool = False,
) -> Contacts:
    """Return the contacts of both pads as they close straight on to the part, ray by ray.

    Parameters
    ----------
    caster : rays against the part's mesh
    face_normals : (t, 3) float32, of the mesh the caster casts on
    T : (n, 4, 4) TCP poses in the part frame; the pads start symmetrically about them
    gap : (n,) distance between the surfaces expected to touch
    inner : (n,) the pads are the fingers' backs and move apart
    grid : the rays of a pad
    rules : friction and clearance
    slopes : work out the gradients too
    """
    n, m = len(T), len(grid.points)
    cone = np.cos(np.arctan(rules.friction))
    sense = np.where(inner, -1.0, 1.0)
    start = np.maximum(gap / 2 + sense * rules.clearance_mm, 0.0)
    R, t = T[:, :3, :3], T[:, :3, 3]
    in_plane = R[:, :, [0, 2]]
    # as embree takes them: at 100 mm a float32 is good to a hundredth of a micrometre
    plane = (grid.points @ in_plane.transpose(0, 2, 1) + t[:, None]).astype(np.float32)
    axis = R[:, :, 1]
    middles, radii, areas, normals, touches = [], [], [], [], []
    heights, gradients = [], []
    reached = np.zeros((2, n))
    touched = np.ones(n, dtype=bool)
    for k, side in enumerate(SIDES):
        origin = plane + (axis * (side * start)[:, None])[:, None].astype(np.float32)
        inward = (axis * (-side * sense)[:, None]).astype(np.float32)
        rays = np.repeat(inward, m, axis=0)
        triangle, distance = caster.first_hit(
            cast(FloatArray, origin.reshape(-1, 3)), cast(FloatArray, rays)
        )
        normal = face_normals[triangle].reshape(n, m, 3)
        facing = np.matmul(normal, inward[:, :, None])[:, :, 0]
        distance = distance.reshape(n, m)
        touched &= ~np.any((facing > 0) & np.isfinite(distance), axis=1)
        first = distance.min(axis=1)
        touched &= np.isfinite(first)
        first = np.where(np.isfinite(first), first, 0.0)
        carries = (distance <= (first + rules.compliance_mm)[:, None]) & (-facing >= cone)
        weight = carries * grid.area
        area = weight.sum(axis=1)
        share = weight / np.maximum(area, 1e-9)[:, None]
        middle = share @ grid.points
        off = np.hypot(grid.points[:, 0] - middle[:, :1], grid.points[:, 1] - middle[:, 1:])
        reached[k] = start - sense * first
        middles.append(middle)
        radii.append((off * share).sum(axis=1))
        areas.append(area)
        normals.append(np.matmul(share[:, None].astype(np.float32), normal)[:, 0])
        touches.append(carries)
        heights.append((sense * start)[:, None] - distance)
        if slopes:
            steep = np.minimum(facing, -MIN_FACING)[:, :, None]
            gradients.append(np.matmul(normal, in_plane.astype(np.float32)) / steep)
    shift = (reached[0] - reached[1]) / 2
    T = T.copy()
    T[:, :3, 3] += axis * shift[:, None]
    return Contacts(
        T=T,
        touched=touched,
        opening=reached.sum(axis=0),
        area=np.minimum(areas[0], areas[1]),
        middle=np.stack(middles),
        radius=(radii[0] + radii[1]) / 2,
        slope=np.maximum(_slope(normals[0], axis), _slope(normals[1], axis)),
        height=np.stack(heights),
        gradient=np.stack(gradients) if slopes else np.zeros((2, n, 0, 2)),
        touch=np.stack(touches),
    )


def _slope(normal: FloatArray, axis: FloatArray) -> FloatArray:
    along = np.abs(np.einsum("ij,ij->i", normal, axis))
    tangential = np.linalg.norm(np.cross(normal, axis), axis=1)
    return np.asarray(tangential / np.maximum(along, 1e-9))


def edges(touch: BoolArray, grid: PadGrid) -> FloatArray:
    """Return the reach of contacts in each edge direction (n, EDGE_COUNT), from the pad's origin.

    -inf where a pad touches nothing.
    """
    reach = EDGE_DIRECTIONS @ grid.points.T
    half = np.abs(EDGE_DIRECTIONS[:, 0]) * grid.step_x / 2  # cells reach half a step farther
    out = np.empty((len(touch), EDGE_COUNT))
    for k in range(EDGE_COUNT):
        first = np.argmax(touch[:, grid.order[k]], axis=1)
        out[:, k] = reach[k, grid.order[k][first]] + half[k]
    out[~touch.any(axis=1)] = -np.inf
    return out
