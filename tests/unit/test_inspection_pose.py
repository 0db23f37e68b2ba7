"""A pose that the outline leaves open: a turn of a round part about its axis."""

from __future__ import annotations

from functools import cache

import numpy as np
from cad_solids import Body, box, rod, solid_of
from numpy.typing import NDArray
from shown_part import FRONT, photograph, task

from controller.cad import SurfaceSamples, sample_surface
from controller.inspection import PosedPart, ViewResult, inspect_view
from controller.recognition.fitting import twist

Array = NDArray[np.float64]
TILT = twist(np.radians([12.0, 0.0, 7.0]), np.zeros(3), np.zeros(3))


def disc() -> Body:
    return rod(26, 14, 128)


def pockets() -> Body:
    """Blind, so that no light through them tells how the disc is turned."""
    return box(9, 9, 8).translate((17, 0, 7)) + box(7, 12, 8).translate((-10, 13, 7))


@cache
def part() -> PosedPart:
    solid = solid_of(disc() - pockets(), "disc")
    return PosedPart(solid)


@cache
def samples() -> SurfaceSamples:
    return sample_surface(part().solid)


def facing() -> Array:
    T = np.eye(4)
    T[:3, :3] = TILT[:3, :3] @ FRONT
    T[:3, 3] = -T[:3, :3] @ part().solid.centroid_mm
    return T


def turned(T: Array, deg: float) -> Array:
    """The pose with the disc turned about its own axis."""
    return T @ twist(np.radians([0.0, 0.0, deg]), np.zeros(3), np.zeros(3))


def look(body: Body, T_true: Array) -> ViewResult:
    pictures = photograph(body, T_true, ())
    return inspect_view(part(), samples(), task(facing(), holder=()), pictures)


def test_what_a_turn_that_the_outline_hides_explains_is_no_finding() -> None:
    # the pockets lie 1.5 mm, eight pixels, from where the outline's pose alone puts them
    T_true = turned(facing(), 5.0)
    result = look(disc() - pockets(), T_true)
    assert result.evaluated, result.reason
    assert result.findings == ()
    assert not result.failures


def test_a_pocket_that_is_missing_is_found_or_its_walls_are_not_compared() -> None:
    filled = disc() - box(7, 12, 8).translate((-10, 13, 7))
    result = look(filled, turned(facing(), 5.0))
    assert result.evaluated, result.reason
    at = np.array([17.0, 0.0, 7.0])
    if any(float(np.linalg.norm(f.p_part_mm - at)) < 7.0 for f in result.findings):
        return
    # its floor may look like the plane that is there; no wall does
    walls = [
        face.id
        for face in part().solid.faces
        if np.linalg.norm(face.centre_mm[:2] - at[:2]) < 5.0 and abs(face.normal[2]) < 0.5
    ]
    assert len(walls) == 4
    for wall in walls:
        assert result.compared[samples().face_ids == wall].mean() < 0.5


def test_light_through_a_slit_narrower_than_a_pixel_is_not_missed() -> None:
    body = box(44, 30, 12) - box(0.06, 24, 40)
    solid = solid_of(body, "slit")
    slit = PosedPart(solid)
    T = np.eye(4)
    T[:3, :3] = FRONT
    T[:3, 3] = -T[:3, :3] @ solid.centroid_mm
    pictures = photograph(body, T, ())
    result = inspect_view(slit, sample_surface(solid), task(T, holder=()), pictures)
    assert result.evaluated, result.reason
    assert result.findings == ()
