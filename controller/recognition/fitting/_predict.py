"""Prediction of the edges of a posed part that a camera sees, under full perspective.

An edge shows where the surface turns away from the eye (a rim), and where two surfaces meet at an
angle (a crease). Both are sampled along their length; a sight line to each sample tests for an
obstacle, and others beside it find the surface on either side, table or part, and its normal. The
outline alone takes less time: it consists of rims with nothing beside them.
"""

from dataclasses import dataclass, field

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array, IntArray
from controller.imaging import Camera, inverse_pose, transform

from ._model import EdgeModel

# Distance of a sample from the surface, so that its own facets do not hide it.
OFF_SURFACE_MM = 0.06
HIDDEN_MM = 0.25  # something this much nearer than the sample hides it
STEP_MM = 0.5  # a step this high shows even if both its sides are turned the same way
MIN_STEP_MM = 0.25
SEEN_SHARE = 0.5  # share of the edges tested below which hidden ones are left out
CLOSE_MM = 0.015  # distance beside an edge at which an outline has nothing behind it
BESIDE_MM = 0.45  # distance beside an inner edge at which its two sides are probed: about 1.5 px
CREASE_BEND = 0.2  # |n1 - n2| of what shows as a crease: 11 degrees
END_ON = 0.05  # sine between a line of sight and an edge that is seen as a point
AHEAD_MM = 0.2  # step along an edge and beside it, to find its direction in the picture


@dataclass(frozen=True, eq=False, slots=True)
class ModelEdgePoints:
    """Samples of the visible edges of a posed part.

    Attributes
    ----------
    points_mm : (n, 3) world
    pixels : (n, 2) positions in the picture, lens included
    normals : (n, 2) unit, square to the edge in the picture; away from the part on the outline
    on_outline : (n,) mask of the edges with the table beside them
    lift : (n,) expected brightness of the far side along ``normals`` less that of the near one
        under light from the camera's side: difference of cosines, the table left out
    jump_mm : (n,) depth of one side less that of the other; 0 on the outline
    step_mm : step between samples along the edges, square to the sight line
    edge : (n,) index of the model's edge; empty if it is unknown
    """

    points_mm: FloatArray
    pixels: FloatArray
    normals: FloatArray
    on_outline: BoolArray
    lift: FloatArray
    jump_mm: FloatArray
    step_mm: float
    edge: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def at(self, which: BoolArray) -> "ModelEdgePoints":
        """Return the samples of a mask (n,)."""
        return ModelEdgePoints(
            self.points_mm[which],
            self.pixels[which],
            self.normals[which],
            self.on_outline[which],
            self.lift[which],
            self.jump_mm[which],
            self.step_mm,
            self.edge[which] if len(self.edge) else self.edge,
        )


@dataclass(frozen=True, eq=False, slots=True)
class _Samples:
    """Samples of edges, CAD frame: position, direction, and square to it and to the sight line."""

    edge: IntArray
    points: FloatArray
    along: FloatArray
    across: FloatArray
    distance: FloatArray

    def at(self, which: BoolArray | IntArray) -> "_Samples":
        return _Samples(
            self.edge[which],
            self.points[which],
            self.along[which],
            self.across[which],
            self.distance[which],
        )


