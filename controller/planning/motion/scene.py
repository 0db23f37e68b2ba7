"""The arm among its surroundings: contact tests of configurations.

Two stages. Links, grippers and obstacles are boxes, and so is the part at first: the test of boxes
is vectorised, 0.02 ms a configuration, and its free results are final. Where only the part's box
touches something and the part's triangles are known, the triangles decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from messages import key

from ..geometry import Box, PartShape, PlacedShape, Triangles, overlap_turned, stack
from ..model import CellLayout, Jaw
from ._kinematics import link_boxes, link_frames, placed_boxes, tcp_pose

STANDING = key("the part standing there")
NEIGHBOUR = key("another object on the table")
STORED = key("a part in a tray")
_NONE = np.iinfo(np.int64).max
_COLUMN_COUNT = 1  # the column comes last, with an index in `names` of its own
SELF_MARGIN_MM = 3.0  # margin between links, whose relative place is better known than the world's
_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
GripperBoxes = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The load of the arm, and the obstacles it must not touch.

    Attributes
    ----------
    arm_opening_mm, fixed_opening_mm : openings of the two jaws
    carried : the part as a box in the TCP frame, or None
    standing : boxes in the world beside the layout's own, for instance the part in the fixed
        gripper
    ignore : names of world boxes that may be touched
    carried_mesh : the part's triangles in the TCP frame; decides where `carried` touches, which
        follows from it if None
    standing_meshes : triangles in the world that the empty gripper or another part may not touch
    """

    layout: CellLayout
    arm_opening_mm: float
    fixed_opening_mm: float
    carried: Box | None = None
    standing: tuple[Box, ...] = ()
    ignore: frozenset[str] = field(default_factory=frozenset)
    carried_mesh: PlacedShape | None = None
    standing_meshes: tuple[PlacedShape, ...] = ()
    # what follows from the above, worked out when first asked for: boxes that stand, that move
    _cache: list[Any] = field(default_factory=lambda: [None, None], init=False, repr=False)

    def __post_init__(self) -> None:
        if self.carried is None and self.carried_mesh is not None:
            object.__setattr__(self, "carried", self.carried_mesh.box)

    def statics(self) -> list[tuple[str, Box]]:
        """Return the world boxes by name; those that bound triangles come last."""
        named = [(name, box) for name, box in self._boxes() if name not in self.ignore]
        named += [(NEIGHBOUR, mesh.box) for mesh in self.layout.neighbours]
        named += [(STORED, mesh.box) for mesh in self.layout.stored]
        return named + [(STANDING, mesh.box) for mesh in self.standing_meshes]

    @property
    def _meshes(self) -> tuple[PlacedShape, ...]:
        """All fixed meshes, in the order of `statics`."""
        return (*self.layout.neighbours, *self.layout.stored, *self.standing_meshes)

    def _boxes(self) -> list[tuple[str, Box]]:
        layout = self.layout
        named = [(name, box) for name, box in layout.obstacles.items()]
        if (fixed_gripper := layout.fixed_gripper) is not None:
            named += self._fixed_gripper(fixed_gripper)
        return named + [(STANDING, b) for b in self.standing]

    def _fixed_gripper(self, fixed_gripper: Jaw) -> list[tuple[str, Box]]:
        T = self.layout.T_world_fixed_tcp
        fingers = fixed_gripper.fingers(self.fixed_opening_mm)
        off_mm, off_rad = self.layout.fixed_held
        return [
            *(("fixture", b.wider_in_xz(off_mm, off_rad).placed(T)) for b in fixed_gripper.body),
            *((key("fixture fingers"), b.wider_in_xz(off_mm, off_rad).placed(T)) for b in fingers),
        ]

    def reach_mm(self) -> tuple[float, float]:
        """Return the reach of gripper and part from wrist centre and approach axis [mm]."""
        boxes = [
            *self.layout.arm_gripper.body,
            *self.layout.arm_gripper.fingers(self.arm_opening_mm),
        ]
        if self.carried is not None:
            boxes.append(self.carried)
        T, half = stack(boxes)
        corners = T[:, None, :3, 3] + (half[:, None] * _SIGNS) @ np.swapaxes(T[:, :3, :3], 1, 2)
        corners[..., 0] += self.layout.arm.tool_mm
        away = np.linalg.norm(corners, axis=2), np.linalg.norm(corners[..., 1:], axis=2)
        return float(away[0].max()), float(away[1].max())

    def names(self) -> tuple[str, ...]:
        """Return the names of the indices of `contacts`."""
        return ("table", *(name for name, _ in self.statics()), key("the arm itself"), "column")

    def free(
        self,
        q: FloatArray,
        margin_mm: float | FloatArray = 10.0,
        table_margin_mm: float | FloatArray | None = None,
        arm_gripper: GripperBoxes | None = None,
        part: tuple[PartShape, FloatArray] | None = None,
    ) -> BoolArray:
        """Return a mask (n,) of the configurations that keep the margins.

        Parameters
        ----------
        q : (n, 6) rows of joints
        margin_mm, table_margin_mm, arm_gripper, part : as `contacts`
        """
        return np.asarray(self.contacts(q, margin_mm, table_margin_mm, arm_gripper, part) < 0)

    def contacts(
        self,
        q: FloatArray,
        margin_mm: float | FloatArray = 10.0,
        table_margin_mm: float | FloatArray | None = None,
        arm_gripper: GripperBoxes | None = None,
        part: tuple[PartShape, FloatArray] | None = None,
        self_margin_mm: float | FloatArray = SELF_MARGIN_MM,
    ) -> IntArray:
        """Return the index of a contact in `names` for each configuration (n, 6), -1 if free.

        Parameters
        ----------
        q : (n, 6) rows of joints
        margin_mm, table_margin_mm : one for all, or (n,); the table's is the same if None; the
            layout's own uncertainty comes on top
        arm_gripper : replaces body, fingers and `carried` by boxes per row, in the TCP frame:
            poses (n, m, 4, 4) and half edges (n, m, 3), the arm gripper's body first
        part : replaces `carried_mesh` by triangles at a pose of its own per row, in the TCP frame
            (n, 4, 4); the box that bounds them is added to `arm_gripper`
        self_margin_mm : one for all, or (n,), between parts of the arm and what it holds
        """
        n = len(q)
        if n == 0:
            return np.zeros(0, dtype=np.int64)
        more_mm = self.layout.clearance_mm
        margin = np.broadcast_to(np.asarray(margin_mm, dtype=np.float64) + more_mm, (n,))
        floor = np.broadcast_to(
            margin
            if table_margin_mm is None
            else np.asarray(table_margin_mm, np.float64) + more_mm,
            (n,),
        )
        own = np.broadcast_to(np.asarray(self_margin_mm, dtype=np.float64), (n,))
        moving = self._moving(q, arm_gripper, part)
        row, body, name = self._touching(moving, margin, floor, own)
        # the part is the last of what moves; any other contact between boxes is a contact
        still = len(self._still().names)
        loose = np.zeros(len(row), dtype=bool)
        if moving.shape is not None:
            loose |= body == moving.centres.shape[1] - 1
        meshes = self._meshes
        if meshes:
            last = 1 + still - _COLUMN_COUNT
            loose |= (name >= last - len(meshes)) & (name < last)
        found = np.full(n, _NONE)
        np.minimum.at(found, row[~loose], name[~loose])
        loose &= found[row] == _NONE
        if loose.any():
            exact = _Exact(self._still(), meshes, moving, margin, floor, own)
            order = np.lexsort((body[loose], name[loose], row[loose]))
            for k in np.flatnonzero(loose)[order]:
                if found[row[k]] == _NONE and exact.stands(int(row[k]), int(body[k]), int(name[k])):
                    found[row[k]] = name[k]
        return np.where(found == _NONE, -1, found)

    def _still(self) -> _Still:
        if self._cache[0] is None:
            self._cache[0] = _Still.of([*self.statics(), ("column", self.layout.column)])
        still: _Still = self._cache[0]
        return still

    def _moving(
        self,
        q: FloatArray,
        arm_gripper: GripperBoxes | None,
        part: tuple[PartShape, FloatArray] | None,
    ) -> _Moving:
        """Return the world poses of links, gripper and part, and the part's triangles."""
        n, links = len(q), self.layout.arm.links
        R_link, origins = link_frames(self.layout, q)
        T_tcp = tcp_pose(self.layout, q)
        if self._cache[1] is None:
            layout = self.layout
            in_tcp = [*layout.arm_gripper.body, *layout.arm_gripper.fingers(self.arm_opening_mm)]
            carried = [] if self.carried is None else [self.carried]
            self._cache[1] = (stack(links), stack(in_tcp), stack([*in_tcp, *carried]))
        (T_link, half_link), bare, full = self._cache[1]
        shape, T_part = None, None
        if arm_gripper is None:
            T_tcp_box, half_gripper = bare if part is not None else full
            if part is None and self.carried_mesh is not None:
                shape, T_part = self.carried_mesh.shape, T_tcp @ self.carried_mesh.T
        else:
            T_tcp_box, half_gripper = arm_gripper
        of_links = placed_boxes(R_link, origins, T_link)
        of_gripper = placed_boxes(T_tcp[:, None, :3, :3], T_tcp[:, None, :3, 3], T_tcp_box)
        turns, centres = [of_links[0], of_gripper[0]], [of_links[1], of_gripper[1]]
        m = T_tcp_box.shape[-3]
        halves = [
            np.broadcast_to(half_link, (n, *half_link.shape)),
            np.broadcast_to(half_gripper, (n, m, 3)),
        ]
        if part is not None:
            shape, T_part = part[0], T_tcp @ part[1]
            T_box = T_part @ shape.box.T
            turns.append(T_box[:, None, :3, :3])
            centres.append(T_box[:, None, :3, 3])
            halves.append(np.broadcast_to(shape.box.half_mm, (n, 1, 3)))
        return _Moving(
            np.concatenate(turns, axis=1),
            np.concatenate(centres, axis=1),
            np.concatenate(halves, axis=1),
            tuple(k for k, a in enumerate(links) if a.keeps_clear_of != "nothing"),
            shape,
            T_part,
        )

    def _touching(
        self, moving: _Moving, margin: FloatArray, floor: FloatArray, own: FloatArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Return the contacts of all bodies, as boxes: rows, moving bodies, indices in `names`."""
        still = self._still()
        R, centre, half = moving.turns, moving.centres, moving.halves
        k = centre.shape[1]
        around = (np.abs(R) @ half[..., None])[..., 0]  # half of the box along the world's axes
        first = _first(link.may_touch_table for link in self.layout.arm.links)
        low = centre[:, first:, 2] - around[:, first:, 2] < floor[:, None]
        row, body = np.nonzero(low)
        rows, bodies, names = [row], [body + first], [np.zeros_like(row)]

        # what the boxes along the axes keep apart needs no further test
        room = around + margin[:, None, None]
        near = np.ones((*centre.shape[:2], len(still.centres)), dtype=bool)
        for axis in range(3):
            gap = np.abs(centre[:, :, axis, None] - still.centres[:, axis])
            near &= gap <= room[:, :, axis, None] + still.around[:, axis]
        near[:, : _first(link.may_touch_base for link in self.layout.arm.links), -1] = False
        row, body, j = np.nonzero(near)
        hits = overlap_turned(
            R[row, body],
            half[row, body] + margin[row, None],
            still.turns[j],
            still.halves[j],
            still.centres[j] - centre[row, body],
        )
        rows.append(row[hits])
        bodies.append(body[hits])
        column = still.centres.shape[0] - 1
        names.append(np.where(j[hits] == column, 2 + column, 1 + j[hits]))

        # neighbours along the chain are kept apart by the joint limits, not by these coarse boxes
        one, other = self._own_pairs(k)
        near = np.ones((len(centre), len(one)), dtype=bool)
        for axis in range(3):
            gap = np.abs(centre[:, one, axis] - centre[:, other, axis])
            near &= gap <= around[:, one, axis] + around[:, other, axis] + 2 * own[:, None]
        row, pair = np.nonzero(near)
        i, j = one[pair], other[pair]
        hits = overlap_turned(
            R[row, i],
            half[row, i] + own[row, None],
            R[row, j],
            half[row, j],
            centre[row, j] - centre[row, i],
        )
        rows.append(row[hits])
        bodies.append(i[hits])
        names.append(np.full(np.count_nonzero(hits), 1 + column))
        return np.concatenate(rows), np.concatenate(bodies), np.concatenate(names)

    def _own_pairs(self, moving: int) -> tuple[IntArray, IntArray]:
        """Return the moving boxes and the links that must keep clear of each other: two of (p,)."""
        arm = self.layout.arm
        kept_from = tuple(link.keeps_clear_of for link in arm.links)
        return _pairs(kept_from, tuple(arm.link_pairs), moving, len(self.layout.arm_gripper.body))

    def arm_boxes(self, q: FloatArray) -> list[Box]:
        """Return the world boxes of the links and the open or closed gripper at one q (6,)."""
        T_link, half_mm = link_boxes(self.layout, q[None])
        T_tcp = tcp_pose(self.layout, q)
        arm_gripper = [
            *self.layout.arm_gripper.body,
            *self.layout.arm_gripper.fingers(self.arm_opening_mm),
        ]
        return [
            *(Box(T, half) for T, half in zip(T_link[0], half_mm[0], strict=True)),
            *(box.placed(T_tcp) for box in arm_gripper),
        ]


def _first(flags: Iterable[bool]) -> int:
    """Return the index of the first link that has a flag, the number of links where none has."""
    count = 0
    for flag in flags:
        if flag:
            break
        count += 1
    return count


@cache
def _pairs(
    kept_from: tuple[str, ...], links: tuple[tuple[int, int], ...], moving: int, body: int
) -> tuple[IntArray, IntArray]:
    """Return the arm's boxes and the links that must keep clear of each other: two of (p,).

    Parameters
    ----------
    kept_from : boxes of the gripper checked against each link
    links : pairs of links that may touch each other
    moving, body : boxes in all, and those of the gripper's body, which come after the links
    """
    begin = {"gripper": len(kept_from), "fingers": len(kept_from) + body, "nothing": moving}
    pairs = [(max(pair), min(pair)) for pair in links]
    for link, of in enumerate(kept_from):
        pairs += [(i, link) for i in range(begin[of], moving)]
    one, other = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return one, other


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """Fixed boxes, stacked: the scene's statics, the column last."""

    names: tuple[str, ...]
    turns: FloatArray
    centres: FloatArray
    halves: FloatArray
    around: FloatArray

    @classmethod
    def of(cls, named: Sequence[tuple[str, Box]]) -> _Still:
        T, half = stack([box for _, box in named])
        R = np.ascontiguousarray(T[:, :3, :3])
        around = (np.abs(R) @ half[..., None])[..., 0]
        return cls(tuple(name for name, _ in named), R, T[:, :3, 3].copy(), half, around)


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """Boxes that move, per row: the arm's links, gripper, part.

    Attributes
    ----------
    turns, centres, halves : (n, k, 3, 3), (n, k, 3), (n, k, 3)
    links : indices of the links that the part is kept from
    shape, T_part : the part's triangles and their world poses (n, 4, 4), None without
    """

    turns: FloatArray
    centres: FloatArray
    halves: FloatArray
    links: tuple[int, ...]
    shape: PartShape | None
    T_part: FloatArray | None


class _Exact:
    """The second stage: contacts of boxes, confirmed or refuted by triangles."""

    def __init__(
        self,
        still: _Still,
        standing: Sequence[PlacedShape],
        moving: _Moving,
        margin: FloatArray,
        floor: FloatArray,
        own: FloatArray,
    ) -> None:
        self._moving, self._margin, self._floor, self._own = moving, margin, floor, own
        self._part = None if moving.shape is None else Triangles(moving.shape)
        self._still = still
        self._standing = []
        for mesh in standing:
            triangles = Triangles(mesh.shape)
            triangles.place(mesh.T)
            self._standing.append(triangles)

    def stands(self, row: int, body: int, name: int) -> bool:
        """Return True if a contact between boxes is one between triangles as well."""
        moving, margin = self._moving, float(self._margin[row])
        part = self._part if body == moving.centres.shape[1] - 1 else None
        if part is not None and moving.T_part is not None:
            part.place(moving.T_part[row])
        column = len(self._still.names) - 1
        if name == 0:
            return part is None or part.lowest_mm() < self._floor[row]
        if name == 1 + column:
            return part is None or any(
                self._touches_link(part, row, link) for link in self._moving.links
            )
        j = column if name == 2 + column else name - 1
        R, centre, half = self._still.turns[j], self._still.centres[j], self._still.halves[j]
        if part is not None and not part.touch(R, centre, half + margin):
            return False
        mesh = j - (column - len(self._standing))
        if mesh < 0 or j == column:
            return True
        # two parts: each against the box round the other, which errs on the safe side
        R, centre, half = (
            moving.turns[row, body],
            moving.centres[row, body],
            moving.halves[row, body],
        )
        return self._standing[mesh].touch(R, centre, half + margin)

    def _touches_link(self, part: Triangles, row: int, link: int) -> bool:
        moving = self._moving
        half = moving.halves[row, link] + float(self._own[row])
        return part.touch(moving.turns[row, link], moving.centres[row, link], half)
