"""Surfaces moved, turned and resized until they fit points in the least squares."""

import numpy as np

from controller.arrays import FloatArray

from .._types import NO_DIRECTION
from .primitives import Primitive

ROUNDS = 12  # Gauss-Newton doubles the right digits each round; from a fair guess five are enough
EXACT = 1e-7  # share of a cloud's size: single precision
SETTLED = 1e-3  # share of the squared misfit; a round that gains less is the last
FAR_OFF = 10.0  # in target misfits; beyond it each round must gain by `HOPELESS`
HOPELESS = 0.5  # each round has to halve the squared misfit, or the points lie on no such surface


def basis(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two directions that make a right-handed frame with an axis."""
    x, y, z = axis.tolist()
    if abs(z) < 0.9:
        length = float(np.hypot(x, y))
        a, b, c = -y / length, x / length, 0.0
    else:
        length = float(np.hypot(y, z))
        a, b, c = 0.0, -z / length, y / length
    return np.array([a, b, c]), np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def ball(points: FloatArray) -> Primitive | None:
    """Return the sphere nearest to points (n, 3); None if they lie in a plane."""
    middle = points.mean(axis=0)
    p = points - middle
    system = np.column_stack([2 * p, np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(system, (p**2).sum(axis=1), rcond=1e-9)
    square = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or not square > 0:
        return None
    return Primitive("sphere", middle + solution[:3], NO_DIRECTION, float(np.sqrt(square)))


class _Place:
    """A surface, points (n, 3) in its frame, and their distances from it (n,)."""

    def __init__(self, surface: Primitive, points: FloatArray) -> None:
        self.surface = surface
        self.frame = np.array([*basis(surface.axis), surface.axis])
        self.x, self.y, self.height = self.frame @ (points - surface.centre_mm).T
        self.away = np.hypot(self.x, self.y)
        self.off = self.away - surface.radius_mm
        self.residual = self.off
        if surface.kind == "cone":
            half = surface.half_angle_rad
            self.residual = self.off * np.cos(half) - self.height * np.sin(half)
        elif surface.kind == "torus":
            self.residual = np.hypot(self.off, self.height) - surface.minor_radius_mm
        self.cost = float(self.residual @ self.residual)

    def slopes(self, scale: float) -> FloatArray:
        """Return the derivatives of distances (n,) by the parameters, one row for each parameter.

        First the centre across, then turns about it, then sizes; all in units of length.
        """
        kind, safe = self.surface.kind, np.maximum(self.away, 1e-12)
        slopes = np.empty(({"cylinder": 5, "cone": 6, "torus": 7}[kind], len(safe)))
        if kind == "torus":
            tube = np.maximum(self.residual + self.surface.minor_radius_mm, 1e-12)
            part_r, part_h = self.off / tube, self.height / tube
            slopes[4], slopes[5], slopes[6] = -part_r, -1.0, -part_h
            gx, gy = part_r * self.x / safe, part_r * self.y / safe
            slopes[2] = self.height * gy - self.y * part_h
            slopes[3] = self.x * part_h - self.height * gx
        else:
            # along its axis a cone's centre may be anywhere, so it stays
            half = self.surface.half_angle_rad
            cos, sin = float(np.cos(half)), float(np.sin(half))
            gx, gy = cos * self.x / safe, cos * self.y / safe
            slopes[4] = -cos
            slopes[2], slopes[3] = self.height * gy, -self.height * gx
            if kind == "cone":
                slopes[5] = (-sin * self.off - cos * self.height) / scale
                slopes[2] += self.y * sin
                slopes[3] -= self.x * sin
        # turning the axis moves points the other way round, as seen from it
        slopes[0], slopes[1] = -gx, -gy
        slopes[2:4] /= scale
        return slopes

    def moved(self, step: list[float], scale: float) -> Primitive:
        """Return the surface with its parameters changed."""
        one, two, axis = self.frame
        surface = self.surface
        turned = axis + one * (step[3] / scale) - two * (step[2] / scale)
        turned /= np.sqrt(float(turned @ turned))
        centre = surface.centre_mm + one * step[0] + two * step[1]
        minor, half = surface.minor_radius_mm, surface.half_angle_rad
        if surface.kind == "torus":
            centre += axis * step[6]
            minor += step[5]
        elif surface.kind == "cone":
            half += step[5] / scale
        return Primitive(surface.kind, centre, turned, surface.radius_mm + step[4], minor, half)


def refined(guess: Primitive, points: FloatArray, aim_mm: float = 0.0) -> Primitive:
    """Return the surface moved, turned and resized to fit points (n, 3) in the least squares.

    Parameters
    ----------
    guess : start of the fit; its kind stays
    points : (n, 3) in the frame of the guess [mm]
    aim_mm : root mean square distance hoped for: a fit that stays far from it is given up early; 0
        for never
    """
    if guess.kind == "sphere":
        return ball(points) or guess  # linear: no rounds needed
    best, damping = _Place(guess, points), 1e-6
    scale = max(float((points.max(axis=0) - points.min(axis=0)).max()), 1e-9)
    for _ in range(ROUNDS):
        if best.cost < len(points) * (EXACT * scale) ** 2:
            break
        slopes = best.slopes(scale)
        system = slopes @ slopes.T
        diagonal = system.reshape(-1)[:: len(system) + 1]
        diagonal += damping * max(float(diagonal.sum()), 1e-12)
        try:
            step = -np.linalg.solve(system, slopes @ best.residual)
        except np.linalg.LinAlgError:
            break  # too few points for this kind
        trial = _Place(best.moved(step.tolist(), scale), points)
        if trial.cost < best.cost:
            gain = 1 - trial.cost / best.cost
            best, damping = trial, damping / 10
            far_off = aim_mm > 0 and best.cost > len(points) * (FAR_OFF * aim_mm) ** 2
            if gain < (HOPELESS if far_off else SETTLED):
                break
        else:
            damping = damping * 100 + 1e-9
            if damping > 1e3:
                break
    return best.surface