def predict_edges(
    model: EdgeModel, T_world_part: FloatArray, camera: Camera, most: int = 900
) -> ModelEdgePoints:
    """Return the visible edges of a posed part.

    Parameters
    ----------
    model : edges of the part
    T_world_part : (4, 4) pose of the CAD frame in the world [mm]
    camera : calibrated, in the world's frame
    most : approximate number of samples examined, hidden ones included
    """
    eye = _eye(T_world_part, camera)
    is_rim, shows = _rims(model, eye)
    shows |= is_rim
    samples, step = _visible(model, np.flatnonzero(shows), eye, most)
    ahead = samples.points - eye
    close, aside = CLOSE_MM * samples.across, BESIDE_MM * samples.across
    free_a, free_b = _is_free(model, eye, np.concatenate([ahead + close, ahead - close]), 2)
    on_outline = free_a | free_b
    triangle, depth = _look(model, eye, np.concatenate([ahead + aside, ahead - aside]))
    hit = triangle.reshape(2, -1)
    no_a, no_b = hit < 0
    normal_a = np.where(no_a[:, None], 0.0, model.normals[hit[0]])
    normal_b = np.where(no_b[:, None], 0.0, model.normals[hit[1]])
    bent = normal_a - normal_b
    bend = np.sqrt(np.einsum("ij,ij->i", bent, bent))
    far_a, far_b = np.where(np.isfinite(depth), depth, 0.0).reshape(2, -1)
    jump = np.where(no_a | no_b | on_outline, 0.0, np.abs(far_a - far_b) * samples.distance)
    shows = on_outline | is_rim[samples.edge] | (bend > CREASE_BEND) | (jump > STEP_MM)
    # beside both sides of a groove so narrow is the same face
    shows |= (model.bend[samples.edge] > CREASE_BEND) & ~(no_a | no_b)
    towards = -ahead / samples.distance[:, None]
    lift = np.einsum("ij,ij->i", bent, towards)
    turned = free_b & ~free_a  # there the normal runs to side b
    lift[turned] *= -1.0
    return _seen(samples, turned, on_outline, lift, jump, T_world_part, camera, step, shows)


def predict_outline(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    most: float = 600,
    min_step_mm: float = MIN_STEP_MM,
) -> ModelEdgePoints:
    """Return the outline of a posed part alone, in a third of the time of `predict_edges`.

    Parameters
    ----------
    model : edges of the part
    T_world_part : (4, 4) pose of the CAD frame in the world [mm]
    camera : calibrated, in the world's frame
    most : approximate number of samples examined, hidden ones included
    min_step_mm : between samples, however few they are
    """
    eye = _eye(T_world_part, camera)
    is_rim, _ = _rims(model, eye)
    samples, step = _sample(model, np.flatnonzero(is_rim), eye, most, min_step_mm)
    ahead, close = samples.points - eye, CLOSE_MM * samples.across
    free_a, free_b = _is_free(model, eye, np.concatenate([ahead + close, ahead - close]), 2)
    free = free_a | free_b
    nothing = np.zeros(len(free))
    return _seen(
        samples, free_b & ~free_a, free, nothing, nothing, T_world_part, camera, step, free
    )


def _eye(T_world_part: FloatArray, camera: Camera) -> FloatArray:
    eye: FloatArray = transform(inverse_pose(T_world_part), camera.position_mm[None])[0]
    return eye


