"""The scene before the cameras: triangles with materials, some fixed and some moving.

The picture process gets this description once, and poses with every order.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...chain import TCP
from ...layout import CameraLayout, LampLayout, Layout
from ...matter.grasp import make_gripper
from ...matter.solid import Solid
from ...shapes import Array, Box

Faces = NDArray[np.int32]

CREASE_COS: Final = 0.9  # facets of one curved face meet at less than 25 degrees
_TABLE_MM: Final = (-700.0, 1100.0, -1100.0, 900.0)  # the plate: from x to x, from y to y
_TRAY_HEIGHT_MM: Final = 0.5


@dataclass(frozen=True, slots=True)
class Material:
    """The reflection of a surface.

    Attributes
    ----------
    albedo : albedo of its diffuse part
    gloss : height of its highlight, and ``shine`` its exponent (Blinn)
    """

    albedo: float
    gloss: float = 0.0
    shine: float = 20.0


MACHINED: Final = Material(albedo=0.60, gloss=0.18, shine=24.0)
PAINTED: Final = Material(albedo=0.12, gloss=0.03)
STEEL: Final = Material(albedo=0.22, gloss=0.08)
TABLE: Final = Material(albedo=0.18)
OPAL: Final = Material(albedo=0.20)  # a backlight panel that is off
TRAY: Final = Material(albedo=0.30)
PAPER: Final = Material(albedo=0.80)  # matt, as boards must be
INK: Final = Material(albedo=0.04)
MACHINED_PART: Final = 0  # number in MATERIALS of the parts' material
MATERIALS: Final = (MACHINED, PAINTED, STEEL, TABLE, OPAL, TRAY, PAPER, INK)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles of one rigid thing.

    Attributes
    ----------
    name : name of the pose that moves it; empty if it does not move
    vertices_mm, faces : in its own frame
    normals : (m, 3, 3) at the corners of each face, smooth across curved faces
    material : (m,) index into ``materials``
    panel : (m,) number of the lamp whose backlight panel is there, -1 for none
    """

    name: str
    vertices_mm: Array
    faces: Faces
    normals: NDArray[np.float32]
    material: NDArray[np.int16]
    panel: NDArray[np.int16]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The cell for the computation of light.

    Attributes
    ----------
    fixed : static solids; ``owner`` names the layout box of each of its triangles
    aims_mm : (lamps, 3) target point of each lamp
    finish_seed : finish seed of the marks on machined parts; None: their surfaces are plain
    """

    cameras: tuple[CameraLayout, ...]
    lamps: tuple[LampLayout, ...]
    aims_mm: Array
    materials: tuple[Material, ...]
    fixed: Surface
    owner_boxes: tuple[Box, ...]
    owner: NDArray[np.int16]
    moving: tuple[Surface, ...]
    finish_seed: int | None = None

    def with_mover(self, surface: Surface) -> "Scene":
        """Return the scene with one more thing that moves, in place of one of its name."""
        others = (one for one in self.moving if one.name != surface.name)
        return replace(self, moving=(*others, surface))


def build_scene(layout: Layout, solids: Sequence[Solid], finish_seed: int | None = None) -> Scene:
    """Return the cell's scene; parts are called ``part 0`` and so on, as in a snapshot.

    Parameters
    ----------
    layout : layout of the cell
    solids : solids of the parts
    finish_seed : finish seed of the marks on machined parts; None: their surfaces are plain
    """
    lamps = tuple(layout.lamps.values())
    fixed, owner_boxes, owner = _fixed(layout, lamps)
    links = layout.arm.chain.links
    moving = [_boxes(link.name, link.boxes, 1) for link in links if link.boxes]
    moving.append(_boxes(TCP, layout.arm.gripper.boxes, 1))
    for name, gripper in (("arm", layout.arm.gripper), ("fixture", layout.fixed_gripper)):
        for box in make_gripper(name, gripper, gripper.jaw_max_mm).finger_boxes:
            moving.append(_boxes(box.name, (box,), 2))
    for index, solid in enumerate(solids):
        moving.append(part_surface(f"part {index}", solid))
    drop_middle = (layout.drop_low_mm + layout.drop_high_mm) / 2.0
    table_mm = np.array((drop_middle[0], drop_middle[1], 0.0))
    aims = [layout.station_mm if lamp.name.startswith("station") else table_mm for lamp in lamps]
    return Scene(
        cameras=tuple(layout.cameras.values()),
        lamps=lamps,
        aims_mm=np.array(aims),
        materials=MATERIALS,
        fixed=fixed,
        owner_boxes=owner_boxes,
        owner=owner,
        moving=tuple(moving),
        finish_seed=finish_seed,
    )


def part_surface(name: str, solid: Solid) -> Surface:
    """Return the visible surface of a part.

    Parameters
    ----------
    name : name of the pose that moves it
    solid : its exact mesh
    """
    return _surface(name, solid.vertices_mm, solid.faces, MACHINED_PART, smooth=True)


def panel_frame(lamp: LampLayout) -> Array:
    """Return the pose of a panel: x across, y along ``up``, z out of its light; (4, 4) mm."""
    T = np.eye(4)
    T[:3, 2], T[:3, 1] = lamp.normal, lamp.up
    T[:3, 0] = np.cross(lamp.up, lamp.normal)
    T[:3, 3] = lamp.centre_mm
    return T


def _fixed(
    layout: Layout, lamps: Sequence[LampLayout]
) -> tuple[Surface, tuple[Box, ...], NDArray[np.int16]]:
    pieces: list[Surface] = []
    boxes, placed = [layout.post, *layout.obstacles], []
    arm = layout.arm
    if np.array_equal(arm.T_world_column, np.eye(4)):
        boxes.insert(0, arm.column)
    else:
        placed.append((arm.column, arm.T_world_column))
    for box in boxes:
        pieces.append(_boxes("", (box,), 1))
    owner = [np.full(len(piece.faces), i) for i, piece in enumerate(pieces)]
    placed += [(box, layout.fixed_gripper.T_world_tcp) for box in layout.fixed_gripper.boxes]
    placed += [(one.box, one.T_world_box) for one in layout.chute]
    for box, T in placed:
        body = _boxes("", (box,), 1)
        pieces.append(
            _surface("", body.vertices_mm @ T[:3, :3].T + T[:3, 3], body.faces, 1, smooth=False)
        )
    for tray in layout.trays:
        low = np.append(tray.centre_mm - tray.size_mm / 2.0, -1.0)
        high = np.append(tray.centre_mm + tray.size_mm / 2.0, _TRAY_HEIGHT_MM)
        pieces.append(_boxes("", (Box(tray.name, low, high),), 5))
    holes = []
    for number, lamp in enumerate(lamps):
        if lamp.kind != "panel":
            continue
        corners = _panel_corners(lamp)
        pieces.append(_quad(corners, 4, number))
        if abs(lamp.normal[2]) > 0.99 and abs(lamp.centre_mm[2]) < 5.0:
            holes.append((corners.min(axis=0), corners.max(axis=0)))
    pieces += [_quad(corners, 3, -1) for corners in _table(holes)]
    owner += [np.full(len(piece.faces), -1) for piece in pieces[len(boxes) :]]
    return join_surfaces(pieces), tuple(boxes), np.concatenate(owner).astype(np.int16)


def _panel_corners(lamp: LampLayout) -> Array:
    T = panel_frame(lamp)
    w, h = lamp.size_mm[0] / 2.0, lamp.size_mm[1] / 2.0
    local = np.array(((-w, -h, 0.0), (w, -h, 0.0), (w, h, 0.0), (-w, h, 0.0)))
    corners: Array = local @ T[:3, :3].T + T[:3, 3]
    return corners


def _table(holes: Sequence[tuple[Array, Array]]) -> list[Array]:
    """Return the table's plate as rectangles that leave out one backlit window."""
    x0, x1, y0, y1 = _TABLE_MM
    if not holes:
        return [_rectangle(x0, x1, y0, y1)]
    (a, c, _), (b, d, _) = holes[0]
    return [
        _rectangle(x0, a, y0, y1),
        _rectangle(b, x1, y0, y1),
        _rectangle(a, b, y0, c),
        _rectangle(a, b, d, y1),
    ]


