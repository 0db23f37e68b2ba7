"""Planes, cylinders, cones, spheres and tori fitted to pieces of a tessellation.

A first guess comes from the normals (all of a cylinder's are square to its axis, all normal lines
of a torus meet its axis), the last word have the vertices: they lie on the true surface, while
facets cut its corners. Normal lines and axes: Pottmann, Wallner, Computational Line Geometry, 4.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import FloatArray

from .primitives import Primitive
from .refine import ball, basis, refined

FIT_POINTS = 600  # more points do not improve a fit of seven numbers
FLAT_SPREAD = 1e-5  # mean square of normals along an axis: below it all are square to the axis
FAR_OFF = 0.05  # share of a cloud's size; a guess with a larger misfit does not converge
MIN_HOLE = 0.05  # share of the tube; a torus with a smaller ring is a ball
MIN_HALF_ANGLE_RAD = np.radians(0.2)  # a slimmer cone is a cylinder
LARGEST_HALF_ANGLE_RAD = np.radians(89.0)


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """Data of a piece of surface: corners (n, 3), facets (m, 3) and their areas (m,)."""

    points: FloatArray
    normals: FloatArray
    centres: FloatArray
    areas: FloatArray

    def thinned(self) -> "Cloud":
        """Return an even selection of points and facets, few enough for a quick fit."""
        i, k = thinning(len(self.points)), thinning(len(self.normals))
        return Cloud(self.points[::i], self.normals[::k], self.centres[::k], self.areas[::k])


def thinning(count: int) -> int:
    """Return the step through ``count`` points that leaves just enough for a fit."""
    return max(1, count // FIT_POINTS)


def fits(cloud: Cloud, aim_mm: float = 0.0) -> Iterator[Primitive]:
    """Yield the surfaces that a cloud may lie on, the simplest kinds first.

    With ``aim_mm`` those that will not come so near may be yielded half fitted.
    """
    cloud = cloud.thinned()
    plane = _plane(cloud)
    yield plane
    shares = cloud.areas / max(float(cloud.areas.sum()), 1e-300)
    about_zero = (cloud.normals * shares[:, None]).T @ cloud.normals
    spread, vectors = np.linalg.eigh(about_zero)
    if spread[1] < 1e-7:
        return  # one direction only: nothing but a plane
    if spread[0] < 0.02:
        found = _cylinder(cloud, vectors[:, 0], aim_mm)
        if found is not None:
            yield found
    found = _cone(cloud, shares, aim_mm)
    if found is not None:
        yield found  # before balls: both rings of a short cone lie on one as well
    if spread[0] < FLAT_SPREAD:
        return  # two rings of strips lie on a ball, too, but nothing says they are one
    found = ball(cloud.points)
    if found is not None:
        yield found
    found = _torus(cloud, aim_mm)
    if found is not None:
        yield found


def _plane(cloud: Cloud) -> Primitive:
    middle = cloud.points.mean(axis=0)
    centred = cloud.points - middle
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    mean = (cloud.normals * cloud.areas[:, None]).sum(axis=0)
    return Primitive("plane", middle, normal if normal @ mean >= 0 else -normal)


def _cylinder(cloud: Cloud, axis: FloatArray, aim_mm: float) -> Primitive | None:
    one, two = basis(axis)
    uv = np.column_stack([cloud.points @ one, cloud.points @ two])
    middle = uv.mean(axis=0)
    uv = uv - middle
    system = np.column_stack([2 * uv, np.ones(len(uv))])
    solution = np.linalg.lstsq(system, (uv**2).sum(axis=1), rcond=None)[0]
    square = solution[2] + solution[:2] @ solution[:2]
    if not square > 0:
        return None
    centre = one * (middle + solution[:2])[0] + two * (middle + solution[:2])[1]
    centre = centre + axis * float((cloud.points @ axis).mean())
    return refined(
        Primitive("cylinder", centre, axis, float(np.sqrt(square))), cloud.points, aim_mm
    )


def _cone(cloud: Cloud, shares: FloatArray, aim_mm: float) -> Primitive | None:
    mean = (cloud.normals * shares[:, None]).sum(axis=0)
    centred = cloud.normals - mean
    spread, vectors = np.linalg.eigh((centred * shares[:, None]).T @ centred)
    if spread[1] < 1e-7 or spread[0] > 0.05:
        return None
    axis = vectors[:, 0]
    # the planes of all strips go through the apex
    apex, _, rank, _ = np.linalg.lstsq(
        cloud.normals, (cloud.normals * cloud.centres).sum(axis=1), rcond=1e-7
    )
    if rank < 3:
        return None
    offset = cloud.points - apex
    height = offset @ axis
    if height.mean() < 0:
        axis, height = -axis, -height
    away = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    half = float(np.arctan2(away.mean(), height.mean()))
    if not MIN_HALF_ANGLE_RAD < half < LARGEST_HALF_ANGLE_RAD:
        return None
    middle = apex + axis * float(height.mean())
    guess = Primitive("cone", middle, axis, float(away.mean()), 0.0, half)
    found = refined(guess, cloud.points, aim_mm)
    if not MIN_HALF_ANGLE_RAD < abs(found.half_angle_rad) < LARGEST_HALF_ANGLE_RAD:
        return None
    if found.half_angle_rad < 0:
        found = replace(found, axis=-found.axis, half_angle_rad=-found.half_angle_rad)
    return found


def _torus(cloud: Cloud, aim_mm: float) -> Primitive | None:
    middle = cloud.points.mean(axis=0)
    size = float(np.abs(cloud.points - middle).max())
    if size == 0:
        return None
    spots = (cloud.centres - middle) / size
    lines = np.hstack([np.cross(spots, cloud.normals), cloud.normals])
    weights = cloud.areas / cloud.areas.sum()
    _, vectors = np.linalg.eigh((lines * weights[:, None]).T @ lines)
    best: Primitive | None = None
    best_error = np.inf
    for column in (0, 1):
        direction, moment = vectors[:3, column], vectors[3:, column]
        length = float(np.linalg.norm(direction))
        if length < 1e-6:
            continue
        axis = direction / length
        # the point of the axis nearest to the middle
        foot = np.cross(axis, moment / length)
        p = (cloud.points - middle) / size - foot
        height = p @ axis
        away = np.linalg.norm(p - height[:, None] * axis, axis=1)
        system = np.column_stack([2 * away, 2 * height, np.ones(len(p))])
        solution, _, rank, _ = np.linalg.lstsq(system, away**2 + height**2, rcond=1e-9)
        square = solution[2] + solution[0] ** 2 + solution[1] ** 2
        if rank < 3 or not square > 0 or not solution[0] > 0:
            continue
        guess = Primitive(
            "torus",
            middle + size * (foot + axis * solution[1]),
            axis,
            size * float(solution[0]),
            size * float(np.sqrt(square)),
        )
        if float(np.abs(guess.distances(cloud.points)).max()) > FAR_OFF * size:
            continue
        found = refined(guess, cloud.points, aim_mm)
        error = float(np.abs(found.distances(cloud.points)).max())
        is_ring = found.radius_mm > MIN_HOLE * found.minor_radius_mm > 0
        if is_ring and error < best_error:
            best, best_error = found, error
    return best