def _rims(model: EdgeModel, eye: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return masks (e,) of the rims, and of the creases with a side that faces the eye."""
    first = model.first[:, :3] @ eye > model.first[:, 3]
    second = model.second[:, :3] @ eye > model.second[:, 3]
    return first != second, model.is_crease & (first | second)


def _sample(
    model: EdgeModel, chosen: IntArray, eye: FloatArray, most: float, min_step_mm: float
) -> tuple[_Samples, float]:
    edge, share, step = _spread(_seen_length(model, chosen, eye), most, min_step_mm)
    edge = chosen[edge]
    along = model.along_mm[edge]
    points = model.start_mm[edge] + share[:, None] * along
    along /= np.maximum(model.length_mm[edge], 1e-12)[:, None]
    ahead = points - eye
    distance = np.sqrt(np.einsum("ij,ij->i", ahead, ahead))
    across = cross(ahead, along)
    size = np.sqrt(np.einsum("ij,ij->i", across, across))
    across /= np.maximum(size, 1e-12)[:, None]
    samples = _Samples(edge, points, along, across, distance)
    return samples.at(size > END_ON * distance), step


def _visible(
    model: EdgeModel, chosen: IntArray, eye: FloatArray, most: int
) -> tuple[_Samples, float]:
    """Return visible samples; of a part that hides most of its edges, on the others.

    Of a hollow rail a seventh is seen, and samples on it would be farther apart than its grooves.
    """
    samples, step = _sample(model, chosen, eye, most, MIN_STEP_MM)
    seen = _is_seen(model, samples.edge, samples.points, eye)
    if step > MIN_STEP_MM and seen.mean() < SEEN_SHARE:
        short = np.setdiff1d(chosen, samples.edge)  # without a sample: looked at in the middle
        left = short[_is_seen(model, short, model.middle_mm[short], eye)]
        left = np.union1d(samples.edge[seen], left)
        samples, step = _sample(model, left, eye, most, MIN_STEP_MM)
        seen = _is_seen(model, samples.edge, samples.points, eye)
    return samples.at(seen), step


def _is_seen(model: EdgeModel, edge: IntArray, points: FloatArray, eye: FloatArray) -> BoolArray:
    looks = points + OFF_SURFACE_MM * model.out[edge] - eye
    _, depth = _look(model, eye, looks)
    return np.asarray(depth > 1.0 - HIDDEN_MM / np.linalg.norm(points - eye, axis=1))


def _look(model: EdgeModel, eye: FloatArray, looks: FloatArray) -> tuple[Int32Array, FloatArray]:
    return model.caster.first_hit(eye, looks)


def _is_free(model: EdgeModel, eye: FloatArray, looks: FloatArray, parts: int) -> BoolArray:
    """Return a mask of the rays from the eye that hit nothing, in ``parts`` rows."""
    return ~model.caster.blocked(eye, looks).reshape(parts, -1)


def _seen(
    samples: _Samples,
    turned: BoolArray,
    on_outline: BoolArray,
    lift: FloatArray,
    jump: FloatArray,
    T_world_part: FloatArray,
    camera: Camera,
    step_mm: float,
    which: BoolArray,
) -> ModelEdgePoints:
    """Return the samples of ``which`` in the camera's picture."""
    kept = samples.at(which)
    outward = np.where(turned[which][:, None], -kept.across, kept.across)
    R = T_world_part[:3, :3]
    points_mm = transform(T_world_part, kept.points)
    beside_mm = points_mm + AHEAD_MM * (outward @ R.T)
    along_mm = points_mm + AHEAD_MM * (kept.along @ R.T)
    projected = camera.project(np.concatenate([points_mm, beside_mm, along_mm]))
    pixels, beside, ahead = projected.reshape(3, -1, 2)
    tangent = ahead - pixels
    along_x, along_y = tangent.T
    size = np.maximum(np.sqrt(along_x * along_x + along_y * along_y), 1e-12)
    out_x, out_y = (beside - pixels).T
    size[out_y * along_x < out_x * along_y] *= -1.0
    normals = np.column_stack([-along_y / size, along_x / size])
    return ModelEdgePoints(
        points_mm,
        pixels,
        normals,
        on_outline[which],
        lift[which],
        jump[which],
        step_mm,
        kept.edge,
    )


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of rows; a quarter of numpy's time for some hundred rows."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _seen_length(model: EdgeModel, chosen: IntArray, eye: FloatArray) -> FloatArray:
    """Return the apparent lengths of edges from the eye [mm]: upright ones are seen end-on."""
    along2, middle2, middle_along = model.seen_by[:, chosen]
    # |a x b|^2 = |a|^2 |b|^2 - (a b)^2, of the way to an edge's middle and along it
    way_along = middle_along - (model.along_mm @ eye)[chosen]
    way2 = middle2 - 2.0 * (model.middle_mm @ eye)[chosen] + eye @ eye
    return np.asarray(np.sqrt(np.maximum(along2 - way_along * way_along / way2, 0.0)))


def _spread(
    length_mm: FloatArray, most: float, min_step_mm: float
) -> tuple[IntArray, FloatArray, float]:
    """Return samples at even steps along edges put end to end: edge, share of it, step."""
    end = np.cumsum(length_mm)
    total = float(end[-1]) if len(end) else 0.0
    step = max(total / most, min_step_mm)
    at = np.arange(step / 2, total, step)
    edge = np.minimum(np.searchsorted(end, at, side="right"), len(length_mm) - 1)
    share = 1.0 - (end[edge] - at) / np.maximum(length_mm[edge], 1e-12)
    return edge.astype(np.int64), np.clip(share, 0.0, 1.0), step
