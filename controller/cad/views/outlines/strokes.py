"""A loop of the outline as lines and arcs: circles of the part stay circles, or become ellipses.

Seen from above or through a lens without distortion the ellipses are exact: the conic through
which a camera sees a circle (Hartley and Zisserman, references.md L3). What a
lens bends is no conic any more; the ellipse given is then the closest one (0.01 px and better for
lenses as straight as an inspection cell's).
"""

from itertools import pairwise

import numpy as np
import shapely

from controller.arrays import FloatArray

from ...boundary import Curve
from .._model import ViewModel
from .._project import Projection
from .._types import Stroke
from .outline import ROUNDED_MM, PlaneLoop

STRAIGHT_MM = 1e-3  # corners this close to a line are on it
FLATTEST = 0.02  # ratio of half axes; a flatter ellipse is drawn by its corners


def strokes_of(model: ViewModel, view: Projection, ring: PlaneLoop) -> tuple[Stroke, ...]:
    """Return a loop as lines and arcs in the coordinates of the view.

    Parameters
    ----------
    model, view : the part and how the eye has it
    ring : a loop of its outline
    """
    count = len(ring.points)
    points = view.to_view(ring.points)
    per_mm = view.scale
    label = ring.edges.astype(np.int64) * (len(model.solid.faces) + 1) + ring.faces
    begins = np.flatnonzero(label != np.roll(label, 1))
    if len(begins) == 0:
        begins = np.zeros(1, dtype=np.int64)
    stops = np.concatenate([begins[1:], begins[:1] + count])
    strokes: list[Stroke] = []
    for begin, stop in zip(begins.tolist(), stops.tolist(), strict=True):
        corners = points[np.arange(begin, stop + 1) % count]
        edge, face = int(ring.edges[begin]), int(ring.faces[begin])
        ellipse = _ellipse(model, view, edge, face) if stop - begin > 1 else None
        arc = None if ellipse is None else _arc(corners, *ellipse, ROUNDED_MM * per_mm)
        if arc is not None and ellipse is not None:
            centre, axes = ellipse
            strokes.append(Stroke(corners[0], corners[-1], centre, axes, arc, edge, face))
            continue
        if stop - begin > 1:
            line = shapely.LineString(corners)
            corners = shapely.get_coordinates(
                shapely.simplify(line, STRAIGHT_MM * per_mm, preserve_topology=False)
            )
        for start, end in pairwise(corners):
            strokes.append(Stroke(start, end, None, None, 0.0, edge, face))
    return tuple(strokes)


def _arc(
    corners: FloatArray, centre: FloatArray, axes: FloatArray, tolerance: float
) -> float | None:
    """Return the angle swept along corners (n, 2), None where they do not lie on the ellipse.

    Not all of them have to be corners of the circle: a mesh may have vertices on its chords as
    well.
    """
    unit = (corners - centre) @ axes.T / (axes**2).sum(axis=1)
    radius = np.linalg.norm(unit, axis=1)
    if float(np.abs(radius - 1).max()) * float(np.linalg.norm(axes, axis=1).min()) > tolerance:
        return None
    turn = np.diff(np.arctan2(unit[:, 1], unit[:, 0]))
    return float(((turn + np.pi) % (2 * np.pi) - np.pi).sum())


def _ellipse(
    model: ViewModel, view: Projection, edge: int, face: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return centre and half axes, in the view, of a circular edge or a ball's silhouette."""
    boundary = model.solid.boundary
    if edge >= 0 and boundary.curve[edge] == Curve.CIRCLE:
        axis, radius = boundary.axis[edge], float(boundary.radius_mm[edge])
        across = np.eye(3)[np.abs(axis).argmin()]
        e1 = np.cross(axis, across)
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(axis, e1) / np.linalg.norm(axis)
        circle = view.matrix[:, :3] @ np.column_stack(
            [radius * e1, radius * e2, boundary.centre_mm[edge]]
        )
        circle[:, 2] += view.matrix[:, 3]
        dual = circle @ np.diag([1.0, 1.0, -1.0]) @ circle.T
    elif face >= 0 and model.solid.faces[face].kind == "sphere":
        ball = model.solid.faces[face]
        quadric = np.eye(4)
        quadric[:3, 3] = quadric[3, :3] = -ball.centre_mm
        quadric[3, 3] = ball.centre_mm @ ball.centre_mm - ball.radius_mm**2
        dual = view.matrix @ np.linalg.inv(quadric) @ view.matrix.T
    else:
        return None
    found = _from_dual(dual)
    if found is None or view.camera is None:
        return found
    centre, axes = found
    angle = np.arange(16) * (np.pi / 8)
    on_it = centre + np.column_stack([np.cos(angle), np.sin(angle)]) @ axes
    return _through(view.to_view(on_it))


def _from_dual(dual: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return centre and half axes of the ellipse of a dual conic (3, 3)."""
    # C* of (x - m)^T A^-1 (x - m) = 1 is [[A - m m^T, -m], [-m^T, -1]] up to scale
    dual = -dual / dual[2, 2]
    centre = -dual[:2, 2]
    shape = dual[:2, :2] + np.outer(centre, centre)
    squares, directions = np.linalg.eigh(shape)
    if squares[0] <= FLATTEST**2 * squares[1]:
        return None
    return centre, _half_axes(squares, directions)


def _through(points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return centre and half axes of the ellipse closest to points (n, 2) all round it."""
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max()) / 2
    x, y = ((points - middle) / size).T
    conic = np.linalg.svd(np.column_stack([x * x, x * y, y * y, x, y, np.ones_like(x)]))[2][-1]
    form = np.array([[conic[0], conic[1] / 2], [conic[1] / 2, conic[2]]])
    b = conic[3:5] / 2
    centre = -np.linalg.solve(form, b)
    rest = -(conic[5] + b @ centre)
    squares, directions = np.linalg.eigh(np.linalg.inv(form / rest))
    if squares[0] <= FLATTEST**2 * squares[1]:
        return None
    return middle + size * centre, size * _half_axes(squares, directions)


def _half_axes(squares: FloatArray, directions: FloatArray) -> FloatArray:
    axes: FloatArray = (directions * np.sqrt(squares)).T[::-1]
    if axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0] < 0:
        axes = axes * [[1.0], [-1.0]]
    return axes
