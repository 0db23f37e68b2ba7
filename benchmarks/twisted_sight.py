"""Which views of a set show a change of the part: rays, independent of the room.

A ray goes through the centre of each pixel round the change, to the part as drawn and to the part
of the changed CAD file, at the true pose, past the gripper's boxes. A pixel shows the change where
the two rays end on another thing, at another depth or on a surface of another direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from trace_held import MIN_SHOWN_PX
from trace_held_defects import mesh_of
from trace_held_parts import triangles_of

Array = NDArray[np.float64]
Body = Any
Words = dict[str, Any]

DEPTH_MM = 0.04  # these two as the tracer of the sets counts changed pixels
SAME_COS = 0.995
MARGIN_PX = 3
MAX_RAYS = 60_000  # a view; a wider change is sampled


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera: matrix, distortion, pose, size."""

    K: Array
    distortion: Array
    T_world_cam: Array
    size_px: tuple[int, int]

    @classmethod
    def read(cls, words: Words) -> Camera:
        width, height = words["size_px"]
        K, pose = np.array(words["K"], float), np.array(words["T_world_cam"], float)
        return cls(K, np.array(words["distortion"], float), pose, (width, height))

    def pixels_of(self, p_cam_mm: Array) -> Array:
        zero = np.zeros(3)
        return np.asarray(
            cv2.projectPoints(p_cam_mm, zero, zero, self.K, self.distortion)[0].reshape(-1, 2)
        )

    def rays(self, pixels: Array) -> Array:
        """Return unit directions (n, 3) in the camera's frame through pixels (n, 2)."""
        flat = cv2.undistortPoints(pixels[:, None].astype(float), self.K, self.distortion)
        out = np.column_stack([flat.reshape(-1, 2), np.ones(len(pixels))])
        return np.asarray(out / np.linalg.norm(out, axis=1)[:, None])


def changed(before: Body, after: Body) -> Array:
    """Return corner points (n, 3) of what was added and of what was taken away."""
    pieces = [triangles_of(b).reshape(-1, 3) for b in (after - before, before - after)]
    return np.vstack(pieces) if pieces else np.zeros((0, 3))


def shows_px(words: Words, poses: list[Words], before: Body, after: Body) -> list[int]:
    """Return for each view how many pixels show a change.

    Parameters
    ----------
    words : of SET.json
    poses : of truth.json, one a view
    before, after : the part and the changed part, CAD frame
    """
    spots = changed(before, after)
    meshes = [mesh_of(body) for body in (before, after)]
    out = []
    for view, pose in zip(words["views"], poses, strict=True):
        camera = Camera.read(view.get("camera", words["camera"]))
        T_cam_part = np.linalg.inv(camera.T_world_cam) @ np.array(pose["T_world_part_true"])
        T_part_cam = np.linalg.inv(T_cam_part)
        pixels, stride = _pixels(camera, spots @ T_cam_part[:3, :3].T + T_cam_part[:3, 3])
        if not len(pixels):
            out.append(0)
            continue
        along = camera.rays(pixels) @ T_part_cam[:3, :3].T
        boxes = _boxes(view, T_part_cam @ np.linalg.inv(camera.T_world_cam))
        first, other = (_hits(mesh, boxes, T_part_cam[:3, 3], along) for mesh in meshes)
        is_other = first[0] != other[0]
        is_other |= (first[0] == 0) & (np.abs(first[1] - other[1]) > DEPTH_MM)
        is_other |= (first[0] == 0) & ((first[2] * other[2]).sum(axis=1) < SAME_COS)
        out.append(int(is_other.sum()) * stride**2)
    return out


def visible_views(words: Words, poses: list[Words], before: Body, after: Body) -> list[str]:
    """Return the views with enough pixels that show a change."""
    counts = shows_px(words, poses, before, after)
    return [
        v["id"] for v, count in zip(words["views"], counts, strict=True) if count >= MIN_SHOWN_PX
    ]


def _pixels(camera: Camera, p_cam_mm: Array) -> tuple[Array, int]:
    """Return the pixels of the rectangle round points, and at which stride."""
    if not len(p_cam_mm):
        return np.zeros((0, 2)), 1
    uv = camera.pixels_of(p_cam_mm)
    low = np.maximum(np.floor(uv.min(axis=0)) - MARGIN_PX, 0).astype(int)
    high = np.minimum(np.ceil(uv.max(axis=0)) + MARGIN_PX + 1, camera.size_px).astype(int)
    if (high <= low).any():
        return np.zeros((0, 2)), 1
    stride = int(np.ceil(np.sqrt(np.prod(high - low) / MAX_RAYS)))
    u, v = np.meshgrid(np.arange(low[0], high[0], stride), np.arange(low[1], high[1], stride))
    return np.column_stack([u.ravel(), v.ravel()]).astype(float), stride


def _boxes(view: Words, T_part_world: Array) -> trimesh.Trimesh | None:
    out = []
    for box in view["gripper_boxes"]:
        mesh = trimesh.creation.box(2 * np.array(box["half_mm"]))
        mesh.apply_transform(T_part_world @ np.array(box["T"]))
        out.append(mesh)
    return trimesh.util.concatenate(out) if out else None


def _hits(
    mesh: trimesh.Trimesh, boxes: trimesh.Trimesh | None, at: Array, along: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Return what rays meet first (0 the part, 1 a box, -1 nothing), how far away, and normals."""
    whole = mesh if boxes is None else trimesh.util.concatenate([mesh, boxes])
    rays = trimesh.ray.ray_pyembree.RayMeshIntersector(whole)
    face = rays.intersects_first(np.repeat(at[None], len(along), 0), along)
    label = np.where(face < 0, -1, np.where(face < len(mesh.faces), 0, 1))
    normal = whole.face_normals[face]
    corner = whole.triangles[face, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((corner - at) * normal).sum(axis=1) / (along * normal).sum(axis=1)
    return label, np.where(label < 0, 0.0, depth), normal
