"""Share of a defect about each compared node that would be visible.

A defect is a disc on the surface, an ellipse in the picture where that is seen aslant. A face ends
at its edges, and so does a defect on it. For a defect that extends over an edge, only the portion
on the face itself counts; the rest belongs to the neighbour.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, IndexArray, Int32Array
from controller.imaging import Camera

from .surface import Surface

# Components of unit normals that count as one, so that a face has few ellipses: their axes are then
# right to a sixth.
ALIKE: Final = 0.25


def shares_of_face(
    masks: Sequence[BoolArray], surface: Surface, camera: Camera, size_nodes: float
) -> list[Float32Array]:
    """Return the shares (h, w) of a defect about each node, cut by its face, that lie on masks.

    Parameters
    ----------
    masks : (h, w) each, what was compared
    surface : seen by the nodes
    camera : that sees it
    size_nodes : width of the defect, seen squarely
    """
    out = [np.zeros(surface.seen.shape, dtype=np.float32) for _ in masks]
    half = int(size_nodes / 2)
    faces = np.unique(surface.face[np.logical_or.reduce(masks) & surface.seen])
    for face, rows, columns, normal in _patches(surface, camera, faces):
        window = (
            slice(max(int(rows.min()) - half, 0), int(rows.max()) + half + 1),
            slice(max(int(columns.min()) - half, 0), int(columns.max()) + half + 1),
        )
        mine = surface.face[window] == face
        disc = _disc(size_nodes, normal)
        own, *on = (
            cv2.filter2D(m.astype(np.float32), -1, disc, borderType=cv2.BORDER_CONSTANT)
            for m in (mine, *(mine & mask[window] for mask in masks))
        )
        at = rows - window[0].start, columns - window[1].start
        for share, some in zip(out, on, strict=True):
            share[rows, columns] = some[at] / own[at]
    return out


def _patches(
    surface: Surface, camera: Camera, faces: Int32Array
) -> Iterator[tuple[int, IndexArray, IndexArray, FloatArray]]:
    """Yield pieces of faces that are seen at one angle: face, rows and columns (n,), normal (3,).

    Parameters
    ----------
    surface : seen by the nodes
    camera : that sees it, in whose frame the normals are
    faces : ids of the faces
    """
    rows, columns = np.nonzero(surface.seen)
    face = surface.face[rows, columns]
    normals = surface.normals @ camera.T_world_cam[:3, :3]
    some = np.flatnonzero(np.isin(face, faces))
    kind = np.column_stack([face[some], np.round(normals[some] / ALIKE).astype(np.int64)])
    order = np.lexsort(kind.T)
    begins = np.flatnonzero((np.diff(kind[order], axis=0) != 0).any(axis=1)) + 1
    for group in np.split(some[order], begins) if len(some) else ():
        mean = normals[group].mean(axis=0)
        yield int(face[group[0]]), rows[group], columns[group], mean / np.linalg.norm(mean)


def _disc(size_nodes: float, normal: FloatArray) -> Float32Array:
    """Return a mask (k, k) of the nodes on a disc about the middle one, seen along z.

    Parameters
    ----------
    size_nodes : width of the disc
    normal : (3,) unit normal of the disc, camera frame
    """
    half = int(size_nodes / 2)
    v, u = np.mgrid[-half : half + 1, -half : half + 1]
    # a step in the picture leads as far in depth as keeps it on the disc's plane
    depth = (u * normal[0] + v * normal[1]) / min(normal[2], -1e-6)
    return np.asarray(u**2 + v**2 + depth**2 <= (size_nodes / 2) ** 2, np.float32)
