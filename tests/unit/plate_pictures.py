"""Pictures of a bored plate by formulas of their own: lines through two planes, without a mesh.

A line of sight gets through a straight bore exactly where it is inside the circle at both faces; it
misses the plate where it is outside the rectangle on the way between them. The lens has no
distortion; its blur is a Gaussian on a grid five times as fine as the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import manifold3d
import numpy as np
from cad_solids import Body, box, solid_of

from controller.arrays import FloatArray, Grey
from controller.cad import Solid
from controller.imaging import Camera
from controller.inspection import InspectionLimits, PosedPart, ViewPictures, ViewTask, WorldBox
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Rim,
    RimGeometry,
)
from controller.inspection.dimensions import PosedView

FOCAL_PX = 4200.0
DISTANCE_MM = 600.0
PIXEL_MM = DISTANCE_MM / FOCAL_PX
SIZE_PX = (640, 512)
FINE = 5
PANEL, PART = 210.0, 8.0
FACE, HOLE, GROUND = 170.0, 25.0, 12.0
HEIGHT_MM = 8.0


@dataclass(frozen=True)
class Bore:
    """A bore; of so many sides, corners on the circle and the first at `turn` of one, or round."""

    x: float
    y: float
    radius: float
    sides: int = 0
    turn: float = 0.0

    def is_inside(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return which points are in it."""
        far = np.hypot(x - self.x, y - self.y)
        if not self.sides:
            return far < self.radius
        half = np.pi / self.sides
        at = np.arctan2(y - self.y, x - self.x) - 2 * half * self.turn
        turn = np.mod(at, 2 * half) - half
        return far * np.cos(turn) < self.radius * np.cos(half)


@dataclass(frozen=True)
class Plate:
    """A plate from z = 0 to `HEIGHT_MM`, its middle at the origin."""

    length: float = 60.0
    width: float = 42.0
    bores: tuple[Bore, ...] = field(
        default=(Bore(0.0, 0.0, 9.0), Bore(20.0, 10.0, 4.0), Bore(-18.0, -9.0, 5.5))
    )

    def with_bore(self, index: int, **changes: float) -> Plate:
        bores = list(self.bores)
        bores[index] = replace(bores[index], **changes)
        return replace(self, bores=tuple(bores))


NOMINAL = Plate()


def camera() -> Camera:
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T_world_cam[2, 3] = DISTANCE_MM
    K = np.array([[FOCAL_PX, 0, 318.4], [0, FOCAL_PX, 257.9], [0, 0, 1.0]])
    return Camera(SIZE_PX, K, np.zeros(5), T_world_cam)


def pose(tilt_deg: float = 0.0, about_deg: float = 0.0, turn_deg: float = 7.0) -> FloatArray:
    """The plate tilted about an axis in the picture, after a turn about its own."""
    tilt, about, turn = np.radians([tilt_deg, about_deg, turn_deg])
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    spin = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(tilt * axis)[0] @ spin
    T[:3, 3] = [1.3, -0.8, 2.0]
    return T


