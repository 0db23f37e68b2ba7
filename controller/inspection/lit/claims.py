"""Share of a defect about each compared node that would be visible.

A face ends at its edges, and so does a defect on it. For a defect that extends over an edge, only
the portion on the face itself counts; the rest belongs to the neighbour.
"""

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, Int32Array


def share_of_face(mask: BoolArray, face: Int32Array, size_nodes: float) -> Float32Array:
    """Return the share (h, w) of a defect about each node, cut by its face, that lies on a mask.

    Parameters
    ----------
    mask : (h, w) what was compared
    face : (h, w) met, -1 where none
    size_nodes : width of the defect
    """
    size = max(1, round(size_nodes)) | 1
    out = np.zeros(face.shape, dtype=np.float32)
    half = size // 2
    for i in np.unique(face[mask & (face >= 0)]).tolist():
        rows, columns = np.nonzero(face == i)
        window = (
            slice(max(int(rows.min()) - half, 0), int(rows.max()) + half + 1),
            slice(max(int(columns.min()) - half, 0), int(columns.max()) + half + 1),
        )
        mine = face[window] == i
        own, on = (
            cv2.blur(m.astype(np.float32), (size, size), borderType=cv2.BORDER_CONSTANT)
            for m in (mine, mine & mask[window])
        )
        out[window][mine] = (on / np.maximum(own, 1e-6))[mine]
    return out


def near_own_face(mask: BoolArray, face: Int32Array, size_nodes: float) -> BoolArray:
    """Return a mask (h, w) of nodes within half a defect of a mask's node on their own face.

    Parameters
    ----------
    mask : (h, w) what was compared
    face : (h, w) met, -1 where none
    size_nodes : width of the defect
    """
    if not mask.any():
        return mask
    away, nearest = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    face_of = np.full(int(nearest.max()) + 1, -1, dtype=np.int32)
    face_of[nearest[mask]] = face[mask]
    return np.asarray((away <= size_nodes / 2) & (face_of[nearest] == face) & (face >= 0))
