"""The cell at one moment as bodies of triangles: boxes, table, trays, and the part's mesh."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from controller.arrays import FloatArray, IntArray
from controller.cad import Solid
from controller.imaging import RayCaster
from controller.planning import Box, CellLayout
from controller.planning.motion import Scene

from ..moments import Moment

# Red, green, blue, 0..255.
Colour = tuple[float, float, float]

# The table is drawn as a plate of this thickness, this much larger than what stands on it.
TABLE_MM = 18.0
TABLE_ROOM_MM = 60.0
THINNER_MM = 0.5
# Trays, and what the overhead camera sees, are drawn as plates of this thickness.
RIM_MM = 4.0

TABLE: Colour = (214, 209, 200)
SEEN_TABLE: Colour = (244, 242, 234)
ARM: Colour = (120, 140, 163)
ARM_GRIPPER: Colour = (86, 103, 125)
FINGER: Colour = (228, 150, 60)
FIXED_GRIPPER: Colour = (88, 132, 122)
FIXED_FINGER: Colour = (46, 168, 150)
CAMERA: Colour = (70, 70, 76)
OBSTACLE: Colour = (186, 188, 190)
PANEL: Colour = (236, 238, 226)
PART: Colour = (176, 184, 192)
TRAYS: dict[str, Colour] = {
    "accept": (150, 205, 170),
    "reject": (226, 160, 140),
    "quarantine": (234, 210, 130),
}
TRAY: Colour = (200, 200, 205)

GLOWING = (PANEL, SEEN_TABLE)

# Corners of a box as signs, and its twelve triangles, outwards.
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_TRIANGLES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class SceneBody:
    """A body of one colour, in the world; a lit one is evenly bright."""

    name: str
    colour: Colour
    vertices_mm: FloatArray
    triangles: IntArray
    glows: bool = False


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """All bodies of a moment, as one mesh to cast rays at.

    Attributes
    ----------
    body_of_triangle : (t,) index into `bodies`; the part's triangles come last, in CAD order
    first_of_part : number of the part's first triangle, t where there is none
    """

    bodies: tuple[SceneBody, ...]
    mesh: trimesh.Trimesh
    normals: FloatArray
    body_of_triangle: IntArray
    first_of_part: int
    T_world_part: FloatArray

    @cached_property
    def caster(self) -> RayCaster:
        """Casts rays at all bodies, in the world."""
        return RayCaster(self.mesh)


def box_body(name: str, colour: Colour, box: Box) -> SceneBody:
    """Return a box as triangles.

    Parameters
    ----------
    name : name of the thing that the body is a piece of
    colour : a colour of `GLOWING` makes it glow
    box : in the world [mm]
    """
    corners = (_CORNERS * box.half_mm) @ box.T[:3, :3].T + box.T[:3, 3]
    return SceneBody(name, colour, corners, _TRIANGLES, glows=colour in GLOWING)


def part_body(solid: Solid, T_world_part: FloatArray) -> SceneBody:
    """Return the part in its pose."""
    vertices = np.asarray(solid.mesh.vertices) @ T_world_part[:3, :3].T + T_world_part[:3, 3]
    return SceneBody("part", PART, vertices, np.asarray(solid.mesh.faces))


def standing_bodies(layout: CellLayout) -> list[SceneBody]:
    """Return the bodies that never move: table, trays, column, obstacles."""
    bodies = [
        box_body("column", ARM, layout.column),
        *(
            box_body(name, _obstacle_colour(name), box)
            for name, box in sorted(layout.obstacles.items())
        ),
    ]
    low, high = _extent(layout, bodies)
    table = Box.from_bounds(low[0], high[0], low[1], high[1], -TABLE_MM, -0.6)
    bodies.append(box_body("table", TABLE, table))
    (x0, y0), (x1, y1) = table_window(layout)
    x0, x1 = max(x0, low[0]), min(x1, high[0])
    y0, y1 = max(y0, low[1]), min(y1, high[1])
    if x0 < x1 and y0 < y1:
        lit = Box.from_bounds(x0, x1, y0, y1, -TABLE_MM, 0.0)
        bodies.append(box_body("seen from above", SEEN_TABLE, lit))
    for name, tray in sorted(layout.trays.items()):
        (x, y), (w, h) = tray.centre_mm, tray.size_mm
        plate = Box.from_bounds(x - w / 2, x + w / 2, y - h / 2, y + h / 2, -RIM_MM, 0.3)
        bodies.append(box_body(f"tray {name}", TRAYS.get(name, TRAY), plate))
    return bodies


def table_window(layout: CellLayout) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return low and high x, y of the overhead camera's view of the table."""
    width, height = layout.overhead.size_px
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]], dtype=float)
    points = layout.overhead.on_plane(corners)[:, :2]
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return (x0, y0), (x1, y1)


