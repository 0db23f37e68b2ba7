"""Marks painted into stored pictures of a held part, where the truth says that the part is.

A mark lies on the part: it is painted in every view and under every lamp that show its place,
through the true poses, each pixel by what its sight lines meet. Nothing of the room's detection is
used.

- pit: a disc that is darker by `PIT_CONTRAST`
- dent: a hollow a tenth as deep as wide, lit by Lambert's law from the middle of each lamp
- stain: a disc that is darker by `STAIN_CONTRAST`
- scratch: a line of `SCRATCH_MM`, darker by `SCRATCH_CONTRAST`; its size is its width
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.imaging import Camera, RayCaster, inverse_pose, transform

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Words = dict[str, Any]

PIT_CONTRAST = 0.3
STAIN_CONTRAST = 0.15
SCRATCH_CONTRAST = 0.2
DENT_DEPTH = 0.1  # of its width: the shallowest that benchmarks/trace_held_defects.py cuts
SCRATCH_MM = 8.0
BORDER_MM = 0.1  # in which a mark fades
FINE = 3  # rays to a pixel's side
BLUR_PX = 0.7
SHOWN_COSINE = 0.26  # flatter than 75 degrees a place is not in sight
SHOWN_SHARE = 0.5  # of a mark's pixels that nothing stands before
SIZES = {
    "pit": (1.2, 1.7, 2.3, 3.0, 4.0),
    "dent": (1.2, 1.7, 2.3, 3.0, 4.0),
    "stain": (2.0, 3.0, 4.5, 6.5),
    "scratch": (0.3, 0.45, 0.65, 0.9),
}


@dataclass(frozen=True, eq=False)
class Mark:
    """One mark on a part.

    Attributes
    ----------
    kind, size_mm : see `SIZES`
    p_part_mm, normal, along : (3,) its place, CAD frame; a scratch's direction
    face : id of the face that it lies on, and is cut by
    surface : what kind of surface that is
    """

    kind: str
    size_mm: float
    p_part_mm: Array
    normal: Array
    along: Array
    face: int
    surface: str

    def factor(self, points: Array, to_lamp: Array) -> Array:
        """Return by what the brightness of points (n, 3), CAD frame, is multiplied (n,)."""
        off = points - self.p_part_mm
        flat = off - (off @ self.normal)[:, None] * self.normal
        r = np.linalg.norm(flat, axis=1)
        if self.kind == "scratch":
            x = flat @ self.along
            y = flat @ np.cross(self.normal, self.along)
            inside = _fade(self.size_mm / 2 - np.abs(y)) * _fade(SCRATCH_MM / 2 - np.abs(x))
            return np.asarray(1.0 - SCRATCH_CONTRAST * inside)
        inside = _fade(self.size_mm / 2 - r)
        if self.kind == "dent":
            towards = to_lamp - points
            towards /= np.linalg.norm(towards, axis=1)[:, None]
            level = towards @ self.normal
            # a paraboloid: its slope grows with the distance from its middle
            slope = 8 * DENT_DEPTH / self.size_mm * flat
            lit = level - (slope * towards).sum(axis=1)
            lit /= np.sqrt(1 + (slope**2).sum(axis=1))
            ratio = np.clip(lit, 0.0, None) / np.maximum(level, 0.05)
            return np.asarray(np.where(level > 0, 1.0 + (np.clip(ratio, 0, 3) - 1.0) * inside, 1.0))
        contrast = PIT_CONTRAST if self.kind == "pit" else STAIN_CONTRAST
        return np.asarray(1.0 - contrast * inside)


def _fade(depth: Array) -> Array:
    return np.asarray(np.clip(depth / BORDER_MM + 0.5, 0.0, 1.0))


class Scene:
    """A specimen as it truly stood before the camera.

    Parameters
    ----------
    words : SET.json
    truth : of the specimen, with its true poses and scale
    mesh : the nominal part
    face_of_triangle : (triangles,) face ids
    camera : of the set
    """

    def __init__(
        self,
        words: Words,
        truth: Words,
        mesh: trimesh.Trimesh,
        face_of_triangle: NDArray[np.int32],
        camera: Camera,
    ) -> None:
        self._words, self._camera, self._faces = words, camera, face_of_triangle
        self._caster = RayCaster(mesh)
        scale, centre = np.array(truth["scale"]), np.array(truth["scale_about"])
        stretch = np.eye(4)
        stretch[:3, :3] = np.diag(scale)
        stretch[:3, 3] = centre - scale * centre
        self._T = {p["view"]: np.array(p["T_world_part_true"]) @ stretch for p in truth["poses"]}

    def paint(self, pictures: Mapping[str, dict[str, Picture]], marks: list[Mark]) -> list[int]:
        """Paint marks into pictures, by view and lamp; return how many views show each."""
        shown = [0] * len(marks)
        for view in self._words["views"]:
            for i, mark in enumerate(marks):
                shown[i] += self._paint(view, pictures[view["id"]], mark)
        return shown

    def _paint(self, view: Words, pictures: dict[str, Picture], mark: Mark) -> bool:
        T = self._T[view["id"]]
        to_part = np.linalg.inv(T)
        eye = transform(to_part, self._camera.position_mm[None])[0]
        towards = eye - mark.p_part_mm
        if towards @ mark.normal < SHOWN_COSINE * np.linalg.norm(towards):
            return False
        reach = (SCRATCH_MM if mark.kind == "scratch" else mark.size_mm) / 2 + 0.5
        (at,) = self._camera.project(transform(T, mark.p_part_mm[None]))
        px = int(np.ceil(reach / self._camera.mm_per_px(transform(T, mark.p_part_mm[None])[0]))) + 4
        width, height = self._camera.size_px
        x0, y0 = max(int(at[0]) - px, 0), max(int(at[1]) - px, 0)
        x1, y1 = min(int(at[0]) + px + 1, width), min(int(at[1]) + px + 1, height)
        if x1 - x0 < 5 or y1 - y0 < 5:
            return False
        fine = (np.arange(FINE) + 0.5) / FINE - 0.5
        x = (np.arange(x0, x1)[:, None] + fine).ravel()
        y = (np.arange(y0, y1)[:, None] + fine).ravel()
        pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        lines = self._camera.sight_lines(pixels)
        directions = lines @ to_part[:3, :3].T
        triangle, distance = self._caster.first_hit(
            np.broadcast_to(eye, directions.shape), directions
        )
        on = (triangle >= 0) & (self._faces[np.maximum(triangle, 0)] == mark.face)
        on &= ~self._held(view, lines, distance)
        points = eye + np.where(on, distance, 0.0)[:, None] * directions
        near = np.linalg.norm(points - mark.p_part_mm, axis=1) < reach
        middle = np.hypot(*(pixels - at).T) < 1.5
        if not (on & middle).any() or (on & middle).sum() < SHOWN_SHARE * middle.sum():
            return False
        shape = (len(y), len(x))
        for lamp, picture in pictures.items():
            if self._words["lamps"][lamp]["kind"] == "panel":
                continue
            lamp_at = transform(to_part, np.array([self._words["lamps"][lamp]["centre"]]))[0]
            factor = np.ones(len(pixels))
            here = on & near
            factor[here] = mark.factor(points[here], lamp_at)
            coarse = factor.reshape(shape).reshape(y1 - y0, FINE, x1 - x0, FINE).mean(axis=(1, 3))
            soft = cv2.GaussianBlur(coarse, (0, 0), BLUR_PX, borderType=cv2.BORDER_REPLICATE)
            window = picture[y0:y1, x0:x1]
            window[:] = np.clip(np.round(window * soft), 0, 255).astype(np.uint8)
        return True

    def _held(self, view: Words, lines: Array, distance: Array) -> NDArray[np.bool_]:
        """Return which sight lines (n, 3) meet the gripper before the part."""
        out = np.zeros(len(lines), dtype=bool)
        for box in view.get("gripper_boxes", ()):
            T = inverse_pose(np.array(box["T"]))
            start = transform(T, self._camera.position_mm[None])[0]
            along = lines @ T[:3, :3].T
            half = np.array(box["half_mm"])
            with np.errstate(divide="ignore"):
                a, b = (-half - start) / along, (half - start) / along
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            out |= (enter < leave) & (leave > 0) & (enter < distance)
        return out


def draw_marks(
    points: Array,
    normals: Array,
    faces: NDArray[np.intp],
    surfaces: list[str],
    rng: np.random.Generator,
    count: int,
    apart_mm: float,
) -> Iterator[Mark]:
    """Yield marks at some of the points (n, 3), kinds of surface in turn, apart from each other.

    Parameters
    ----------
    points, normals, faces : (n, 3), (n, 3), (n,) where marks may lie
    surfaces : n, kinds of surface
    rng : draws
    count : marks at most
    apart_mm : least distance of two
    """
    kinds = sorted(set(surfaces))
    of = np.array([kinds.index(s) for s in surfaces])
    taken: list[Array] = []
    for turn in range(8 * count):
        mine = np.flatnonzero(of == turn % len(kinds))
        i = int(rng.choice(mine))
        if len(taken) == count:
            return
        if any(np.linalg.norm(points[i] - p) < apart_mm for p in taken):
            continue
        taken.append(points[i])
        kind = str(rng.choice(list(SIZES)))
        any_way = rng.normal(size=3)
        along = any_way - (any_way @ normals[i]) * normals[i]
        yield Mark(
            kind, float(rng.choice(SIZES[kind])), points[i], normals[i],
            along / np.linalg.norm(along), int(faces[i]), surfaces[i],
        )  # fmt: skip
