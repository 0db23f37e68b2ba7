"""A block with bores, pocket and boss in a gripper before an inspection camera, for the tests."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import trimesh
from cad_solids import Body, box, mesh_of, rod, solid_of
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray

from controller.cad import Solid, SurfaceSamples, sample_surface
from controller.imaging import Camera, PointLamp
from controller.inspection import InspectionLimits, PosedPart, ViewPictures, ViewTask, WorldBox

Array = NDArray[np.float64]
LIMITS = InspectionLimits()
# camera 700 mm in front of the station, looking along +y; 0.19 mm to a pixel
CAMERA = Camera(
    (640, 512),
    np.array([[3733.0, 0, 319.5], [0, 3733.0, 255.5], [0, 0, 1]]),
    np.array([-0.05, 0.03, -0.0003, 0.0002, 0.0]),
    np.array([[1.0, 0, 0, 0], [0, 0, 1, -700], [0, -1, 0, 0], [0, 0, 0, 1]]),
)
PANEL = np.array([[-175.0, 250, -145], [175, 250, -145], [175, 250, 145], [-175, 250, 145]])
LAMPS = (
    PointLamp.ring("ring", np.array([0.0, -690, 0]), np.array([0.0, 1, 0]), 60.0, count=2),
    PointLamp("side", np.array([[-470.0, -620, 370]])),
)
# part frame -> world: part z towards the camera, part y up
FRONT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def blank() -> Body:
    return box(46, 34, 24)


def boss() -> Body:
    return rod(6, 8, 48).translate((12, 8, 14))


def bore() -> Body:
    return rod(5, 40, 48).translate((-11, 3, 0))


def cross_bore() -> Body:
    return rod(3, 60, 32).rotate((0, 90, 0)).translate((0, -9, -4))


def pocket() -> Body:
    return box(16, 10, 12).translate((8, -9, 12))


def perfect() -> Body:
    return (blank() + boss()) - bore() - cross_bore() - pocket()


@cache
def solid() -> Solid:
    return solid_of(perfect(), "shown")


@cache
def part() -> PosedPart:
    return PosedPart(solid())


@cache
def samples() -> SurfaceSamples:
    return sample_surface(solid())


def face_id(kind: str, at: tuple[float, float, float]) -> int:
    """The surface of a kind whose centre is nearest to a point of the CAD frame."""
    faces = [f for f in solid().faces if f.kind == kind]
    return min(faces, key=lambda f: float(np.linalg.norm(f.centre_mm - np.array(at)))).id


def shown(turn_deg: float = 0.0, tilt_deg: float = 0.0, spin_deg: float = 0.0) -> Array:
    """T_world_part with the part at the station: spun about its z, then turned and tilted."""
    T = np.eye(4)
    spin, turn, tilt = (
        cv2.Rodrigues(np.radians(angle) * np.array(axis))[0]
        for angle, axis in (
            (spin_deg, (0.0, 0, 1)),
            (turn_deg, (0.0, 0, 1)),
            (tilt_deg, (1.0, 0, 0)),
        )
    )
    T[:3, :3] = turn @ tilt @ FRONT @ spin
    T[:3, 3] = -T[:3, :3] @ solid().centroid_mm
    return T


def moved(T: Array, shift_mm: tuple[float, float, float], turn_deg: float) -> Array:
    """The same pose, slipped in the jaws."""
    slip = np.eye(4)
    slip[:3, :3] = cv2.Rodrigues(np.radians(turn_deg) * np.array([0.3, 0.9, 0.3]))[0]
    slip[:3, 3] = shift_mm
    return slip @ T


def hand(T_world_part: Array) -> tuple[WorldBox, ...]:
    """Two fingers on the part's x sides and a palm, from above, 12 mm of the part between them."""
    boxes = []
    for x, y, z, half in (
        (27.0, 44.0, 0.0, (4.0, 39.0, 6.0)),
        (-27.0, 44.0, 0.0, (4.0, 39.0, 6.0)),
        (0.0, 115.0, 0.0, (50.0, 32.0, 22.0)),
    ):
        T = np.eye(4)
        T[:3, 3] = x, y, z
        boxes.append(WorldBox(T_world_part @ T, np.array(half)))
    return tuple(boxes)


def task(T: Array, holder: tuple[WorldBox, ...] | None = None, view_id: str = "v1") -> ViewTask:
    return ViewTask(
        view_id=view_id,
        camera=CAMERA,
        T_world_part_expected=T,
        holder=hand(T) if holder is None else holder,
        panel_mm=PANEL,
        lamps=LAMPS,
        limits=LIMITS,
    )


def photograph(
    body: Body, T: Array, holder: tuple[WorldBox, ...], lamps: tuple[PointLamp, ...] = LAMPS
) -> ViewPictures:
    """Pictures of a real body at a true pose, before the panel and under lamps."""
    others = [trimesh.creation.box(extents=2 * b.half_mm, transform=b.T) for b in holder]
    scene = Scene(
        placed(mesh_of(body), T), trimesh.util.concatenate(others) if others else None, PANEL
    )
    shots = Renderer(scene, CAMERA)
    return ViewPictures(backlit=shots.backlit(), lit={lamp.name: shots.lit(lamp) for lamp in lamps})
