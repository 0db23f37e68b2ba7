"""What of a part a camera truly sees: triangles and double precision, nothing of the planner's.

All sight lines of a view meet in the camera's centre, so a triangle hides a sample exactly where
the sample lies in the cone that the triangle spans at the centre, behind its plane. Signs of triple
products decide it; candidates come from strips of the picture plane, clipped to each triangle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.imaging import Camera

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

MAX_PAIRS = 2_000_000  # sample and triangle, per pass
NEAREST_MM = 1.0  # triangles that come closer to the camera's plane are tried on every sample
LIFT_MM = 0.01  # a sample stands this far off the surface it lies on
EDGE_MM = 0.3  # a sample this close to the rim of a shadow may be judged either way
INCIDENCE_RAD = float(np.radians(1.0))  # and one this close to the steepest angle
DENSITY_SHARE = 0.02
DEPTH_MM = 0.5
BORDER_PX = 1.0
# of a box's twelve triangles, corners numbered by the bits x y z
_BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
_BOX_CORNERS = np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)]) * 2.0 - 1.0


@dataclass(frozen=True)
class VisibilityRules:
    """What counts as seen; the planner's own options, handed in as numbers."""

    max_incidence_rad: float
    min_px_per_mm: float
    sharp_mm: tuple[float, float] = (0.0, np.inf)


@dataclass(frozen=True)
class Seen:
    """Per sample: in sight, and whether the answer hangs on less than the tolerances."""

    seen: Mask
    open: Mask


def box_triangles(T_world_box: Array, half_mm: Array) -> Array:
    """Return the twelve triangles (12, 3, 3) of a box."""
    corners = (_BOX_CORNERS * half_mm) @ T_world_box[:3, :3].T + T_world_box[:3, 3]
    return corners[_BOX_FACES]


def blocked(triangles: Array, eye: Array, points: Array, near: Array | float = 0.0) -> Mask:
    """Tell which points (n, 3) a triangle (m, 3, 3) hides from the eye (3,).

    `near` is a length per point along its sight line within which triangles do not count.
    """
    result = np.zeros(len(points), dtype=bool)
    if len(points) == 0 or len(triangles) == 0:
        return result
    p = points - eye
    far = np.linalg.norm(p, axis=1)
    stop = 1.0 - np.broadcast_to(near, far.shape) / far
    view = _frame((p / far[:, None]).mean(axis=0))
    a = triangles - eye
    depth = a @ view[2]
    p_view = p @ view.T
    if p_view[:, 2].min() <= 0:
        raise ValueError("points all round the eye are no picture")
    nearer = depth.min(axis=1) < p_view[:, 2].max()
    ahead = depth.min(axis=1) > NEAREST_MM
    flat = p_view[:, :2] / p_view[:, 2:]
    (usual,) = np.nonzero(nearer & ahead)
    corners = a[usual] @ view[:2].T / depth[usual][..., None]
    overlap = (corners.max(axis=1) >= flat.min(axis=0)).all(axis=1)
    overlap &= (corners.min(axis=1) <= flat.max(axis=0)).all(axis=1)
    usual, corners = usual[overlap], corners[overlap]
    for first, second in _candidates(corners, flat):
        _mark(result, a, p, stop, usual[first], second)
    (odd,) = np.nonzero(nearer & ~ahead & (depth.max(axis=1) > 0))
    if len(odd):
        _mark(result, a, p, stop, np.repeat(odd, len(p)), np.tile(np.arange(len(p)), len(odd)))
    return result


