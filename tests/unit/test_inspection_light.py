"""Bounds of a lamp's light on a posed part: shadow borders, bounced light, highlights."""

from __future__ import annotations

from functools import cache

import numpy as np
from cad_solids import box, solid_of
from numpy.typing import NDArray
from shown_part import CAMERA, FRONT

from controller.cad import PointLamp, RayCaster, render_maps, view_roi
from controller.inspection._light import (
    ALBEDO,
    HIGHLIGHT_WIDTHS_RAD,
    Light,
    Surface,
    bound_light,
    find_surface,
)

STEP = 4
SIDE = PointLamp("side", np.array([[-470.0, -620, 370]]))
RING = PointLamp.ring("ring", np.array([0.0, -690, 0]), np.array([0.0, 1, 0]), 60.0)


@cache
def corner(lamp_name: str) -> tuple[Light, Surface, NDArray[np.float64]]:
    """A plate with a wall 20 mm high along its left side, seen from the front; part points too."""
    solid = solid_of(box(60, 60, 10) + box(8, 60, 30).translate((-26, 0, 10)))
    T = np.eye(4)
    T[:3, :3] = FRONT
    caster = RayCaster(solid.mesh)
    roi = view_roi(solid.mesh.vertices, T, CAMERA)
    assert roi is not None
    maps = render_maps(caster, T, CAMERA, roi, STEP)
    surface = find_surface(solid, maps, T, CAMERA, STEP)
    lamp = SIDE if lamp_name == "side" else RING
    light = bound_light(surface, caster, T, CAMERA, lamp, None)
    return light, surface, surface.points @ T[:3, :3]


def floor_between(lamp: str, x0: float, x1: float) -> tuple[Light, NDArray[np.bool_]]:
    """The light, and which pixels see the plate so far right of its middle [mm]."""
    light, surface, points = corner(lamp)
    here = np.zeros(surface.seen.shape, dtype=bool)
    x, y, z = points.T
    here[surface.seen] = (x > x0) & (x < x1) & (np.abs(y) < 20) & (np.abs(z - 5) < 0.1)
    assert here.sum() > 20
    return light, here


def test_the_bounds_hold_the_light_between_them() -> None:
    for lamp in ("side", "ring"):
        light, surface, _ = corner(lamp)
        assert (light.least <= light.most + 1e-6).all()
        assert (light.least <= light.open + 1e-6)[surface.seen].all()
        for dim, bright in light.glints:
            assert (dim <= bright + 1e-6).all()


def test_in_the_open_the_bounds_are_tight_and_nothing_bounces() -> None:
    light, here = floor_between("side", 18, 26)
    assert (light.most - light.least)[here].max() < 0.06
    assert light.least[here].min() > 0.4
    assert light.bounce[here].max() < 0.05


def test_behind_a_wall_it_is_dark_and_at_the_border_of_its_shadow_unknown() -> None:
    # the lamp stands 37 degrees to the left: 20 mm of wall throw a shadow of 13 to 15 mm
    light, here = floor_between("side", -21, -15)
    assert light.most[here].max() < 0.02
    light, here = floor_between("side", -9.5, -5.5)
    width = (light.most - light.least)[here]
    assert width.max() > 0.5
    assert (light.open[here] > 0.4).all()


def test_beside_a_wall_light_may_bounce_the_more_the_nearer() -> None:
    light, near = floor_between("ring", -21, -18)
    _, far = floor_between("ring", 5, 10)
    assert light.bounce[near].mean() > 2 * light.bounce[far].mean()
    # half the sky is wall at most, and no wall throws back more than it gets
    assert light.bounce.max() < 0.5 * ALBEDO * 1.2


def test_a_surface_square_to_camera_and_ring_lies_in_its_highlight() -> None:
    light, here = floor_between("ring", 5, 20)
    dim, bright = light.glints[-1]
    assert dim[here].min() > 0.9
    # the side lamp's mirror direction is far from the camera
    light, here = floor_between("side", 18, 26)
    _, bright = light.glints[0]
    assert bright[here].max() < 0.01
    assert len(light.glints) == len(HIGHLIGHT_WIDTHS_RAD)
