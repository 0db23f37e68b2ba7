"""Impossible parts and cells, each for one reason that their sizes make plain by hand."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
from cad_solids import Body, box, prism, rod, solid_of
from numpy.typing import NDArray
from planning_cell import emulated_layout

from controller.cad import Solid
from controller.planning import Box, CellLayout

Array = NDArray[np.float64]
LAYOUT = emulated_layout()
AWAY = np.array([[1500.0, 1501.0], [0.0, 1.0]])  # a place to set down where the arm never comes


# ---- parts ---------------------------------------------------------------------------------------
def tetrahedron(edge_mm: float = 50.0) -> Solid:
    """Two of its faces make 70.53 degrees: pads between them stand 35.26 degrees to each."""
    s = edge_mm / np.sqrt(8.0)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * s
    return solid_of(Body.hull_points(corners.tolist()), "tetrahedron")


def cone(radius_mm: float = 30.0, height_mm: float = 40.0) -> Solid:
    """Its wall leans by 36.87 degrees, and its base has only the tip opposite."""
    return solid_of(Body.cylinder(height_mm, radius_mm, 0.0, 96), "cone")


def wedge() -> Solid:
    """Three walls, no two of them parallel, between two triangles 40 mm apart."""
    return solid_of(prism([(0, 0), (60, 0), (0, 35)], 40.0), "wedge")


def cube(edge_mm: float = 100.0) -> Solid:
    return solid_of(box(edge_mm, edge_mm, edge_mm), "cube")


def block() -> Solid:
    """Good to hold in every way."""
    return solid_of(box(70.0, 40.0, 24.0), "block")


def ingot() -> Solid:
    """Of tungsten 13 kg, three times what the pads could hold."""
    return solid_of(box(120.0, 75.0, 75.0), "ingot")


def foil(thickness_mm: float = 1.5) -> Solid:
    """Lying, its edges give a pad 12 mm times its thickness."""
    return solid_of(box(60.0, 60.0, thickness_mm), "foil")


def bored(diameter_mm: float = 8.0, depth_mm: float = 36.0) -> Solid:
    """A blind bore along z: deeper than 2.75 diameters its wall is steeper than 70 degrees."""
    bore = rod(diameter_mm / 2, depth_mm).translate((0, 0, 20.0 - depth_mm / 2 + 0.001))
    return solid_of(box(50.0, 44.0, 40.0) - bore, "bored")


def bottle() -> Solid:
    """A chamber of 20 mm behind a neck of 6 mm: nobody ever sees its shoulder."""
    neck = rod(3.0, 21.0).translate((0, 0, 10.5))
    chamber = rod(10.0, 14.0).translate((0, 0, -7.0))
    return solid_of(box(50.0, 44.0, 40.0) - (neck + chamber), "bottle")


def tabbed() -> Solid:
    """A pyramid that slips out of any jaw, with a tab 13 mm wide to hold it by.

    Pads are 12 mm wide: whoever holds the tab covers its middle.
    """
    square = manifold3d.CrossSection([[(-30, -30), (30, -30), (30, 30), (-30, 30)]])
    pyramid = square.extrude(20.0, 0, 0.0, (1 / 3, 1 / 3))
    # its narrow sides lean by 36.9 degrees each way: a roof on a stem, too slanted for pads
    outline = [(-6.5, 0.0), (6.5, 0.0), (-4.0, 14.0)]
    slab = prism(outline, 8.0).rotate((90, 0, 0)).translate((0, 4.0, 19.0))
    return solid_of(pyramid + slab, "tabbed")


def two_tabs() -> Solid:
    """A long roof that slips out of any jaw, with a tab over its middle and one far out.

    Held by the far one it hangs on 70 mm of lever.
    """
    roof = prism([(-30, 0), (30, 0), (0, 22)], 200.0).rotate((90, 0, 90)).translate((-100, 0, 0))
    outline = [(-6.5, 0.0), (6.5, 0.0), (-4.0, 14.0)]
    slab = prism(outline, 8.0).rotate((90, 0, 0)).translate((0, 4.0, 20.0))
    return solid_of(roof + slab + slab.translate((70.0, 0, 0)), "two tabs")


def plate() -> Solid:
    return solid_of(box(72.0, 60.0, 12.0), "plate")


# ---- cells ---------------------------------------------------------------------------------------
def moved_station(x: float, y: float, z: float) -> CellLayout:
    """Station and camera moved together."""
    return looking_from(np.array([x, y, z]), np.array([0.0, -700.0, 0.0]))


def looking_from(station: Array, towards_camera: Array) -> CellLayout:
    """The station's camera looks at it from elsewhere; its housing moves along."""
    camera = LAYOUT.inspection
    z = -towards_camera / np.linalg.norm(towards_camera)
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = station + towards_camera
    obstacles = {
        name: box_
        for name, box_ in LAYOUT.obstacles.items()
        if name not in {"inspection camera", "station panel"}
    }
    return replace(
        LAYOUT,
        station_mm=station,
        inspection=replace(camera, T_world_cam=T),
        obstacles=obstacles,
    )


def overhead_station() -> CellLayout:
    """The camera looks down on the part: the hand, which never points up, stays between."""
    return looking_from(LAYOUT.station_mm, np.array([0.0, 0.0, 700.0]))


def without_fixture() -> CellLayout:
    """One gripper, and nowhere to put the part down."""
    return replace(LAYOUT, fixed_gripper=None, set_down_mm=AWAY)


def far_fixture() -> CellLayout:
    """The fixed gripper stands 1.5 m to the right, and there is nowhere to put the part down."""
    T = LAYOUT.T_world_fixed_tcp.copy()
    T[1, 3] -= 1200.0
    return replace(LAYOUT, T_world_fixed_tcp=T, set_down_mm=AWAY)


def far_tray() -> CellLayout:
    tray = replace(LAYOUT.trays["reject"], centre_mm=(-600.0, 700.0))
    return replace(LAYOUT, trays={**LAYOUT.trays, "reject": tray})


def walled_station() -> CellLayout:
    """Two posts, each side of the station, closer than the hand is wide; parts pass below them."""
    x, _, z = LAYOUT.station_mm
    posts = {
        f"{name} post": Box.from_bounds(x + a, x + a + 60, -200.0, 200.0, z - 20.0, z + 250.0)
        for name, a in (("near", -95.0), ("far", 35.0))
    }
    return replace(LAYOUT, obstacles={**LAYOUT.obstacles, **posts})


def long_lens() -> CellLayout:
    """A picture of 15 x 12 mm at the station."""
    camera = LAYOUT.inspection
    K = camera.K.copy()
    K[0, 0] = K[1, 1] = 60000.0
    return replace(LAYOUT, inspection=replace(camera, K=K, distortion=np.zeros(5)))


def weak_hand(force_n: float = 15.0) -> CellLayout:
    fixture = (
        None if LAYOUT.fixed_gripper is None else replace(LAYOUT.fixed_gripper, force_n=force_n)
    )
    return replace(
        LAYOUT, arm_gripper=replace(LAYOUT.arm_gripper, force_n=force_n), fixed_gripper=fixture
    )
