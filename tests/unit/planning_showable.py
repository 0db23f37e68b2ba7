"""What some grip could show of a part after all: a search of its own, denser than the planner's.

For samples that a plan leaves unseen: directions the bare part shows them from, grips that leave
them in sight there, joints that hold the part so, free of contact. The first of these sets that is
empty is the reason (planning-facts.md 1.3); if none is, the sample could have been shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from planning_contacts import Checker, finger_boxes, frames, joints_for
from planning_sight import (
    LIFT_MM,
    VisibilityRules,
    blocked,
    box_triangles,
    in_sight,
    pixels_of,
)

from controller.cad import Solid, SurfaceSamples
from controller.planning import CellLayout, Grasp

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTION_COUNT = 400
ROLL_COUNT = 24
SHADOW_MM = 2.0  # inspection compares nothing this close to the hand's outline
BORDER_PX = 12.0  # nor this close to the picture's border
MARGIN_MM = 10.0  # between the arm and the world
ROWS_PER_VIEW = 6
MAX_VIEWS = 1500  # grip and direction whose joints are searched, per plan


class Class(Enum):
    """What stands between a sample and the camera."""

    HIDDEN = "hidden by the part"
    FINGERS = "fingers"
    REACH = "reach"
    SHOWABLE = "showable"
    UNDECIDED = "undecided"  # the search ended before it was through


@dataclass(frozen=True)
class Evidence:
    """How a sample can be shown."""

    sample: int
    grip_id: str
    direction: Array
    q: Array


@dataclass
class Showable:
    """Searches for views of samples; remembers per part what depends on the part alone."""

    layout: CellLayout
    solid: Solid
    samples: SurfaceSamples
    rules: VisibilityRules
    direction_count: int = DIRECTION_COUNT
    bare: dict[int, Mask] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.checker = Checker(self.layout, self.solid)
        k = np.arange(self.direction_count) + 0.5
        polar = np.arccos(1 - 2 * k / self.direction_count)
        turn = np.pi * (3 - 5**0.5) * k
        self.directions = np.column_stack(
            [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
        )
        self.triangles = np.asarray(self.solid.mesh.triangles)
        self.eye = np.asarray(self.layout.inspection.T_world_cam[:3, 3])
        self.far = float(np.linalg.norm(self.eye - self.layout.station_mm))

    def classify(
        self, chosen: Sequence[int], grasps: Sequence[Grasp]
    ) -> tuple[list[Class], list[Evidence]]:
        """Return what stands between each chosen sample and the camera, and views that show it."""
        rows = np.asarray(chosen, dtype=np.int64)
        if len(rows) == 0:
            return [], []
        bare = self._bare(rows)
        left = np.stack([self._left_by(g, rows, bare) for g in grasps])  # grip, direction, sample
        result = np.full(len(rows), Class.HIDDEN, dtype=object)
        result[bare.any(axis=0)] = Class.FINGERS
        result[left.any(axis=(0, 1))] = Class.REACH
        evidence, is_whole = self._reach(rows, left, grasps)
        for found in evidence:
            result[rows == found.sample] = Class.SHOWABLE
        if not is_whole:
            result[result == Class.REACH] = Class.UNDECIDED
        return result.tolist(), evidence

    def _bare(self, rows: NDArray[np.int64]) -> Mask:
        """Return which chosen samples the part alone shows in each direction (d, k)."""
        new = np.array([r for r in rows if int(r) not in self.bare], dtype=np.int64)
        if len(new):
            points, normals = self.samples.points_mm[new], self.samples.normals[new]
            shown = np.zeros((len(self.directions), len(new)), dtype=bool)
            for d, direction in enumerate(self.directions):
                eye = self.solid.centroid_mm + self.far * direction
                sight = eye - points
                far = np.linalg.norm(sight, axis=1)
                cos = np.einsum("ij,ij->i", sight, normals) / far
                (facing,) = np.nonzero(cos >= np.cos(self.rules.max_incidence_rad))
                start = points[facing] + LIFT_MM * normals[facing]
                shown[d, facing] = ~blocked(self.triangles, eye, start)
            for k, r in enumerate(new):
                self.bare[int(r)] = shown[:, k]
        return np.stack([self.bare[int(r)] for r in rows], axis=1)

    def _left_by(self, grasp: Grasp, rows: NDArray[np.int64], bare: Mask) -> Mask:
        """Return which of these the hand leaves in sight, its shadow's rim taken off (d, k)."""
        left = bare.copy()
        direction, sample = np.nonzero(bare)
        T = np.linalg.inv(grasp.T_part_tcp)
        points = self.samples.points_mm[rows] @ T[:3, :3].T + T[:3, 3]
        eyes = self.solid.centroid_mm + self.far * self.directions
        eyes = eyes @ T[:3, :3].T + T[:3, 3]
        start, step = points[sample], eyes[direction] - points[sample]
        step = np.where(np.abs(step) < 1e-12, 1e-12, step)
        for T_box, half in self._hand_boxes(grasp):
            R, t = T_box[:3, :3], T_box[:3, 3]
            a, d = (start - t) @ R, step @ R
            d = np.where(np.abs(d) < 1e-12, 1e-12, d)
            grown = half + SHADOW_MM
            one, two = (-grown - a) / d, (grown - a) / d
            enter = np.minimum(one, two).max(axis=1)
            leave = np.maximum(one, two).min(axis=1)
            hit = (enter <= leave) & (leave >= 0) & (enter <= 1)
            left[direction[hit], sample[hit]] = False
        return left

    def _hand_boxes(self, grasp: Grasp) -> list[tuple[Array, Array]]:
        jaw = self.layout.arm_gripper
        gap = grasp.opening_mm - (2 * jaw.finger_thickness_mm if grasp.is_inner else 0.0)
        return [*((b.T, b.half_mm) for b in jaw.body), *finger_boxes(jaw, gap)]

    def _reach(
        self, rows: NDArray[np.int64], left: Mask, grasps: Sequence[Grasp]
    ) -> tuple[list[Evidence], bool]:
        """Return views that show samples, and whether all there are have been tried."""
        todo = left.any(axis=(0, 1))
        found: list[Evidence] = []
        views = 0
        # what shows most is tried first; what no longer shows anything new is passed over
        gain = left.sum(axis=2)
        order = np.argsort(-gain, axis=None, kind="stable")
        for flat in order[: int((gain > 0).sum())].tolist():
            g, d = divmod(flat, len(self.directions))
            if not (left[g, d] & todo).any():
                continue
            if views == MAX_VIEWS:
                return found, False
            views += 1
            for k, q in self._try(grasps[g], self.directions[d], rows, left[g, d] & todo):
                found.append(Evidence(int(rows[k]), grasps[g].id, self.directions[d], q))
                todo[k] = False
            if not todo.any():
                break
        return found, True

    def _try(
        self, grasp: Grasp, direction: Array, rows: NDArray[np.int64], wanted: Mask
    ) -> list[tuple[int, Array]]:
        """Return which wanted samples a grip truly shows in a direction, and the joints."""
        T_part = self.poses(direction)
        points = self.samples.points_mm[rows[wanted]]
        in_world = np.einsum("rij,kj->rki", T_part[:, :3, :3], points) + T_part[:, None, :3, 3]
        pixels = pixels_of(self.layout.inspection, in_world.reshape(-1, 3))
        size = np.array(self.layout.inspection.size_px, float)
        inset = np.minimum(pixels, size - 1 - pixels).min(axis=1).reshape(len(T_part), -1)
        fit = (inset >= BORDER_PX).any(axis=1)
        index, q = joints_for(self.layout, T_part[fit] @ grasp.T_part_tcp)
        if len(index) == 0:
            return []
        # few, and unlike each other: each roll's first before any roll's second
        nth = np.arange(len(index)) - np.searchsorted(index, index)
        spread = np.argsort(nth * 1000 + (index * 7) % ROLL_COUNT, kind="stable")[:ROWS_PER_VIEW]
        q, T = q[spread], T_part[fit][index[spread]]
        jaw = self.layout.fixed_gripper
        free = self.checker.free(
            q,
            grasp.opening_mm,
            0.0 if jaw is None else jaw.max_mm,
            T,
            ("arm",),
            MARGIN_MM,
        )
        todo = np.flatnonzero(wanted)
        got: list[tuple[int, Array]] = []
        for k in np.flatnonzero(free):
            ok = self.truly(q[k], T[k], grasp, rows[todo])
            got += [(int(s), q[k]) for s in todo[ok]]
            todo = todo[~ok]
            if len(todo) == 0:
                break
        return got

    def poses(self, direction: Array) -> Array:
        """Return T_world_part (r, 4, 4) with the direction towards the camera, at each roll."""
        towards = (self.eye - self.layout.station_mm) / self.far
        out = []
        for side in (direction, towards):
            u = np.cross(side, np.eye(3)[int(np.argmin(np.abs(side)))])
            u = u / np.linalg.norm(u)
            out.append(np.column_stack([u, np.cross(side, u), side]))
        T = np.tile(np.eye(4), (ROLL_COUNT, 1, 1))
        for r in range(ROLL_COUNT):
            c, s = np.cos(2 * np.pi * r / ROLL_COUNT), np.sin(2 * np.pi * r / ROLL_COUNT)
            T[r, :3, :3] = out[1] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ out[0].T
            T[r, :3, 3] = self.layout.station_mm - T[r, :3, :3] @ self.solid.centroid_mm
        return T

    def truly(self, q: Array, T_world_part: Array, grasp: Grasp, rows: NDArray[np.int64]) -> Mask:
        """Tell which samples the camera sees with the arm at `q`, every margin kept."""
        R, t = T_world_part[:3, :3], T_world_part[:3, 3]
        points = self.samples.points_mm[rows] @ R.T + t
        normals = self.samples.normals[rows] @ R.T
        tip = frames(self.layout, q)["tip"]
        jaw = self.layout.fixed_gripper
        hand = [box_triangles(tip @ T, h + SHADOW_MM) for T, h in self._hand_boxes(grasp)]
        world = self.world(q, 0.0 if jaw is None else jaw.max_mm)
        part = self.triangles @ R.T + t
        occluders = np.vstack([part, *hand, *world])
        seen = in_sight(points, normals, self.layout.inspection, occluders, self.rules).seen
        pixels = pixels_of(self.layout.inspection, points)
        size = np.array(self.layout.inspection.size_px, float)
        return np.asarray(seen & (np.minimum(pixels, size - 1 - pixels).min(axis=1) >= BORDER_PX))

    def world(self, q: Array, fixed_opening_mm: float, eye: Array | None = None) -> list[Array]:
        """Return the triangles of links and of what stands about, the camera's own housing not."""
        eye = self.eye if eye is None else eye
        f = frames(self.layout, q)
        boxes = [(f[link.name] @ link.T, link.half_mm) for link in self.layout.arm.links]
        boxes += [(T, h) for _, _, T, h in self.checker.still_parts(fixed_opening_mm)]
        kept = []
        for T, half in boxes:
            local = (eye - T[:3, 3]) @ T[:3, :3]
            if (np.abs(local) > half).any():
                kept.append(box_triangles(T, half))
        return kept
