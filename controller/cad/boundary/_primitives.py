"""Planes, cylinders, cones, spheres and tori fitted to pieces of a tessellation.

A first guess comes from the normals (all of a cylinder's are square to its axis, all normal lines
of a torus meet its axis), the last word have the vertices: they lie on the true surface, while
facets cut its corners. Normal lines and axes: Pottmann, Wallner, Computational Line Geometry, 4.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ._normals import unit
from ._types import NO_DIRECTION, FaceKind

Array = NDArray[np.float64]

FIT_POINTS = 600  # more points tell a fit of seven numbers nothing new
ROUNDS = 12  # Gauss-Newton doubles the right digits each round; from a fair guess five are enough
EXACT = 1e-7  # of a cloud's size: single precision
SETTLED = 1e-3  # a round that gains less of the squared misfit is the last
FLAT_SPREAD = 1e-5  # mean square of normals along an axis: below it all are square to the axis
FAR_OFF = 0.05  # of a cloud's size: a guess so far off leads nowhere
LEAST_HOLE = 0.05  # of its tube: a torus whose ring is smaller is a ball
LEAST_HALF_ANGLE_RAD = np.radians(0.2)  # a slimmer cone is a cylinder
LARGEST_HALF_ANGLE_RAD = np.radians(89.0)


@dataclass(frozen=True, eq=False, slots=True)
class Primitive:
    """A surface with a formula; the fields mean what those of `Face` mean."""

    kind: FaceKind
    centre_mm: Array
    axis: Array
    radius_mm: float = 0.0
    minor_radius_mm: float = 0.0
    half_angle_rad: float = 0.0

    def distances(self, points: Array) -> Array:
        """Return how far points (..., 3) lie off the surface, signed."""
        offset = points - self.centre_mm
        if self.kind == "sphere":
            return np.asarray(np.sqrt((offset * offset).sum(axis=-1)) - self.radius_mm)
        height = offset @ self.axis
        if self.kind == "plane":
            return np.asarray(height)
        away = np.sqrt(np.maximum((offset * offset).sum(axis=-1) - height**2, 0.0))
        away = away - self.radius_mm
        if self.kind == "cylinder":
            return np.asarray(away)
        if self.kind == "cone":
            return np.asarray(
                away * np.cos(self.half_angle_rad) - height * np.sin(self.half_angle_rad)
            )
        return np.asarray(np.hypot(away, height) - self.minor_radius_mm)

    def directions(self, points: Array) -> Array:
        """Return unit normals (..., 3) at points, away from the axis or centre."""
        if self.kind == "plane":
            return np.broadcast_to(self.axis, points.shape)
        offset = points - self.centre_mm
        if self.kind == "sphere":
            return unit(offset)
        height = (offset @ self.axis)[..., None]
        radial = unit(offset - height * self.axis)
        if self.kind == "cylinder":
            return radial
        if self.kind == "cone":
            return np.asarray(
                radial * np.cos(self.half_angle_rad) - self.axis * np.sin(self.half_angle_rad)
            )
        return unit(offset - radial * self.radius_mm)


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """What is known of a piece of surface: corners (n, 3) and facets (m, 3) with areas (m,)."""

    points: Array
    normals: Array
    centres: Array
    areas: Array

    def thinned(self) -> "Cloud":
        """Return every so-many-th point and facet, few enough for a quick fit."""
        i = max(1, len(self.points) // FIT_POINTS)
        k = max(1, len(self.normals) // FIT_POINTS)
        return Cloud(self.points[::i], self.normals[::k], self.centres[::k], self.areas[::k])


def fits(cloud: Cloud) -> Iterator[Primitive]:
    """Yield the surfaces that may be meant by a cloud, the simplest kinds first."""
    cloud = cloud.thinned()
    plane = _plane(cloud)
    yield plane
    shares = cloud.areas / max(float(cloud.areas.sum()), 1e-300)
    about_zero = (cloud.normals * shares[:, None]).T @ cloud.normals
    spread, vectors = np.linalg.eigh(about_zero)
    if spread[1] < 1e-7:
        return  # one direction only: nothing but a plane
    if spread[0] < 0.02:
        found = _cylinder(cloud, vectors[:, 0])
        if found is not None:
            yield found
    found = _cone(cloud, shares)
    if found is not None:
        yield found  # before balls: both rings of a short cone lie on one as well
    if spread[0] < FLAT_SPREAD:
        return  # two rings of strips lie on a ball, too, but nothing says they are one
    found = _sphere(cloud.points)
    if found is not None:
        yield found
    found = _torus(cloud)
    if found is not None:
        yield found


def _plane(cloud: Cloud) -> Primitive:
    middle = cloud.points.mean(axis=0)
    centred = cloud.points - middle
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    mean = (cloud.normals * cloud.areas[:, None]).sum(axis=0)
    return Primitive("plane", middle, normal if normal @ mean >= 0 else -normal)


def _basis(axis: Array) -> tuple[Array, Array]:
    """Return two directions that make a right-handed frame with an axis."""
    x, y, z = axis.tolist()
    if abs(z) < 0.9:
        one = np.array([-y, x, 0.0]) / np.hypot(x, y)
    else:
        one = np.array([0.0, -z, y]) / np.hypot(y, z)
    a, b, c = one.tolist()
    return one, np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def _cylinder(cloud: Cloud, axis: Array) -> Primitive | None:
    one, two = _basis(axis)
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
    return refined(Primitive("cylinder", centre, axis, float(np.sqrt(square))), cloud.points)


def _sphere(points: Array) -> Primitive | None:
    middle = points.mean(axis=0)
    p = points - middle
    system = np.column_stack([2 * p, np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(system, (p**2).sum(axis=1), rcond=1e-9)
    square = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or not square > 0:
        return None
    return Primitive("sphere", middle + solution[:3], NO_DIRECTION, float(np.sqrt(square)))


def _cone(cloud: Cloud, shares: Array) -> Primitive | None:
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
    if not LEAST_HALF_ANGLE_RAD < half < LARGEST_HALF_ANGLE_RAD:
        return None
    middle = apex + axis * float(height.mean())
    guess = Primitive("cone", middle, axis, float(away.mean()), 0.0, half)
    found = refined(guess, cloud.points)
    if not LEAST_HALF_ANGLE_RAD < abs(found.half_angle_rad) < LARGEST_HALF_ANGLE_RAD:
        return None
    if found.half_angle_rad < 0:
        found = replace(found, axis=-found.axis, half_angle_rad=-found.half_angle_rad)
    return found


def _torus(cloud: Cloud) -> Primitive | None:
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
        found = refined(guess, cloud.points)
        error = float(np.abs(found.distances(cloud.points)).max())
        is_ring = found.radius_mm > LEAST_HOLE * found.minor_radius_mm > 0
        if is_ring and error < best_error:
            best, best_error = found, error
    return best


def refined(guess: Primitive, points: Array) -> Primitive:
    """Return the surface moved, turned and resized to fit points (n, 3) in the least squares."""
    if guess.kind == "sphere":
        return _sphere(points) or guess  # linear: no rounds needed
    best, residual = guess, guess.distances(points)
    best_cost, damping = float(residual @ residual), 1e-6
    scale = max(float((points.max(axis=0) - points.min(axis=0)).max()), 1e-9)
    for _ in range(ROUNDS):
        if best_cost < len(points) * (EXACT * scale) ** 2:
            break
        one, two = _basis(best.axis)
        jacobian = _jacobian(best, (points - best.centre_mm) @ np.stack([one, two, best.axis]).T)
        jacobian[:, 2:4] /= scale
        if best.kind == "cone":
            jacobian[:, 5] /= scale
        normal = jacobian.T @ jacobian
        system = normal + damping * max(float(np.trace(normal)), 1e-12) * np.eye(len(normal))
        try:
            step: Array = -np.linalg.solve(system, jacobian.T @ residual).astype(np.float64)
        except np.linalg.LinAlgError:
            break  # too few points for this kind
        tilt = one * step[3] - two * step[2]
        trial = _moved(best, one * step[0] + two * step[1], tilt / scale, step[4:], scale)
        trial_residual = trial.distances(points)
        cost = float(trial_residual @ trial_residual)
        if cost < best_cost:
            done = best_cost - cost < SETTLED * best_cost
            best, residual, best_cost, damping = trial, trial_residual, cost, damping / 10
            if done:
                break
        else:
            damping = damping * 100 + 1e-9
            if damping > 1e3:
                break
    return best


def _jacobian(surface: Primitive, local: Array) -> Array:
    """Return how distances (n,) change: with the centre across, turns about it, and sizes.

    ``local`` (n, 3) are the points seen from the centre, along two directions across and the axis.
    """
    x, y, height = local.T
    away = np.hypot(x, y)
    safe = np.maximum(away, 1e-12)
    if surface.kind == "torus":
        tube = np.maximum(np.hypot(away - surface.radius_mm, height), 1e-12)
        part_r, part_h = (away - surface.radius_mm) / tube, height / tube
        sizes = [-part_r, -np.ones(len(x)), -part_h]
    elif surface.kind == "cone":
        part_r = np.full(len(x), np.cos(surface.half_angle_rad))
        part_h = np.full(len(x), -np.sin(surface.half_angle_rad))
        # along its axis a cone's centre may be anywhere, so it stays
        sizes = [-part_r, part_h * (away - surface.radius_mm) - part_r * height]
    else:
        part_r, part_h = np.ones(len(x)), np.zeros(len(x))
        sizes = [-part_r]
    gx, gy = part_r * x / safe, part_r * y / safe
    # turning the axis moves points the other way round, as seen from it
    return np.column_stack([-gx, -gy, height * gy - y * part_h, x * part_h - height * gx, *sizes])


def _moved(surface: Primitive, across: Array, tilt: Array, sizes: Array, scale: float) -> Primitive:
    axis = unit(surface.axis + tilt)
    centre, radius = surface.centre_mm + across, surface.radius_mm + float(sizes[0])
    moved = replace(surface, centre_mm=centre, axis=axis, radius_mm=radius)
    if surface.kind == "torus":
        return replace(
            moved,
            centre_mm=centre + surface.axis * sizes[2],
            minor_radius_mm=surface.minor_radius_mm + float(sizes[1]),
        )
    if surface.kind == "cone":
        return replace(moved, half_angle_rad=surface.half_angle_rad + float(sizes[1]) / scale)
    return moved
