"""Welding: repeated corners of a file become one, triangles without area disappear."""

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from .large import spans

MERGE_MM = 1e-4  # corners within are one: STL repeats each corner per triangle, rounded
NEEDLE_MM = 1e-9  # a triangle flatter than this has no normal
FEW_NEEDLES = 2000  # needles up to this number are taken out one by one


def weld(vertices_mm: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Merge corners and remove triangles without area, without leaving gaps.

    Parameters
    ----------
    vertices_mm, triangles : (v, 3) and (n, 3), all finite

    Returns
    -------
    vertices_mm, triangles : those left; no vertex is without a triangle
    kept : (m,) index of each in the input, or of the triangle whose surface it lies in
    """
    first, merged = _merge(vertices_mm)
    corners = merged[triangles]
    kept = np.flatnonzero(
        (corners[:, 0] != corners[:, 1])
        & (corners[:, 1] != corners[:, 2])
        & (corners[:, 2] != corners[:, 0])
    )
    points, corners = vertices_mm[first], corners[kept]
    needles = np.flatnonzero(_heights(points, corners) <= NEEDLE_MM)
    if 0 < len(needles) <= FEW_NEEDLES:
        corners, still = _flip(points, corners, needles)
        corners, kept = corners[still], kept[still]
    used = np.zeros(len(points), dtype=bool)
    used[corners] = True
    return points[used], (np.cumsum(used) - 1)[corners], kept


def _merge(vertices_mm: FloatArray) -> tuple[IntArray, IntArray]:
    """Return a vertex for each occupied cell of the grid (u,), and each vertex's cell."""
    low = _cells(vertices_mm.min(axis=0))
    span = _cells(vertices_mm.max(axis=0)) - low + 1
    key = np.empty(len(vertices_mm), dtype=np.int64)
    is_wide = float(span[0]) * float(span[1]) * float(span[2]) > 2.0**62
    for some in spans(len(key)):
        cells = _cells(vertices_mm[some]) - low
        key[some] = cells[:, 0] * span[1] + cells[:, 1]
        if not is_wide:
            key[some] = key[some] * span[2] + cells[:, 2]
    if is_wide:
        key = np.unique(key, return_inverse=True)[1]  # fewer numbers, or the product overflows
        for some in spans(len(key)):
            key[some] = key[some] * span[2] + (_cells(vertices_mm[some]) - low)[:, 2]
    order = np.argsort(key, kind="stable")
    key = key[order]
    is_first = np.concatenate(([True], key[1:] != key[:-1]))
    merged = np.empty(len(key), dtype=np.int64)
    merged[order] = np.cumsum(is_first) - 1
    return order[is_first], merged


def _cells(vertices_mm: FloatArray) -> IntArray:
    """Return the cell of the grid that each vertex is in, as three numbers."""
    return np.asarray(np.round(vertices_mm / MERGE_MM).astype(np.int64))


def _heights(points: FloatArray, corners: IntArray) -> FloatArray:
    """Return the smallest height of each triangle [mm]."""
    heights = np.empty(len(corners))
    for some in spans(len(corners)):
        p = points[corners[some]]
        area2 = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        longest = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).max(axis=1)
        heights[some] = area2 / np.where(longest > 0, longest, 1.0)
    return heights


def _flip(points: FloatArray, corners: IntArray, needles: IntArray) -> tuple[IntArray, BoolArray]:
    """Flip the long side of each needle into its neighbour until no needle is left.

    A needle's three corners lie on a line; dropped, it would leave its neighbours' corners unmet.

    Returns
    -------
    corners : (n, 3), flipped
    still : (n,) False for pairs of needles that lay on each other
    """
    corners = corners.copy()
    still = np.ones(len(corners), dtype=bool)
    owner: dict[tuple[int, int], int] = {}
    # only sides round the needles are looked up: their corners' triangles, not the whole mesh
    near = np.isin(corners, np.unique(corners[needles])).any(axis=1)
    for i in np.flatnonzero(near).tolist():
        a, b, c = corners[i].tolist()
        owner.update({(a, b): i, (b, c): i, (c, a): i})
    todo = needles.tolist()
    for _ in range(4 * len(todo)):  # a flip may make a needle of the neighbour, seldom for long
        if not todo:
            break
        i = todo.pop()
        if not still[i] or float(_heights(points, corners[i : i + 1])[0]) > NEEDLE_MM:
            continue
        p = points[corners[i]]
        longest = int(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).argmax())
        a, b, c = np.roll(corners[i], -longest).tolist()
        j = owner.get((b, a))
        if j is None:
            continue  # an open side: the surface is refused for it
        d = next(v for v in corners[j].tolist() if v not in (a, b))
        if d == c:
            still[i] = still[j] = False
            for one, other in ((a, b), (b, c), (c, a)):
                owner.pop((one, other), None)
                owner.pop((other, one), None)
            continue
        corners[i], corners[j] = (c, a, d), (b, c, d)
        for side in ((a, b), (b, a)):
            owner.pop(side, None)
        owner.update({(c, a): i, (a, d): i, (d, c): i, (b, c): j, (c, d): j, (d, b): j})
        todo += [i, j]
    return corners, still