def _frame(towards: Array) -> Array:
    """Return right, up and ahead (3, 3)."""
    ahead = towards / np.linalg.norm(towards)
    right = np.cross(np.eye(3)[int(np.argmin(np.abs(ahead)))], ahead)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def _candidates(corners: Array, points: Array) -> Iterator[tuple[Index, Index]]:
    """Yield pairs (triangle, point) of the picture plane that may overlap.

    Points are sorted into strips of equal count along x and by y within; each triangle is clipped
    to each strip that it crosses, which leaves long slivers few candidates too.
    """
    n, m = len(points), len(corners)
    if n == 0 or m == 0:
        return
    strips = int(np.clip(np.sqrt(n), 1, 128))
    by_x = np.sort(points[:, 0])
    inner = by_x[(np.arange(1, strips) * n) // strips]
    strip = np.searchsorted(inner, points[:, 0], side="right")
    low, span = points[:, 1].min(), max(float(np.ptp(points[:, 1])), 1e-300)
    order = np.lexsort((points[:, 1], strip))
    key = strip[order] * 4.0 + (points[order, 1] - low) / span
    edge = np.concatenate([[-np.inf], inner, [np.inf]])

    k0 = np.searchsorted(inner, corners[:, :, 0].min(axis=1), side="right")
    k1 = np.searchsorted(inner, corners[:, :, 0].max(axis=1), side="right")
    count = k1 - k0 + 1
    tri = np.repeat(np.arange(m), count)
    at = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + k0[tri]
    y_low, y_high = _clip(corners[tri], edge[at], edge[at + 1])
    tiny = 1e-9
    first = np.searchsorted(key, at * 4.0 + np.clip((y_low - low) / span, 0, 1.5) - tiny)
    last = np.searchsorted(key, at * 4.0 + np.clip((y_high - low) / span, -1, 1) + tiny, "right")
    number = np.maximum(last - first, 0)
    ends = np.cumsum(number)
    begin = 0
    while begin < len(number):
        taken = ends[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(ends, taken + MAX_PAIRS, side="right")))
        c = number[begin:stop]
        rows = np.repeat(np.arange(begin, stop), c)
        place = np.arange(c.sum()) - np.repeat(np.cumsum(c) - c, c) + first[rows]
        yield tri[rows], order[place]
        begin = stop


def _clip(corners: Array, left: Array, right: Array) -> tuple[Array, Array]:
    """Return the lowest and highest y of triangles (k, 3, 2) between two verticals (k,)."""
    low, high = np.full(len(corners), np.inf), np.full(len(corners), -np.inf)
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        dx = b[:, 0] - a[:, 0]
        steep = np.abs(dx) < 1e-300
        safe = np.where(steep, 1.0, dx)
        t0, t1 = (left - a[:, 0]) / safe, (right - a[:, 0]) / safe
        t0, t1 = np.minimum(t0, t1), np.maximum(t0, t1)
        t0 = np.where(steep, 0.0, np.clip(t0, 0, 1))
        t1 = np.where(steep, 1.0, np.clip(t1, 0, 1))
        meets = (np.maximum(a[:, 0], b[:, 0]) >= left) & (np.minimum(a[:, 0], b[:, 0]) <= right)
        for t in (t0, t1):
            y = a[:, 1] + t * (b[:, 1] - a[:, 1])
            low = np.where(meets, np.minimum(low, y), low)
            high = np.where(meets, np.maximum(high, y), high)
    return low, high