def _rectangle(x0: float, x1: float, y0: float, y1: float) -> Array:
    return np.array(((x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0)))


def _quad(corners_mm: Array, material: int, panel: int) -> Surface:
    faces = np.array(((0, 1, 2), (0, 2, 3)), dtype=np.int32)
    return _surface("", corners_mm, faces, material, smooth=False, panel=panel)


def _boxes(name: str, boxes: Sequence[Box], material: int) -> Surface:
    corners = np.array(list(itertools.product((0, 1), repeat=3)), dtype=float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    vertices = [box.low_mm + corners * (box.high_mm - box.low_mm) for box in boxes]
    faces = np.vstack([triangles + 8 * i for i in range(len(boxes))])
    return _surface(name, np.vstack(vertices), faces, material, smooth=False)


def _surface(
    name: str, vertices_mm: Array, faces: Faces, material: int, *, smooth: bool, panel: int = -1
) -> Surface:
    return Surface(
        name,
        vertices_mm,
        faces,
        corner_normals(vertices_mm, faces, smooth=smooth),
        np.full(len(faces), material, np.int16),
        np.full(len(faces), panel, np.int16),
    )


def join_surfaces(pieces: Sequence[Surface], name: str = "") -> Surface:
    """Return surfaces as one.

    Parameters
    ----------
    pieces : in one frame
    name : name of the pose that moves it; empty if it does not move
    """
    starts = np.cumsum([0] + [len(piece.vertices_mm) for piece in pieces])
    return Surface(
        name,
        np.vstack([piece.vertices_mm for piece in pieces]),
        np.vstack([p.faces + s for p, s in zip(pieces, starts, strict=False)]).astype(np.int32),
        np.concatenate([piece.normals for piece in pieces]),
        np.concatenate([piece.material for piece in pieces]),
        np.concatenate([piece.panel for piece in pieces]),
    )


def corner_normals(vertices_mm: Array, faces: Faces, *, smooth: bool) -> NDArray[np.float32]:
    """Return normals at the corners of triangles, (m, 3, 3), averaged where facets nearly agree.

    Parameters
    ----------
    vertices_mm : (n, 3) corners
    faces : (m, 3) numbers of the corners of each triangle
    smooth : average over the facets that meet at a corner within the crease angle; else each
        triangle is flat
    """
    a, b, c = (vertices_mm[faces[:, i]] for i in range(3))
    weighted = np.cross(b - a, c - a)
    normals = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-12)
    corners = np.repeat(normals[:, None], 3, axis=1)
    if smooth:
        vertex = faces.ravel()
        order = np.argsort(vertex, kind="stable")
        count = np.bincount(vertex, minlength=len(vertices_mm))
        first = np.concatenate(([0], np.cumsum(count)))
        mates = count[vertex]
        corner = np.repeat(np.arange(len(vertex)), mates)
        within = np.arange(mates.sum()) - np.repeat(np.cumsum(mates) - mates, mates)
        mate = order[first[vertex[corner]] + within] // 3
        agree = np.einsum("ij,ij->i", normals[corner // 3], normals[mate]) > CREASE_COS
        total = np.zeros((len(vertex), 3))
        np.add.at(total, corner[agree], weighted[mate[agree]])
        total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
        corners = total.reshape(-1, 3, 3)
    return corners.astype(np.float32)
