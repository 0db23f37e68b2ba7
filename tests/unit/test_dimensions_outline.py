"""Where a rim leaves the outline at a tangent: a peg whose pictures come from a formula.

A line of sight meets a peg where its stretch inside the endless cylinder and its stretch between
the two ends have a part in common.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import cv2
import numpy as np
import pytest
from cad_solids import solid_of
from manifold3d import CrossSection
from plate_pictures import PANEL, PART, SIZE_PX, asked, camera, pose, view

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import inverse_pose, transform
from controller.inspection import PosedPart, ViewPictures
from controller.inspection.characteristics import CharacteristicKind, Look, Rim, RimGeometry
from controller.inspection.dimensions import look

RADIUS_MM, CHAMFER_MM = 15.0, 0.8
# height and radius from end to end: a straight wall with a chamfer at its upper end
PROFILE_MM = ((-7.0, RADIUS_MM), (6.2, RADIUS_MM), (7.0, RADIUS_MM - CHAMFER_MM))
FINE = 3
PSF_PX = 0.7


def meets(T_world_part: FloatArray, pixels: FloatArray) -> BoolArray:
    """Whether lines of sight through pixels (n, 2) meet the peg."""
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera().position_mm[None])[0]
    d = camera().sight_lines(pixels) @ T_part_world[:3, :3].T
    answer = np.zeros(len(d), dtype=np.bool_)
    for (low, r_low), (high, r_high) in pairwise(PROFILE_MM):
        # in a slice of the peg, x² + y² - r(z)² along a line is a parabola, below 0 inside
        slope = (r_high - r_low) / (high - low)
        r, dr = r_low + slope * (eye[2] - low), slope * d[:, 2]
        a = d[:, 0] ** 2 + d[:, 1] ** 2 - dr**2
        b = d[:, :2] @ eye[:2] - r * dr
        c = eye[:2] @ eye[:2] - r**2
        one, other = (low - eye[2]) / d[:, 2], (high - eye[2]) / d[:, 2]
        lowest = np.clip(-b / a, np.minimum(one, other), np.maximum(one, other))
        least = np.min([a * t**2 + 2 * b * t + c for t in (one, other, lowest)], axis=0)
        answer |= least < 0
    return answer


@cache
def backlit(tilt_deg: float) -> Grey:
    width, height = SIZE_PX
    x, y = ((np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in SIZE_PX)
    at = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    is_part = meets(pose(tilt_deg, 20.0), at).reshape(height * FINE, width * FINE)
    levels = np.where(is_part, PART, PANEL).astype(np.float32)
    blurred = cv2.GaussianBlur(levels, (0, 0), PSF_PX * FINE)
    pixels = blurred.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    noise = np.random.default_rng(11).normal(0, 1.5, pixels.shape)
    return np.clip(np.round(pixels + noise), 0, 255).astype(np.uint8)


@cache
def peg() -> PosedPart:
    """The peg as a CAD file has it, in chords that are 0.06 mm high."""
    outline = [(0.0, -7.0), *((r, z) for z, r in PROFILE_MM), (0.0, 7.0)]
    return PosedPart(solid_of(CrossSection([outline]).revolve(36), "peg"))


def rims() -> tuple[Rim, Rim]:
    """The chamfer's rims: the wall's, and the upper end's."""
    faces = peg().solid.faces
    wall, cone = (next(f.id for f in faces if f.kind == kind) for kind in ("cylinder", "cone"))
    end = next(f.id for f in faces if f.kind == "plane" and f.normal[2] > 0.9)
    answer = []
    for (z, radius), beside in zip(PROFILE_MM[1:], ((wall, cone), (cone, end)), strict=True):
        answer.append(
            Rim(
                centre_mm=np.array([0.0, 0.0, z]),
                axis=np.array([0.0, 0.0, 1.0]),
                radius_mm=radius,
                start=np.array([1.0, 0.0, 0.0]),
                sweep_rad=2 * np.pi,
                wall=beside[0],
                beyond=beside[1],
                is_hole=False,
            )
        )
    return answer[0], answer[1]


def looks(tilt_deg: float, rim: Rim) -> list[Look]:
    """What a picture before the panel says of a rim's diameter and of its place."""
    T = pose(tilt_deg, 20.0)
    geometry = RimGeometry((rim,))
    wanted = [
        asked(CharacteristicKind.DIAMETER, geometry, 2 * rim.radius_mm, 1.5),
        asked(CharacteristicKind.POSITION, geometry, 0.0, 1.5),
    ]
    found = look(peg(), wanted, view(ViewPictures(backlit(tilt_deg), {}), T))
    return [one.look for estimates in found for one in estimates]


@pytest.mark.parametrize("tilt_deg", [40.0, 47.0, 55.0])
def test_a_rim_beside_which_the_next_ends_the_light_is_measured_where_it_is(
    tilt_deg: float,
) -> None:
    lower, upper = rims()
    for rim in (lower, upper):
        for one, true in zip(looks(tilt_deg, rim), (2 * rim.radius_mm, 0.0), strict=True):
            assert one.reason or abs(one.measured_mm - true) < 2 * one.u_mm < 0.3, one


def test_the_rim_whose_outline_it_is_has_a_value() -> None:
    lower, upper = rims()
    # from farther above the lower rim ends the light behind the peg, from farther aside the upper
    assert all(one.reason == "" for one in looks(40.0, lower))
    assert all("no edge of it" in one.reason for one in looks(40.0, upper))
    assert all(one.reason == "" for one in looks(55.0, upper))