def _extent(layout: CellLayout, bodies: Sequence[SceneBody]) -> tuple[FloatArray, FloatArray]:
    points = [body.vertices_mm[:, :2] for body in bodies]
    for tray in layout.trays.values():
        centre, half = np.array(tray.centre_mm), np.array(tray.size_mm) / 2
        points.append(np.stack([centre - half, centre + half]))
    every = np.vstack([*points, np.array(table_window(layout)), layout.station_mm[None, :2]])
    return every.min(axis=0) - TABLE_ROOM_MM, every.max(axis=0) + TABLE_ROOM_MM


def _obstacle_colour(name: str) -> Colour:
    if "camera" in name:
        return CAMERA
    if "panel" in name:
        return PANEL
    return FIXED_GRIPPER if "fixture" in name else OBSTACLE


def fixed_gripper_bodies(layout: CellLayout, opening_mm: float) -> list[SceneBody]:
    """Return the fixed gripper at an opening; empty if the cell has none."""
    jaw = layout.fixed_gripper
    if jaw is None:
        return []
    T = layout.T_world_fixed_tcp
    return [
        *(box_body("fixed gripper", FIXED_GRIPPER, box.placed(T)) for box in jaw.body),
        *(
            box_body("fixed gripper's finger", FIXED_FINGER, box.placed(T))
            for box in jaw.fingers(opening_mm)
        ),
    ]


def arm_bodies(layout: CellLayout, q: FloatArray, opening_mm: float) -> list[SceneBody]:
    """Return the arm as the boxes of collision checks: links, arm gripper, two fingers.

    Parameters
    ----------
    layout : the cell
    q : (6,) joints of the configuration [rad, zed in mm]
    opening_mm : distance between the pads of the arm gripper
    """
    names = [link.name for link in layout.arm.links]
    boxes = Scene(layout, opening_mm, 0.0).arm_boxes(q)
    first, *links = boxes[: len(names)]
    arm_gripper = boxes[len(names) :]
    return [
        box_body(names[0], ARM, _thinner(first)),
        *(box_body(name, ARM, box) for name, box in zip(names[1:], links, strict=True)),
        *(
            box_body("arm gripper", ARM_GRIPPER, box)
            for box in arm_gripper[: len(layout.arm_gripper.body)]
        ),
        *(box_body("finger", FINGER, box) for box in arm_gripper[len(layout.arm_gripper.body) :]),
    ]


def _thinner(box: Box) -> Box:
    """Return a box slightly smaller, so that its sides are not in those of its neighbour."""
    return Box(box.T, box.half_mm - THINNER_MM)


def not_round(bodies: Sequence[SceneBody], point_mm: FloatArray) -> list[SceneBody]:
    """Return the bodies that a point (3,) is outside of: a camera does not see its own housing."""
    kept = []
    for body in bodies:
        low, high = body.vertices_mm.min(axis=0) - 1.0, body.vertices_mm.max(axis=0) + 1.0
        if body.name == "part" or np.any(point_mm < low) or np.any(point_mm > high):
            kept.append(body)
    return kept


def make_stage(
    bodies: Sequence[SceneBody], part: SceneBody | None, T_world_part: FloatArray
) -> SceneMesh:
    """Return bodies as one mesh, the part last.

    Parameters
    ----------
    bodies : all but the part, in the world [mm]
    part : the part, in the world; None if none is shown
    T_world_part : (4, 4) its pose [mm], for finding its samples
    """
    every = (*bodies, *([part] if part else []))
    starts = np.cumsum([0, *(len(b.vertices_mm) for b in every)])
    triangles = np.vstack([b.triangles + s for b, s in zip(every, starts, strict=False)])
    mesh = trimesh.Trimesh(np.vstack([b.vertices_mm for b in every]), triangles, process=False)
    counts = [len(b.triangles) for b in every]
    corner = np.asarray(mesh.vertices)[triangles]
    normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return SceneMesh(
        bodies=every,
        mesh=mesh,
        normals=normals,
        body_of_triangle=np.repeat(np.arange(len(every)), counts),
        first_of_part=sum(counts[: len(bodies)]),
        T_world_part=T_world_part,
    )


def moment_stage(
    layout: CellLayout,
    solid: Solid,
    moment: Moment,
    standing: Sequence[SceneBody],
    *,
    with_links: bool = True,
    with_palm: bool = True,
) -> SceneMesh:
    """Return the cell at a moment; links or palm of the arm may be left out, to see behind them.

    Parameters
    ----------
    layout : the cell
    solid : the part
    moment : configuration, openings and the part's pose
    standing : bodies that are the same at every moment
    with_links : draw carriage, upper arm and forearm
    with_palm : draw the body of the arm gripper
    """
    hidden = {"carriage", "upper", "fore"} if not with_links else set()
    hidden |= {"arm gripper"} if not with_palm else set()
    arm = arm_bodies(layout, moment.q, moment.arm_opening_mm)
    bodies = [
        *standing,
        *fixed_gripper_bodies(layout, moment.fixed_opening_mm),
        *(body for body in arm if body.name not in hidden),
    ]
    return make_stage(bodies, part_body(solid, moment.T_world_part), moment.T_world_part)
