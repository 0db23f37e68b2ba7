"""Bodies of revolution that roll on two rims: each band is one pose, with paper's probability."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from cad_solids import Body, box, solid_of

from controller.cad import RollingFamily, Solid, find_resting

Corner = tuple[float, float]  # along the axis and off it [mm]


def turned(*steps: tuple[float, float, float, int, float]) -> Solid:
    """Cones set end to end: length, radius below and above, corners, turn of the corners [deg]."""
    body, z = Body(), 0.0
    for length, low, high, segments, turn_deg in steps:
        cone = Body.cylinder(length, low, high, segments).rotate([0.0, 0.0, turn_deg])
        body, z = body + cone.translate([0.0, 0.0, z]), z + length
    return solid_of(body)


def band_share(centre_mm: float, a: Corner, b: Corner) -> float:
    """Share of the sphere round a point of the axis that lies between two rims."""
    cosines = [(z - centre_mm) / float(np.hypot(z - centre_mm, r)) for z, r in (a, b)]
    return abs(cosines[0] - cosines[1]) / 2


def only_family(solid: Solid) -> RollingFamily:
    resting = find_resting(solid)
    (family,) = resting.families
    assert sum(pose.rolling for pose in resting.poses) == 1
    return family


@pytest.mark.parametrize("segments", [16, 40, 48, 96])
def test_a_bobbin_rolls_on_both_rims_as_one_pose_however_they_are_divided(segments: int) -> None:
    solid = turned((4, 20, 20, 64, 0), (32, 6, 6, 32, 0), (4, 20, 20, segments, 1.3))
    family = only_family(solid)
    assert family.kind == "cylinder"
    assert family.arc_rad == pytest.approx(2 * np.pi)
    middle = float(solid.centroid_mm[2])
    expected = band_share(middle, (0.0, 20.0), (40.0, 20.0))
    # a rim of 16 corners is up to 2 % nearer to the axis than its circle
    assert family.probability == pytest.approx(expected, abs=0.012)


def test_a_spindle_rolls_on_either_cone() -> None:
    # its cones meet in a rim that either divides in its own way
    solid = turned((25, 3, 15, 48, 0), (40, 15, 2, 36, 2.2))
    resting = find_resting(solid)
    middle = float(solid.centroid_mm[2])
    rims = [(0.0, 3.0), (25.0, 15.0), (65.0, 2.0)]
    expected = [band_share(middle, *pair) for pair in pairwise(rims)]
    found = sorted(family.probability for family in resting.families)
    assert len(resting.families) == 2
    assert found == pytest.approx(sorted(expected), abs=0.01)


def test_a_step_is_rolled_over_on_its_corner_and_the_rim_beyond() -> None:
    solid = turned((20, 20, 20, 64, 0), (60, 12, 12, 36, 2))
    family = only_family(solid)
    middle = float(solid.centroid_mm[2])
    # the wall of 20 mm does not hold the centre, which stands beyond it, and tips to the step
    assert middle > 20
    expected = band_share(middle, (0.0, 20.0), (20.0, 20.0))
    expected += band_share(middle, (20.0, 20.0), (80.0, 12.0))
    assert family.kind == "cone"
    assert family.probability == pytest.approx(expected, abs=0.01)
    lean = np.arctan2(20 - 12, 60)
    assert family.downs @ family.axis == pytest.approx(
        np.full(len(family.downs), np.sin(lean)), abs=0.01
    )


def test_a_chamfer_beside_the_band_changes_nothing() -> None:
    # the chamfer of 30 degrees is near enough to the wall to look like a part of one curve
    chamfer = (14.0, 20.0, 28.0, 90, 0.0)
    solid = turned(chamfer, (120, 28, 40, 144, 0.7), (20, 40, 40, 144, 0.0))
    families = find_resting(solid).families
    assert len(families) == 1
    assert families[0].arc_rad == pytest.approx(2 * np.pi)


def test_two_bands_at_a_blunt_angle_are_two_poses() -> None:
    # the walls differ by 20 degrees; tipping from the one to the other lifts the centre by 0.5 mm
    tilt = np.tan(np.radians(10.0))
    solid = turned((20, 20 - 20 * tilt, 20, 72, 0), (20, 20, 20 - 20 * tilt, 72, 0))
    families = find_resting(solid).families
    assert len(families) == 2
    assert families[0].probability == pytest.approx(families[1].probability, abs=1e-6)


@pytest.mark.parametrize("corners", [6, 8])
def test_prisms_end_to_end_lie_on_their_sides(corners: int) -> None:
    solid = turned((4, 10, 10, corners, 0), (26, 6, 6, corners, 0), (4, 8, 8, corners, 0))
    resting = find_resting(solid)
    assert not resting.families
    assert len(resting.poses) == corners + 2


def test_a_bobbin_cut_along_its_axis_rocks_on_what_is_left_of_its_rims() -> None:
    body = Body.cylinder(4, 20, 20, 64) + Body.cylinder(40, 6, 6, 32)
    body += Body.cylinder(4, 20, 20, 48).rotate([0.0, 0.0, 1.3]).translate([0.0, 0.0, 36.0])
    resting = find_resting(solid_of(body - box(100, 100, 100).translate((0, 55, 0))))
    (round_side,) = (pose for pose in resting.poses if pose.rocking)
    assert not resting.families
    assert -round_side.R[2] @ np.array([0.0, -1.0, 0.0]) > np.cos(np.radians(1.0))