def _met(
    plate: Plate, T: FloatArray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return of points of the picture whether light passes the plate there, and whether its top
    face is met first.
    """
    eye_cam = np.linalg.inv(T) @ np.array([0, 0, DISTANCE_MM, 1.0])
    u, v = (x - 318.4) / FOCAL_PX, (y - 257.9) / FOCAL_PX
    R = T[:3, :3].T
    # the camera looks down: x right, y down, z along the view
    d = [R[k, 0] * u - R[k, 1] * v - R[k, 2] for k in range(3)]
    eye = eye_cam[:3]
    top, bottom = ((h - eye[2]) / d[2] for h in (HEIGHT_MM, 0.0))
    if eye[2] < HEIGHT_MM:
        raise ValueError("the camera must be above the plate")
    at_top = eye[0] + top * d[0], eye[1] + top * d[1]
    at_bottom = eye[0] + bottom * d[0], eye[1] + bottom * d[1]
    # misses the box: slabs
    near, far = top, bottom
    for half, k in ((plate.length / 2, 0), (plate.width / 2, 1)):
        with np.errstate(divide="ignore"):
            one, other = (-half - eye[k]) / d[k], (half - eye[k]) / d[k]
        near = np.maximum(near, np.minimum(one, other))
        far = np.minimum(far, np.maximum(one, other))
    passes = near >= far
    into = np.zeros_like(passes)
    for bore in plate.bores:
        inside = [bore.is_inside(px, py) for px, py in (at_top, at_bottom)]
        passes |= inside[0] & inside[1]
        into |= inside[0]
    on_top = (np.abs(at_top[0]) < plate.length / 2) & (np.abs(at_top[1]) < plate.width / 2) & ~into
    return passes, on_top


def _hits(plate: Plate, T: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """Return what `_met` says of each fine pixel.

    A pixel is looked at finely if it or a neighbour has corners that differ: no edge is shorter.
    """
    width, height = SIZE_PX
    met = _met(plate, T, *np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5))
    differs = np.zeros((height, width), bool)
    for flags in met:
        for corner in (flags[1:, :-1], flags[:-1, 1:], flags[1:, 1:]):
            differs |= corner != flags[:-1, :-1]
    rows, columns = np.nonzero(cv2.dilate(differs.astype(np.uint8), np.ones((3, 3), np.uint8)))
    steps = (np.arange(FINE) + 0.5) / FINE - 0.5
    x = np.broadcast_to((columns[:, None] + steps)[:, None, :], (len(rows), FINE, FINE))
    y = np.broadcast_to((rows[:, None] + steps)[:, :, None], (len(rows), FINE, FINE))
    answer = []
    for flags, fine in zip(met, _met(plate, T, x, y), strict=True):
        whole = np.repeat(np.repeat(flags[:-1, :-1], FINE, axis=0), FINE, axis=1)
        whole.reshape(height, FINE, width, FINE)[rows, :, columns, :] = fine
        answer.append(whole)
    return answer[0], answer[1]


def _seen(levels: np.ndarray, psf: float, noise: float, seed: int) -> Grey:
    width, height = SIZE_PX
    blurred = cv2.GaussianBlur(levels.astype(np.float32), (0, 0), psf * FINE)
    pixels = blurred.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    noisy = pixels + np.random.default_rng(seed).normal(0, noise, pixels.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def pictures(
    plate: Plate, T: FloatArray, psf: float = 0.8, noise: float = 1.5, seed: int = 3
) -> ViewPictures:
    """A backlit picture, and one under a lamp that lights the top face alone."""
    passes, on_top = _hits(plate, T)
    backlit = np.where(passes, np.float32(PANEL), np.float32(PART))
    lit = np.where(on_top, np.float32(FACE), np.where(passes, np.float32(GROUND), np.float32(HOLE)))
    return ViewPictures(
        _seen(backlit, psf, noise, seed), {"ring": _seen(lit, psf, noise, seed + 1)}
    )


def view(
    shown: ViewPictures,
    T: FloatArray,
    view_id: str = "v00",
    holder: tuple[WorldBox, ...] = (),
    sigma: tuple[float, float] = (0.03, 0.0005),
    grasp: int = 0,
) -> PosedView:
    panel = np.array([[-400, -400, -60], [400, -400, -60], [400, 400, -60], [-400, 400, -60.0]])
    task = ViewTask(view_id, camera(), T, holder, panel, (), InspectionLimits())
    covariance = np.diag([sigma[0] ** 2] * 3 + [sigma[1] ** 2] * 3)
    return PosedView(task, shown, T, covariance, grasp)


def solid(plate: Plate = NOMINAL, sides: int = 256) -> Solid:
    body: Body = box(plate.length, plate.width, HEIGHT_MM).translate((0, 0, HEIGHT_MM / 2))
    for bore in plate.bores:
        cut = manifold3d.Manifold.cylinder(3 * HEIGHT_MM, bore.radius, bore.radius, sides, True)
        body = body - cut.translate((bore.x, bore.y, 0))
    return solid_of(body, "plate")


def part(plate: Plate = NOMINAL, sides: int = 256) -> PosedPart:
    return PosedPart(solid(plate, sides))


def rims(plate: Plate, index: int, body: Solid) -> tuple[Rim, ...]:
    """The upper and the lower rim of a bore."""
    bore = plate.bores[index]
    walls = [f for f in body.faces if f.kind == "cylinder"]
    wall = min(walls, key=lambda f: np.hypot(f.centre_mm[0] - bore.x, f.centre_mm[1] - bore.y)).id
    answer = []
    for z, up in ((HEIGHT_MM, 1.0), (0.0, -1.0)):
        beyond = next(f.id for f in body.faces if f.kind == "plane" and f.normal[2] * up > 0.9)
        answer.append(
            Rim(
                centre_mm=np.array([bore.x, bore.y, z]),
                axis=np.array([0.0, 0.0, up]),
                radius_mm=bore.radius,
                start=np.array([1.0, 0.0, 0.0]),
                sweep_rad=2 * np.pi,
                wall=wall,
                beyond=beyond,
                is_hole=True,
            )
        )
    return tuple(answer)


def asked(
    kind: CharacteristicKind,
    geometry: RimGeometry | EdgePairGeometry,
    nominal_mm: float,
    tolerance_mm: float = 0.2,
    *,
    is_critical: bool = False,
) -> Characteristic:
    is_place = kind is CharacteristicKind.POSITION
    return Characteristic(
        id=kind.value,
        balloon=1,
        kind=kind,
        label=kind.value,
        nominal_mm=nominal_mm,
        lower_mm=0.0 if is_place else nominal_mm - tolerance_mm,
        upper_mm=nominal_mm + tolerance_mm,
        source="test",
        geometry=geometry,
        faces=(),
        is_critical=is_critical,
    )


def length_edges(plate: Plate, body: Solid) -> EdgePairGeometry:
    """The two ends of the plate, by their upper and lower edges."""
    x, y = plate.length / 2, plate.width / 2
    ends = [
        next(f.id for f in body.faces if f.kind == "plane" and f.normal[0] * s > 0.9)
        for s in (-1, 1)
    ]
    flats = [
        next(f.id for f in body.faces if f.kind == "plane" and f.normal[2] * s > 0.9)
        for s in (1, -1)
    ]
    sides = []
    for sign, end in zip((-1, 1), ends, strict=True):
        sides.append(
            tuple(
                EdgeLine(np.array([sign * x, -y, z]), np.array([sign * x, y, z]), (end, flat))
                for z, flat in ((HEIGHT_MM, flats[0]), (0.0, flats[1]))
            )
        )
    return EdgePairGeometry(sides[0], sides[1], np.array([1.0, 0.0, 0.0]), ends[0], ends[1])
