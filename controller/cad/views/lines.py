"""Line drawings: the outline in loops, and the visible edges with hidden lines removed.

The paper (references.md P2.2) took them from a plot file of BOXER; here they follow from the solid
itself, seen from above or through a calibrated camera.
"""

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

from ..solid import Solid
from ._model import ViewModel, prepare_views
from ._project import Projection, seen_by_camera, seen_from_above
from ._types import DrawnEdge, LineView, Loop
from .edges.covered import without_covered
from .edges.doubles import without_doubles
from .edges.drawn import draw, subdivisions
from .edges.hidden import EdgeRuns, candidate_edges, cut_edges, is_seen, tree_of_edges
from .outlines.outline import PlaneLoop, find_rings, rim_edges
from .outlines.strokes import strokes_of


def line_view(solid: Solid, R: FloatArray, *, prepared: ViewModel | None = None) -> LineView:
    """Return the line drawing of a part turned by ``R``, seen straight from above [mm].

    Parameters
    ----------
    solid : the part
    R : (3, 3) rotation, CAD to upright
    prepared : `prepare_views` of the same solid, worth keeping for a second view
    """
    model = prepared or prepare_views(solid)
    return _drawing(model, seen_from_above(model, np.asarray(R, dtype=np.float64)))


def camera_view(
    solid: Solid, T_world_part: FloatArray, camera: Camera, *, prepared: ViewModel | None = None
) -> LineView:
    """Return the line drawing of a posed part through a calibrated camera [px].

    Lines the lens bends come in as many points as hold them to 0.002 px; those between corners
    are neither corners nor phantoms.

    Parameters
    ----------
    solid : the part
    T_world_part : (4, 4) pose of the CAD frame in the world [mm]
    camera : calibrated, in the world's frame
    prepared : `prepare_views` of the same solid, worth keeping for a second view

    Raises
    ------
    ValueError : part of it is not in front of the camera
    """
    model = prepared or prepare_views(solid)
    return _drawing(model, seen_by_camera(model, T_world_part, camera))


def outline(
    solid: Solid,
    pose: FloatArray,
    camera: Camera | None = None,
    *,
    prepared: ViewModel | None = None,
) -> LineView:
    """Return the outline alone, in a fraction of the time of `line_view` or `camera_view`.

    Parameters
    ----------
    solid : the part
    pose : without a camera the rotation (3, 3) of `line_view`, with one ``T_world_part`` (4, 4)
    camera : calibrated; None for straight from above
    prepared : `prepare_views` of the same solid, worth keeping for a second view

    Raises
    ------
    ValueError : part of it is not in front of the camera
    """
    model = prepared or prepare_views(solid)
    if camera is None:
        view = seen_from_above(model, np.asarray(pose, dtype=np.float64))
    else:
        view = seen_by_camera(model, pose, camera)
    rims = rim_edges(model, view)
    rings = find_rings(model, view, rims, rims, tree_of_edges(model, view, rims))
    return _line_view(model, view, rings, ())


def _drawing(model: ViewModel, view: Projection) -> LineView:
    rims = rim_edges(model, view)
    edges, open_rims = without_covered(model, view, candidate_edges(model, view), rims)
    rim_tree = tree_of_edges(model, view, open_rims)
    rings = find_rings(model, view, rims, open_rims, rim_tree)
    pieces = cut_edges(view, model, edges, open_rims, rim_tree)
    seen = is_seen(model, view, pieces)
    pieces = EdgeRuns(pieces.mesh_edge[seen], pieces.start[seen], pieces.end[seen])
    pieces = without_doubles(model, view, pieces)
    return _line_view(model, view, rings, draw(model, view, pieces, rings))


def _line_view(
    model: ViewModel, view: Projection, rings: list[PlaneLoop], edges: tuple[DrawnEdge, ...]
) -> LineView:
    loops = tuple(_loop(model, view, ring) for ring in rings)
    area, centroid, moments = _moments([loop.points for loop in loops])
    perimeter = sum(
        float(np.linalg.norm(loop.points - np.roll(loop.points, 1, axis=0), axis=1).sum())
        for loop in loops
    )
    return LineView(loops, edges, area, perimeter, centroid, moments)


def _loop(model: ViewModel, view: Projection, ring: PlaneLoop) -> Loop:
    ahead = np.roll(ring.points, -1, axis=0)
    count = subdivisions(view, ring.points, ahead)
    side = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    points = ring.points[side] + (step / count[side])[:, None] * (ahead - ring.points)[side]
    return Loop(
        points=view.to_view(points),
        edges=ring.edges[side],
        faces=ring.faces[side],
        is_phantom=ring.is_phantom[side] & (step == 0),
        is_hole=ring.is_hole,
        strokes=strokes_of(model, view, ring),
    )


def _moments(loops: list[FloatArray]) -> tuple[float, FloatArray, FloatArray]:
    """Return area, centroid (2,) and central second moments (2, 2) over the area (Green)."""
    if not loops:
        return 0.0, np.full(2, np.nan), np.full((2, 2), np.nan)
    origin = loops[0].mean(axis=0)  # near the part, so that pixels far from (0, 0) cost no digits
    p = np.concatenate(loops) - origin
    q = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops]) - origin
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    area = float(cross.sum()) / 2
    centroid = (cross[:, None] * (p + q)).sum(axis=0) / (6 * area)
    both = p + q
    second = np.einsum("n,ni,nj->ij", cross, both, both) + np.einsum("n,ni,nj->ij", cross, p, p)
    second += np.einsum("n,ni,nj->ij", cross, q, q)
    moments = second / (24 * area) - np.outer(centroid, centroid)
    return abs(area), origin + centroid, moments