def _mark(result: Mask, a: Array, p: Array, stop: Array, tri: Index, point: Index) -> None:
    """Mark the points hidden among pairs of triangle and point."""
    todo = ~result[point]
    tri, point = tri[todo], point[todo]
    used, back = np.unique(tri, return_inverse=True)
    one, two, three = a[used, 0], a[used, 1], a[used, 2]
    normal = np.cross(two - one, three - one)
    lift = np.einsum("ij,ij->i", normal, one)
    q = p[point]
    edges = ((one, two), (two, three), (three, one))
    sides = [np.einsum("ij,ij->i", np.cross(x, y)[back], q) for x, y in edges]
    inside = (sides[0] >= 0) & (sides[1] >= 0) & (sides[2] >= 0)
    inside |= (sides[0] <= 0) & (sides[1] <= 0) & (sides[2] <= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = lift[back] / np.einsum("ij,ij->i", normal[back], q)
    hit = inside & (share > 1e-9) & (share < stop[point])
    result[point[hit]] = True


def pixels_of(camera: Camera, points: Array) -> Array:
    """Return pixels (n, 2) by OpenCV's published formula: pin-hole, k1 k2 p1 p2 k3."""
    R, t = camera.T_world_cam[:3, :3], camera.T_world_cam[:3, 3]
    c = (points - t) @ R
    x, y = c[:, 0] / c[:, 2], c[:, 1] / c[:, 2]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    K = camera.K
    return np.column_stack([K[0, 0] * xd + K[0, 2], K[1, 1] * yd + K[1, 2]])


def density_of(camera: Camera, points: Array, normals: Array) -> Array:
    """Return the pixels per mm (n,) along the surface, in the direction that has fewest."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = np.cross(normals, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    step = 0.05
    slopes = np.stack(
        [
            (pixels_of(camera, points + step * d) - pixels_of(camera, points - step * d))
            / (2 * step)
            for d in (u, v)
        ],
        axis=2,
    )
    # the smaller singular value of a 2 x 2 matrix
    square = (slopes**2).sum(axis=(1, 2))
    det = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
    root = np.sqrt(np.maximum(square**2 - 4 * det**2, 0))
    return np.sqrt(np.maximum((square - root) / 2, 0))


def in_sight(
    points: Array,
    normals: Array,
    camera: Camera,
    occluders: Array,
    rules: VisibilityRules,
    doubted: Mask | None = None,
) -> Seen:
    """Tell which samples (n, 3) of a part in the world the camera sees among triangles (m, 3, 3).

    `doubted` is what somebody else says: only where he says otherwise is the answer's firmness
    looked into (eight sight lines round each), as it costs nine times as much.
    """
    eye = camera.T_world_cam[:3, 3]
    sight = eye - points
    far = np.linalg.norm(sight, axis=1)
    cos = np.einsum("ij,ij->i", sight, normals) / far
    angle = np.arccos(np.clip(cos, -1, 1))
    depth = (points - eye) @ camera.T_world_cam[:3, 2]
    pixels = pixels_of(camera, points)
    size = np.array(camera.size_px, float)
    inset = np.minimum(pixels + 0.5, size - 0.5 - pixels).min(axis=1)
    density = density_of(camera, points, normals)
    near, distant = rules.sharp_mm

    def fits(slack: float) -> Mask:
        ok = angle <= rules.max_incidence_rad + slack * INCIDENCE_RAD
        ok &= density >= rules.min_px_per_mm * (1 - slack * DENSITY_SHARE)
        ok &= (depth >= near - slack * DEPTH_MM) & (depth <= distant + slack * DEPTH_MM)
        ok &= (inset >= -slack * BORDER_PX) & (depth > 0)
        return np.asarray(ok)

    fit = fits(0.0)
    seen = fit.copy()
    start = points + LIFT_MM * normals
    (rows,) = np.nonzero(fit)
    seen[rows] = ~blocked(occluders, eye, start[rows])
    unsure = np.zeros(len(points), dtype=bool)
    if doubted is None:
        return Seen(seen, unsure)
    (rows,) = np.nonzero((seen != doubted) & fits(1.0))
    if len(rows) == 0:
        return Seen(seen, unsure)
    outside = ~fits(-1.0)[rows]
    clear = ~blocked(occluders, eye, start[rows])
    towards = sight[rows] / far[rows][:, None]
    u = np.cross(towards, np.eye(3)[np.argmin(np.abs(towards), axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(towards, u)
    ignored = EDGE_MM * np.tan(np.minimum(angle[rows], np.radians(80.0))) + 0.1
    some, every = clear.copy(), clear.copy()
    for k in range(8):
        turn = k * np.pi / 4
        shifted = start[rows] + EDGE_MM * (np.cos(turn) * u + np.sin(turn) * v)
        free = ~blocked(occluders, eye, shifted, ignored)
        some |= free
        every &= free
    wanted = doubted[rows]
    # open if shadows and limits, each moved by its tolerance, allow what the other one says
    unsure[rows] = np.where(wanted, some, outside | ~every)
    return Seen(seen, unsure)
